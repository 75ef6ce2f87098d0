//! Values of maps between their pixels; outside of a map there are zeros.

/// The pixel `[x, y]` of a map `[h, w]`, if it lies inside.
fn inside([h, w]: [usize; 2], x: i64, y: i64) -> Option<usize> {
    let within = |at: i64, side: usize| (0..side as i64).contains(&at);
    (within(x, w) && within(y, h)).then(|| y as usize * w + x as usize)
}

/// The nearest value.
pub(super) fn nearest(map: &[f32], size: [usize; 2], [x, y]: [f32; 2]) -> f32 {
    inside(size, x.round_ties_even() as i64, y.round_ties_even() as i64).map_or(0.0, |at| map[at])
}

/// The value between the nearest four.
pub(super) fn bilinear(map: &[f32], size: [usize; 2], [x, y]: [f32; 2]) -> f32 {
    let (left, top) = (x.floor(), y.floor());
    let (u, v) = (x - left, y - top);
    let mut sum = 0.0;
    for (i, weight) in [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v].into_iter().enumerate() {
        let at = inside(size, left as i64 + i as i64 % 2, top as i64 + i as i64 / 2);
        sum += weight * at.map_or(0.0, |at| map[at]);
    }
    sum
}

/// The row of `map` `[h, w, out.len()]` between the nearest sixteen, by Keys' kernel with a = -3/4.
///
/// Source: Keys, Cubic convolution interpolation for digital image processing, 1981.
pub(super) fn bicubic(map: &[f32], size: [usize; 2], [x, y]: [f32; 2], out: &mut [f32]) {
    let (left, top) = (x.floor(), y.floor());
    let [across, down] = [keys(x - left), keys(y - top)];
    out.fill(0.0);
    for (j, v) in down.into_iter().enumerate() {
        for (i, u) in across.into_iter().enumerate() {
            let at = inside(size, left as i64 + i as i64 - 1, top as i64 + j as i64 - 1);
            if let Some(at) = at {
                let row = &map[at * out.len()..][..out.len()];
                out.iter_mut().zip(row).for_each(|(out, value)| *out += u * v * value);
            }
        }
    }
}

/// Weights of the pixels at -1, 0, 1 and 2 for a place between 0 and 1.
fn keys(t: f32) -> [f32; 4] {
    const A: f32 = -0.75;
    let near = |d: f32| ((A + 2.0) * d - (A + 3.0)) * d * d + 1.0;
    let far = |d: f32| ((A * d - 5.0 * A) * d + 8.0 * A) * d - 4.0 * A;
    [far(t + 1.0), near(t), near(1.0 - t), far(2.0 - t)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane is met exactly between two pixels, and by bicubic values where these are symmetric; the nearest value is
    /// the one of the rounded place.
    #[test]
    fn planes_are_met_between_pixels() {
        let map: Vec<f32> = (0..6 * 7).map(|i| (i % 7) as f32 + 10.0 * (i / 7) as f32).collect();
        let mut row = [0.0];
        let plane = |[x, y]: [f32; 2]| x + 10.0 * y;
        for at in [[2.0, 3.0], [2.5, 2.5], [3.5, 2.0]] {
            bicubic(&map, [6, 7], at, &mut row);
            assert!((row[0] - plane(at)).abs() < 1e-4, "{at:?}: {}", row[0]);
        }
        for at in [[2.0, 3.0], [2.25, 2.5], [3.75, 1.125]] {
            assert!((bilinear(&map, [6, 7], at) - plane(at)).abs() < 1e-5, "{at:?}");
        }
        assert_eq!(nearest(&map, [6, 7], [2.4, 2.6]), 32.0);
        assert_eq!(bilinear(&map, [6, 7], [-0.5, 0.0]), 0.0);
        assert_eq!(bilinear(&map, [6, 7], [6.5, 0.0]), 3.0, "half of the last, and nothing beyond");
    }
}
