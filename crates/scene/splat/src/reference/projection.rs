//! Projection by the book, with derivatives by forward-mode dual numbers.

use crate::settings::{RATIO_FLOOR, RasterSettings};
use weaver_geometry::sh;
use weaver_kernels::Dual;
use weaver_scene::{CameraSlices, Color, GaussianSlices};

/// Variables of a projection: mean 3, quaternion 4, scale 3, opacity 1, view matrix 12, intrinsics 4.
pub(super) const VARIABLES: usize = 27;
pub(super) type Number = Dual<f64, VARIABLES>;

/// One Gaussian's numbers.
struct Gaussian<'a> {
    mean: [f64; 3],
    quat: [f64; 4],
    scale: [f64; 3],
    opacity: f64,
    color: &'a [f64],
}

impl<'a> Gaussian<'a> {
    fn of(gaussians: &GaussianSlices<'a, f64>, n: usize) -> Self {
        let (values, len) = gaussians.color.values();
        Self {
            mean: std::array::from_fn(|i| gaussians.means[3 * n + i]),
            quat: std::array::from_fn(|i| gaussians.quats[4 * n + i]),
            scale: std::array::from_fn(|i| gaussians.scales[3 * n + i]),
            opacity: gaussians.opacities[n],
            color: &values[n * len..(n + 1) * len],
        }
    }
}

/// A splat as a pixel sees it, with derivatives: center x y, inverse covariance a b c, opacity, z, color.
pub(super) struct Seen {
    pub(super) index: usize,
    pub(super) center: [Number; 2],
    pub(super) conic: [Number; 3],
    pub(super) opacity: Number,
    pub(super) z: Number,
    pub(super) color: [Number; 3],
    /// Basis functions and which channels are not clamped, for the gradient of the coefficients.
    pub(super) basis: [f64; sh::MAX_COEFFICIENTS],
    pub(super) open: [bool; 3],
    /// Three deviations of the longer axis, pixels.
    pub(super) radius: f64,
}

fn maximum(a: Number, b: Number) -> Number {
    if a.value > b.value { a } else { b }
}

fn minimum(a: Number, b: Number) -> Number {
    if a.value < b.value { a } else { b }
}

fn matmul<const A: usize, const B: usize, const C: usize>(
    a: &[[Number; B]; A],
    b: &[[Number; C]; B],
) -> [[Number; C]; A] {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| (0..B).fold(Number::constant(0.0), |sum, k| sum + a[i][k] * b[k][j]))
    })
}

fn transpose<const A: usize, const B: usize>(a: &[[Number; B]; A]) -> [[Number; A]; B] {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

/// A view's camera: the rows of its matrix, focal lengths and principal point, and the size of its picture.
struct Pinhole<'a> {
    matrix: &'a [f64],
    k: &'a [f64],
    width: f64,
    height: f64,
}

/// Projects one Gaussian by the book; `None` where it is not drawn.
fn see(
    index: usize,
    gaussian: &Gaussian<'_>,
    color: &Color<'_, f64>,
    &Pinhole { matrix, k, width, height }: &Pinhole<'_>,
    settings: &RasterSettings,
) -> Option<Seen> {
    let c = Number::constant;
    let (one, two) = (c(1.0), c(2.0));
    let mut values = [0.0; VARIABLES];
    values[..3].copy_from_slice(&gaussian.mean);
    values[3..7].copy_from_slice(&gaussian.quat);
    values[7..10].copy_from_slice(&gaussian.scale);
    values[10] = gaussian.opacity;
    values[11..23].copy_from_slice(&matrix[..12]);
    values[23..].copy_from_slice(&k[..4]);
    let inputs = Number::inputs(values);
    let mean: [Number; 3] = std::array::from_fn(|i| inputs[i]);
    let quat: [Number; 4] = std::array::from_fn(|i| inputs[3 + i]);
    let scale: [Number; 3] = std::array::from_fn(|i| inputs[7 + i]);
    let opacity = inputs[10];
    let axes: [[Number; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| inputs[11 + 4 * i + j]));
    let shift: [Number; 3] = std::array::from_fn(|i| inputs[11 + 4 * i + 3]);
    let [fx, fy, cx, cy]: [Number; 4] = std::array::from_fn(|i| inputs[23 + i]);

    let point = matmul(&axes, &mean.map(|m| [m]));
    let [x, y, z]: [Number; 3] = std::array::from_fn(|i| point[i][0] + shift[i]);
    if !(settings.near <= z.value && z.value <= settings.far) {
        return None;
    }

    // World covariance R diag(s^2) R^T.
    let length = quat.iter().fold(c(0.0), |sum, &q| sum + q * q).sqrt();
    let [qw, qx, qy, qz] = quat.map(|q| q / length);
    let rotation = [
        [one - two * (qy * qy + qz * qz), two * (qx * qy - qw * qz), two * (qx * qz + qw * qy)],
        [two * (qx * qy + qw * qz), one - two * (qx * qx + qz * qz), two * (qy * qz - qw * qx)],
        [two * (qx * qz - qw * qy), two * (qy * qz + qw * qx), one - two * (qx * qx + qy * qy)],
    ];
    let stretched = rotation.map(|row| [row[0] * scale[0], row[1] * scale[1], row[2] * scale[2]]);
    let covariance = matmul(&stretched, &transpose(&stretched));

    // Image covariance J A C A^T J^T.
    let (w, h, spare) = (c(width), c(height), c(0.3));
    let spare_x = spare * (w / (two * fx));
    let spare_y = spare * (h / (two * fy));
    let slope_x = minimum(maximum(x / z, -(cx / fx + spare_x)), (w - cx) / fx + spare_x);
    let slope_y = minimum(maximum(y / z, -(cy / fy + spare_y)), (h - cy) / fy + spare_y);
    let jacobian = [[fx / z, c(0.0), -(fx * slope_x / z)], [c(0.0), fy / z, -(fy * slope_y / z)]];
    let map = matmul(&jacobian, &axes);
    let sharp = matmul(&matmul(&map, &covariance), &transpose(&map));
    let eps = c(settings.eps2d);
    let (xx, xy, yy) = (sharp[0][0] + eps, sharp[0][1], sharp[1][1] + eps);
    let determinant = xx * yy - xy * xy;
    if determinant.value <= 0.0 {
        return None;
    }
    let spread = (0.5 * (xx.value - yy.value)).hypot(xy.value);
    let longest = (0.5 * (xx.value + yy.value) + spread).sqrt();
    if settings.radius_clip.is_some_and(|least| 3.0 * longest < least) {
        return None;
    }
    let opacity = if settings.antialiased {
        let ratio = (sharp[0][0] * sharp[1][1] - sharp[0][1] * sharp[1][0]) / determinant;
        opacity * maximum(ratio, c(RATIO_FLOOR)).sqrt()
    } else {
        opacity
    };

    let mut basis = [0.0; sh::MAX_COEFFICIENTS];
    basis[0] = 1.0;
    let mut open = [true; 3];
    let color = match *color {
        Color::None => [c(0.0); 3],
        Color::Plain(_) => std::array::from_fn(|i| c(gaussian.color[i])),
        Color::Sh { degree, .. } => {
            let adjugate: [[Number; 3]; 3] = std::array::from_fn(|i| {
                std::array::from_fn(|j| {
                    let (a, b, d, e) = ((j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3);
                    axes[a][d] * axes[b][e] - axes[a][e] * axes[b][d]
                })
            });
            let det = axes[0][0] * adjugate[0][0] + axes[0][1] * adjugate[1][0] + axes[0][2] * adjugate[2][0];
            let center = matmul(&adjugate, &shift.map(|s| [-s / det]));
            let sight: [Number; 3] = std::array::from_fn(|i| mean[i] - center[i][0]);
            let distance = sight.iter().fold(c(0.0), |sum, &s| sum + s * s).sqrt();
            let values =
                if degree == 0 { sh::basis(0, sight, c) } else { sh::basis(degree, sight.map(|s| s / distance), c) };
            basis = values.map(|b| b.value);
            let sums: [Number; 3] = std::array::from_fn(|channel| {
                (0..gaussian.color.len() / 3)
                    .fold(c(0.5), |sum, term| sum + values[term] * c(gaussian.color[3 * term + channel]))
            });
            open = sums.map(|sum| sum.value > 0.0);
            sums.map(|sum| maximum(sum, c(0.0)))
        }
    };
    let seen = Seen {
        index,
        center: [fx * x / z + cx, fy * y / z + cy],
        conic: [yy / determinant, -(xy / determinant), xx / determinant],
        opacity,
        z,
        color,
        basis,
        open,
        radius: 3.0 * longest,
    };
    let inputs = [&gaussian.mean[..], &gaussian.quat, &gaussian.scale, &[gaussian.opacity], gaussian.color];
    let finite = inputs.iter().all(|part| part.iter().all(|x| x.is_finite()))
        && seen.numbers().iter().all(|number| number.value.is_finite());
    finite.then_some(seen)
}

impl Seen {
    /// Center, inverse covariance, opacity, depth, color.
    pub(super) fn numbers(&self) -> [Number; 10] {
        let ([x, y], [a, b, c], [r, g, blue]) = (self.center, self.conic, self.color);
        [x, y, a, b, c, self.opacity, self.z, r, g, blue]
    }
}

/// All that view `v` sees, in drawing order.
pub(super) fn see_all(
    gaussians: &GaussianSlices<'_, f64>,
    cameras: &CameraSlices<'_, f64>,
    settings: &RasterSettings,
    v: usize,
) -> Vec<Seen> {
    let matrix = &cameras.viewmats[v * cameras.matrix_len()..];
    let k = &cameras.intrinsics[4 * v..];
    let pinhole = Pinhole { matrix, k, width: cameras.width as f64, height: cameras.height as f64 };
    let mut seen: Vec<Seen> = (0..gaussians.opacities.len())
        .filter_map(|n| see(n, &Gaussian::of(gaussians, n), &gaussians.color, &pinhole, settings))
        .filter(|seen| features_of(gaussians, seen).iter().all(|x| x.is_finite()))
        .collect();
    seen.sort_by(|a, b| (a.z.value as f32).total_cmp(&(b.z.value as f32)));
    seen
}

/// The features of a Gaussian as a pixel sees it.
pub(super) fn features_of<'a>(gaussians: &GaussianSlices<'a, f64>, seen: &Seen) -> &'a [f64] {
    gaussians.features.map_or(&[], |features| features.of(seen.index))
}
