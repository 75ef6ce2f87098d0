//! Rotations of Gaussians: one of many that give the same ellipsoid, and as three numbers.

/// Scales in descending order, and the rotation that belongs to them: axes are exchanged together with their scales.
pub(super) fn sort_axes(log_scales: [f32; 3], quat: [f32; 4]) -> ([f32; 3], [f64; 4]) {
    let order = descending(log_scales);
    let columns = to_matrix(unit(quat));
    let mut sorted = order.map(|axis| columns[axis]);
    if determinant(sorted) < 0.0 {
        sorted[2] = sorted[2].map(|x| -x);
    }
    (order.map(|axis| log_scales[axis]), to_quaternion(sorted))
}

/// Rounded scales and rotation, sorted by [`sort_axes`], with the axes that they had before, and a quaternion of the
/// length before.
pub(super) fn unsorted(
    (log_scales, quat): ([f32; 3], [f32; 4]),
    (rounded, turned): ([f32; 3], [f32; 4]),
) -> ([f32; 3], [f32; 4]) {
    let order = descending(log_scales);
    let mut scales = [0.0; 3];
    (0..3).for_each(|k| scales[order[k]] = rounded[k]);
    // The turn that rounding is, seen from outside, is the same for all axes.
    let [w, x, y, z] = with_real_part(imaginary_part(sort_axes(log_scales, quat).1));
    let turn = product(turned.map(f64::from), [w, -x, -y, -z]);
    let length = quat.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt();
    let length = if length > 0.0 { length } else { 1.0 };
    (scales, product(turn, unit(quat)).map(|x| (x * length) as f32))
}

/// The product of two quaternions, the turn of the second one first.
fn product([a, b, c, d]: [f64; 4], [w, x, y, z]: [f64; 4]) -> [f64; 4] {
    [
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    ]
}

/// Axes by descending scales.
fn descending(log_scales: [f32; 3]) -> [usize; 3] {
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| log_scales[b].total_cmp(&log_scales[a]));
    order
}

/// Half turns about the axes change nothing, and neither does the sign: of these eight quaternions the one with the
/// largest real part. Its imaginary part has a length up to √¾.
pub(super) fn imaginary_part(q: [f64; 4]) -> [f64; 3] {
    let [w, x, y, z] = q;
    let turned = [[w, x, y, z], [-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]];
    let best = turned.into_iter().reduce(|best, q| if q[0].abs() > best[0].abs() { q } else { best });
    let [w, x, y, z] = best.unwrap_or(q);
    [x, y, z].map(|part| if w < 0.0 { -part } else { part })
}

/// The unit quaternion of an imaginary part, of length 1 at most.
pub(super) fn with_real_part([x, y, z]: [f64; 3]) -> [f64; 4] {
    let squares = x * x + y * y + z * z;
    let length = squares.max(1.0).sqrt();
    [(1.0 - squares).max(0.0).sqrt(), x / length, y / length, z / length]
}

fn unit(quat: [f32; 4]) -> [f64; 4] {
    let q = quat.map(f64::from);
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length > 0.0 { q.map(|x| x / length) } else { [1.0, 0.0, 0.0, 0.0] }
}

/// Columns of the matrix, the images of the axes.
fn to_matrix([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)],
        [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)],
        [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

fn determinant([a, b, c]: [[f64; 3]; 3]) -> f64 {
    a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
}

/// The quaternion of a rotation by its columns, from the largest of four expressions for its parts (Shepperd).
fn to_quaternion([a, b, c]: [[f64; 3]; 3]) -> [f64; 4] {
    let squares =
        [1.0 + a[0] + b[1] + c[2], 1.0 + a[0] - b[1] - c[2], 1.0 - a[0] + b[1] - c[2], 1.0 - a[0] - b[1] + c[2]];
    let largest = (1..4).fold(0, |best, i| if squares[i] > squares[best] { i } else { best });
    let double = [[b[2] - c[1], c[0] - a[2], a[1] - b[0]], [a[1] + b[0], c[0] + a[2], b[2] + c[1]]];
    let ([wx, wy, wz], [xy, xz, yz]) = (double[0], double[1]);
    let row = [[squares[0], wx, wy, wz], [wx, squares[1], xy, xz], [wy, xy, squares[2], yz], [wz, xz, yz, squares[3]]]
        [largest];
    let length = row.iter().map(|x| x * x).sum::<f64>().sqrt();
    row.map(|x| x / length)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn covariance(log_scales: [f32; 3], q: [f64; 4]) -> [f64; 9] {
        let columns = to_matrix(q);
        std::array::from_fn(|i| {
            (0..3).map(|k| f64::from(2.0 * log_scales[k]).exp() * columns[k][i / 3] * columns[k][i % 3]).sum()
        })
    }

    #[test]
    fn the_ellipsoid_stays() {
        let quats = [[1.0, 0.2, -0.4, 0.3], [0.0, 1.0, 0.0, 0.0], [0.1, -0.9, 0.5, 2.0], [-0.3, 0.1, 0.1, 0.8]];
        let scales = [[0.1, 0.5, -0.6], [0.5, 0.1, -0.6], [-0.6, 0.1, 0.5], [-0.2, -0.2, 0.9]];
        for (quat, log_scales) in quats.into_iter().flat_map(|q| scales.map(|s| (q, s))) {
            let before = covariance(log_scales, unit(quat));
            let (sorted, turned) = sort_axes(log_scales, quat);
            assert!(sorted.is_sorted_by(|a, b| a >= b));
            let part = imaginary_part(turned);
            assert!(part.iter().map(|x| x * x).sum::<f64>() <= 0.75 + 1e-12);
            let after = covariance(sorted, with_real_part(part));
            assert!(before.iter().zip(after).all(|(a, b)| (a - b).abs() < 1e-12), "{quat:?} {log_scales:?}");
        }
    }

    #[test]
    fn zeros_are_the_identity() {
        assert_eq!(sort_axes([3.0, 2.0, 1.0], [0.0; 4]), ([3.0, 2.0, 1.0], [1.0, 0.0, 0.0, 0.0]));
    }
}
