//! Square patches of photos, and their alignment with another photo.

use crate::photo::Photo;
use weaver_geometry::glam::{DMat2, DVec2};
use weaver_kernels::dense;

/// Samples from the middle of a patch to its side, and of the whole patch.
const REACH: usize = 5;
const SIDE: usize = 2 * REACH + 1;
const SAMPLES: usize = SIDE * SIDE;
/// Sums are taken in so many parts, which is the same number of lanes everywhere.
const LANES: usize = 8;
const PADDED: usize = SAMPLES.next_multiple_of(LANES);
/// Numbers of a movement: of the middle, then of the offsets.
const NUMBERS: usize = 6;
/// The least standard deviation of a textured patch, and the expected difference between photos; white is 1.
const FLAT: f32 = 0.02;
const NOISE: f64 = 0.02;
/// Steps of an alignment, and the movement below which it ends, samples.
const STEPS: usize = 12;
const STILL: f64 = 0.003;
/// Factor from a gray value to 0 to 1.
const WHITE: f32 = 1.0 / 255.0;

/// Gray values row by row; 0 beyond the last sample.
type Patch = [f32; PADDED];

/// A photo in gray: the means of its colors, rounded.
#[derive(Clone, Debug)]
pub(super) struct Gray {
    values: Vec<u8>,
    size: [usize; 2],
}

impl Gray {
    pub fn of(photo: &Photo<'_>) -> Self {
        let mean = |rgb: &[u8]| ((rgb.iter().map(|color| u16::from(*color)).sum::<u16>() + 1) / 3) as u8;
        Self { values: photo.rgb.chunks_exact(3).map(mean).collect(), size: photo.size }
    }
}

/// The sum of products, in a fixed order.
#[inline(always)]
fn dot(a: &Patch, b: &Patch) -> f32 {
    let mut lanes = [0.0; LANES];
    for (a, b) in a.chunks_exact(LANES).zip(b.chunks_exact(LANES)) {
        lanes.iter_mut().zip(a.iter().zip(b)).for_each(|(sum, (a, b))| *sum += a * b);
    }
    lanes.iter().sum()
}

/// Surroundings of a pixel, by bilinear interpolation, less their mean; `None` where they reach out of the photo.
///
/// `warp` takes offsets in samples to offsets in pixels.
#[inline(always)]
fn sampled(photo: &Gray, at: DVec2, warp: DMat2) -> Option<Patch> {
    let [height, width] = photo.size;
    let reach = warp.abs() * DVec2::splat(REACH as f64);
    // Pixels have their centers at halves.
    let middle = at - 0.5;
    let (low, high) = (middle - reach, middle + reach);
    if !(low.min_element() >= 0.0 && high.x < (width - 1) as f64 && high.y < (height - 1) as f64) {
        return None;
    }
    let mut patch = [0.0; PADDED];
    for (i, row) in patch[..SAMPLES].chunks_exact_mut(SIDE).enumerate() {
        let row_start = middle + warp * DVec2::new(-(REACH as f64), i as f64 - REACH as f64);
        for (j, value) in row.iter_mut().enumerate() {
            let at = row_start + warp.x_axis * j as f64;
            let (x, y) = (at.x as usize, at.y as usize);
            let (across, down) = ((at.x - x as f64) as f32, (at.y - y as f64) as f32);
            let from = y * width + x;
            let [above, below] = [from, from + width].map(|from| {
                let [left, right] = [from, from + 1].map(|from| f32::from(photo.values[from]));
                left + across * (right - left)
            });
            *value = (above + down * (below - above)) * WHITE;
        }
    }
    let mean = patch.iter().sum::<f32>() / SAMPLES as f32;
    patch[..SAMPLES].iter_mut().for_each(|value| *value -= mean);
    Some(patch)
}

/// A patch that others are aligned with.
pub(super) struct Template {
    /// Less its mean.
    patch: Patch,
    /// The root of the sum of its squares.
    length: f32,
    /// Slopes of the patch by each number of a movement, as far as they are neither brightness nor contrast.
    slopes: [Patch; NUMBERS],
    /// Takes differences along the slopes to a movement.
    inverse: [[f64; NUMBERS]; NUMBERS],
}

impl Template {
    /// Surroundings of a pixel; `None` where they are flat or reach out of the photo.
    #[inline(always)]
    pub fn new(photo: &Gray, at: DVec2, warp: DMat2) -> Option<Self> {
        const HALF: f64 = 0.5;
        let patch = sampled(photo, at, warp)?;
        let square = dot(&patch, &patch);
        if square < FLAT * FLAT * SAMPLES as f32 {
            return None;
        }
        let slope = |axis: DVec2| {
            let [ahead, behind] = [HALF, -HALF].map(|by| sampled(photo, at + warp * axis * by, warp));
            let mut slope = ahead?;
            let behind = behind?;
            slope.iter_mut().zip(behind).for_each(|(ahead, behind)| *ahead -= behind);
            Some(slope)
        };
        let (across, down) = (slope(DVec2::X)?, slope(DVec2::Y)?);
        // Offsets over the reach, so that all numbers are of one size.
        let offset = |i: usize| [i % SIDE, i / SIDE].map(|k| k as f32 / REACH as f32 - 1.0);
        let times = |slope: &Patch, axis: usize| std::array::from_fn(|i| slope[i] * offset(i)[axis]);
        let mut slopes = [across, down, times(&across, 0), times(&across, 1), times(&down, 0), times(&down, 1)];
        for slope in &mut slopes {
            let mean = slope.iter().sum::<f32>() / SAMPLES as f32;
            let along = dot(slope, &patch) / square;
            for (slope, value) in slope[..SAMPLES].iter_mut().zip(&patch) {
                *slope -= mean + along * value;
            }
        }
        let mut matrix: [[f64; NUMBERS]; NUMBERS] =
            std::array::from_fn(|a| std::array::from_fn(|b| f64::from(dot(&slopes[a], &slopes[b]))));
        (0..NUMBERS).for_each(|k| matrix[k][k] += NOISE * NOISE);
        Some(Self { patch, length: square.sqrt(), slopes, inverse: inverted(matrix)? })
    }

    /// The aligned place in a photo, beginning at `at` and `warp`, and the normalized correlation there: 1 where both
    /// are equal but for brightness and contrast.
    #[inline(always)]
    pub fn aligned(&self, photo: &Gray, mut at: DVec2, mut warp: DMat2) -> Option<(DVec2, f32)> {
        let mut alike = 0.0;
        for _ in 0..STEPS {
            let mut patch = sampled(photo, at, warp)?;
            let length = dot(&patch, &patch).sqrt();
            if length <= 0.0 {
                return None;
            }
            alike = dot(&patch, &self.patch) / (length * self.length);
            patch.iter_mut().zip(&self.patch).for_each(|(value, own)| *value = *value * self.length / length - own);
            let along = self.slopes.each_ref().map(|slope| f64::from(dot(&patch, slope)));
            let [x, y, xx, xy, yx, yy] = self.inverse.map(|row| row.iter().zip(along).map(|(a, b)| a * b).sum::<f64>());
            // The template would have to move this way, so the photo's patch moves back.
            let bend = DMat2::from_cols(DVec2::new(xx, yx), DVec2::new(xy, yy)) * (1.0 / REACH as f64);
            warp *= (DMat2::IDENTITY + bend).inverse();
            let by = DVec2::new(x, y);
            at -= warp * by;
            if by.length() < STILL {
                break;
            }
        }
        at.is_finite().then_some((at, alike))
    }
}

/// The inverse of a symmetric matrix; `None` unless it is positive definite.
fn inverted(mut matrix: [[f64; NUMBERS]; NUMBERS]) -> Option<[[f64; NUMBERS]; NUMBERS]> {
    let mut inverse: [[f64; NUMBERS]; NUMBERS] = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(i == j)));
    let (rows, right) = (matrix.as_flattened_mut(), inverse.as_flattened_mut());
    let sound = |_, pivot: f64| pivot.is_nan() || pivot > f64::EPSILON;
    dense::gauss_jordan(rows, right, NUMBERS, sound).then_some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_kernels::random::Stream;

    /// Smooth waves without a period in sight.
    fn waves(p: DVec2) -> f64 {
        let wave = |k: f64, turn: f64| (k * (p.x * turn.cos() + p.y * turn.sin()) + 3.0 * turn).sin();
        0.5 + 0.12 * (wave(0.45, 0.3) + wave(0.37, 1.4) + wave(0.61, 2.2) + wave(0.29, 2.9))
    }

    /// A photo of the waves; each pixel shows the waves at `map` of its center.
    fn photo(map: impl Fn(DVec2) -> DVec2, brightness: impl Fn(f64) -> f64) -> Gray {
        let (width, height) = (72, 64);
        let center = |i: usize| DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let byte = |i: usize| (255.0 * brightness(waves(map(center(i))))).round() as u8;
        Gray { values: (0..width * height).map(byte).collect(), size: [height, width] }
    }

    /// Promise of `keypoints_move_to_where_photos_agree`.
    #[test]
    fn what_was_moved_bent_and_lit_another_way_is_found() {
        let first = photo(|p| p, |v| v);
        let at = DVec2::new(34.3, 30.8);
        let template = Template::new(&first, at, DMat2::IDENTITY).unwrap();
        for seed in 0..20 {
            let draw = |k: u64| Stream::new(1, seed, "align").uniform::<f64>(k) - 0.5;
            let bend = DMat2::IDENTITY + DMat2::from_cols_array(&std::array::from_fn(|k| 0.3 * draw(k as u64)));
            let to = DVec2::new(36.0 + draw(4), 31.0 + draw(5));
            // The pixel `to` of the second photo shows the pixel `at` of the first.
            let second = photo(|p| at + bend * (p - to), |v| 0.05 + (0.7 + 0.5 * draw(6)) * v);
            let start = to + 2.0 * DVec2::new(draw(7), draw(8));
            let (found, alike) = template.aligned(&second, start, DMat2::IDENTITY).unwrap();
            assert!(found.distance(to) < 0.04 && alike > 0.99, "{seed}: {found} for {to}, {alike}");
        }
    }

    #[test]
    fn alignment_is_where_patches_are_most_alike() {
        let (first, second) = (photo(|p| p, |v| v), photo(|p| p + 0.4 * (p * 0.2).map(f64::sin), |v| v * v));
        let at = DVec2::new(30.0, 33.0);
        let template = Template::new(&first, at, DMat2::IDENTITY).unwrap();
        let alike = |at: DVec2| {
            let patch = sampled(&second, at, DMat2::IDENTITY).unwrap();
            dot(&patch, &template.patch) / (dot(&patch, &patch).sqrt() * template.length)
        };
        let (found, most) = template.aligned(&second, at, DMat2::IDENTITY).unwrap();
        let tried = (0..81 * 81).map(|i| at + 0.05 * (DVec2::new((i % 81) as f64, (i / 81) as f64) - 40.0));
        let best = tried.max_by(|a, b| alike(*a).total_cmp(&alike(*b))).unwrap();
        // The brute search does not bend.
        assert!(found.distance(best) < 0.2 && most >= alike(best), "{found} for {best}");
    }

    #[test]
    fn what_is_flat_or_reaches_out_is_no_template() {
        let waves = photo(|p| p, |v| v);
        for (photo, at) in [(photo(|p| p, |_| 0.5), DVec2::splat(32.0)), (waves.clone(), DVec2::new(5.4, 32.0))] {
            assert!(Template::new(&photo, at, DMat2::IDENTITY).is_none(), "{at}");
        }
        let template = Template::new(&waves, DVec2::splat(32.0), DMat2::IDENTITY).unwrap();
        assert!(template.aligned(&waves, DVec2::new(71.0, 32.0), DMat2::IDENTITY).is_none());
        assert!(template.aligned(&photo(|p| p, |_| 0.5), DVec2::splat(32.0), DMat2::IDENTITY).is_none());
    }
}
