//! The patch around a pixel, and its similarity to a part of another photo.

use crate::picture::Picture;
use weaver_kernels::lanes::{LANES, Lanes};

/// Samples of a patch: every second pixel of a square of nine, and some between them.
pub(crate) const SAMPLES: usize = 2 * LANES;
const OFFSETS: [[i8; 2]; SAMPLES] = offsets();
/// Standard deviation of the weights by distance, pixels, and by luma.
const NEAR: f32 = 3.5;
const ALIKE: f32 = 0.15 * 255.0;
/// Variance of luma that is taken for noise: a plain wall is like nothing.
const NOISE: f32 = 2.0;

const fn offsets() -> [[i8; 2]; SAMPLES] {
    let mut all = [[0; 2]; SAMPLES];
    let mut n = 0;
    while n < 25 {
        all[n] = [(n % 5) as i8 * 2 - 4, (n / 5) as i8 * 2 - 4];
        n += 1;
    }
    let rest = [[-1, -1], [1, -1], [-1, 1], [1, 1], [3, 0], [-3, 0], [0, 3]];
    while n < SAMPLES {
        all[n] = rest[n - 25];
        n += 1;
    }
    all
}

/// The offsets of the samples.
#[derive(Clone, Copy)]
pub(crate) struct Offsets<V> {
    x: [V; 2],
    y: [V; 2],
}

impl<V: Lanes<Scalar = f32>> Offsets<V> {
    #[inline(always)]
    pub fn new() -> Self {
        let half = |k: usize, axis: usize| V::from_fn(|lane| f32::from(OFFSETS[k * LANES + lane][axis]));
        Self { x: [half(0, 0), half(1, 0)], y: [half(0, 1), half(1, 1)] }
    }
}

/// The surroundings of a pixel: weights of the samples, which sum to 1, and those times the differences of their luma
/// from its mean.
#[derive(Clone, Debug)]
pub(crate) struct Patch {
    weights: [[f32; LANES]; 2],
    centered: [[f32; LANES]; 2],
    variance: f32,
}

/// The patches of all pixels of a picture.
pub(crate) fn patches(picture: &Picture) -> Vec<Patch> {
    let (width, height) = (picture.camera.width, picture.camera.height);
    let gauss = |x: f32, deviation: f32| (-0.5 * (x / deviation).powi(2)).exp();
    let near = OFFSETS.map(|[x, y]| gauss((f32::from(x).powi(2) + f32::from(y).powi(2)).sqrt(), NEAR));
    let alike: Vec<f32> = (0..256).map(|difference| gauss(difference as f32, ALIKE)).collect();
    let patch = |at: usize| {
        let (x, y) = ((at % width) as isize, (at / width) as isize);
        let middle = picture.gray[at];
        let mut luma = [0.0; SAMPLES];
        let mut weights = [0.0; SAMPLES];
        for (n, [dx, dy]) in OFFSETS.iter().enumerate() {
            let (x, y) = (x + *dx as isize, y + *dy as isize);
            if x >= 0 && y >= 0 && x < width as isize && y < height as isize {
                let value = picture.gray[y as usize * width + x as usize];
                luma[n] = f32::from(value);
                weights[n] = near[n] * alike[usize::from(value.abs_diff(middle))];
            }
        }
        // The pixel itself always counts.
        let all: f32 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= all);
        let mean: f32 = weights.iter().zip(&luma).map(|(w, x)| w * x).sum();
        let centered: [f32; SAMPLES] = std::array::from_fn(|n| weights[n] * (luma[n] - mean));
        let variance = centered.iter().zip(&luma).map(|(c, x)| c * (x - mean)).sum();
        let halves = |all: [f32; SAMPLES]| std::array::from_fn(|k| std::array::from_fn(|lane| all[k * LANES + lane]));
        Patch { weights: halves(weights), centered: halves(centered), variance }
    };
    (0..width * height).map(patch).collect()
}

/// 1 - ZNCC between a patch and another photo at `p + dx gx + dy gy` (homogeneous) for the samples' offsets: 0 where
/// both are alike, 1 where they have nothing in common, 2 where one is the other's negative.
///
/// Samples outside repeat the border.
#[inline(always)]
pub(crate) fn dissimilarity<V: Lanes<Scalar = f32>>(
    patch: &Patch,
    offsets: &Offsets<V>,
    [p, gx, gy]: [[f32; 3]; 3],
    other: &Picture,
) -> f32 {
    let (width, height) = (other.camera.width, other.camera.height);
    // Numbers so large that an addend is rounded to a whole, in the lowest bits.
    let (whole, integers) = (V::splat(1.5 * 8_388_608.0), V::splat(8_388_608.0));
    let (right, bottom) = (V::splat((width - 1) as f32), V::splat((height - 1) as f32));
    let (half, width) = (V::splat(0.5), V::splat(width as f32));
    let (mut mean, mut square, mut product) = (V::zero(), V::zero(), V::zero());
    for k in 0..2 {
        // Not `map`, which would be a call of a function without these instructions.
        let mut place = [V::zero(); 3];
        for i in 0..3 {
            place[i] = offsets.x[k].mul_add(V::splat(gx[i]), offsets.y[k].mul_add(V::splat(gy[i]), V::splat(p[i])));
        }
        let [x, y, z] = place;
        let scale = z.recip();
        let x = (x * scale - half).max(V::zero()).min(right);
        let y = (y * scale - half).max(V::zero()).min(bottom);
        // The lower of the two neighbors; of a whole number, either that or the one before, with a part of one.
        let (ix, iy) = ((x - half + whole) - whole, (y - half + whole) - whole);
        let (fx, fy) = (x - ix, y - iy);
        let index = (iy.mul_add(width, ix) + integers).to_array();
        let mut quads = [0; LANES];
        for lane in 0..LANES {
            quads[lane] = other.quads[usize::from(index[lane].to_bits() as u16)];
        }
        let [a, b, c, d] = [bytes::<V>(&quads, 0), bytes(&quads, 8), bytes(&quads, 16), bytes(&quads, 24)];
        let upper = (b - a).mul_add(fx, a);
        let lower = (d - c).mul_add(fx, c);
        let value = (lower - upper).mul_add(fy, upper);
        let weighted = value * V::load(&patch.weights[k]);
        mean = mean + weighted;
        square = weighted.mul_add(value, square);
        product = value.mul_add(V::load(&patch.centered[k]), product);
    }
    let (mean, square, product) = (sum(mean), sum(square), sum(product));
    let variance = (square - mean * mean).max(0.0);
    1.0 - product / ((variance + NOISE) * (patch.variance + NOISE)).sqrt()
}

/// One byte of each number.
#[inline(always)]
fn bytes<V: Lanes<Scalar = f32>>(of: &[u32; LANES], shift: u32) -> V {
    let mut values = [0.0; LANES];
    for lane in 0..LANES {
        values[lane] = ((of[lane] >> shift) & 255) as i32 as f32;
    }
    V::load(&values)
}

/// The sum of the lanes, in halves.
#[inline(always)]
fn sum<V: Lanes<Scalar = f32>>(x: V) -> f32 {
    let mut x = x.to_array();
    for half in [8, 4, 2, 1] {
        for lane in 0..half {
            x[lane] += x[lane + half];
        }
    }
    x[0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::{Camera, Intrinsics, Pose};
    use weaver_kernels::lanes::{LaneKernel, run_at};
    use weaver_kernels::random::Stream;
    use weaver_kernels::simd::{Level, levels};
    use weaver_scene::Photo;

    const SIZE: [usize; 2] = [24, 17];

    fn noise(seed: u64) -> Picture {
        let [width, height] = SIZE;
        let stream = Stream::new(seed, 0, "noise");
        let rgb = (0..(width * height) as u64).flat_map(|n| [(stream.uniform::<f64>(n) * 255.0) as u8; 3]).collect();
        let intrinsics = Intrinsics { fx: 20.0, fy: 20.0, cx: 12.0, cy: 8.0 };
        let camera = Camera { pose: Pose::IDENTITY, intrinsics, width, height };
        Picture::of(&Photo { name: String::new(), camera, rgb, mask: None, lens: None }, 200)
    }

    struct One<'a>(&'a Patch, [[f32; 3]; 3], &'a Picture);

    impl LaneKernel<f32> for One<'_> {
        type Output = f32;

        #[inline(always)]
        fn run<V: Lanes<Scalar = f32>>(self) -> f32 {
            dissimilarity(self.0, &Offsets::<V>::new(), self.1, self.2)
        }
    }

    /// The same sample by sample, in `f64`, straight from the pixels.
    fn slowly(picture: &Picture, at: usize, warp: [[f32; 3]; 3], other: &Picture) -> f64 {
        let [width, height] = SIZE;
        let (x, y) = ((at % width) as i64, (at / width) as i64);
        let luma = |picture: &Picture, x: i64, y: i64| {
            f64::from(
                picture.gray[(y.clamp(0, height as i64 - 1) as usize) * width + x.clamp(0, width as i64 - 1) as usize],
            )
        };
        let middle = luma(picture, x, y);
        let mut samples = Vec::new();
        for [dx, dy] in OFFSETS {
            let (sx, sy) = (x + i64::from(dx), y + i64::from(dy));
            if sx < 0 || sy < 0 || sx >= width as i64 || sy >= height as i64 {
                continue;
            }
            let own = luma(picture, sx, sy);
            let far = f64::from(dx).powi(2) + f64::from(dy).powi(2);
            let weight = (-far / (2.0 * 3.5 * 3.5) - (own - middle).powi(2) / (2.0 * 38.25 * 38.25)).exp();
            let [p, gx, gy] = warp;
            let place =
                |i: usize| f64::from(p[i]) + f64::from(gx[i]) * f64::from(dx) + f64::from(gy[i]) * f64::from(dy);
            let u = (place(0) / place(2) - 0.5).clamp(0.0, width as f64 - 1.0);
            let v = (place(1) / place(2) - 0.5).clamp(0.0, height as f64 - 1.0);
            let (ix, iy) = (u.floor() as i64, v.floor() as i64);
            let (fx, fy) = (u - u.floor(), v - v.floor());
            let row = |y: i64| luma(other, ix, y) * (1.0 - fx) + luma(other, ix + 1, y) * fx;
            samples.push((weight, own, row(iy) * (1.0 - fy) + row(iy + 1) * fy));
        }
        let all: f64 = samples.iter().map(|s| s.0).sum();
        let mean = |of: &dyn Fn(&(f64, f64, f64)) -> f64| samples.iter().map(|s| s.0 * of(s)).sum::<f64>() / all;
        let (a, b) = (mean(&|s| s.1), mean(&|s| s.2));
        let covariance = mean(&|s| (s.1 - a) * (s.2 - b));
        let (aa, bb) = (mean(&|s| (s.1 - a).powi(2)), mean(&|s| (s.2 - b).powi(2)));
        1.0 - covariance / ((aa + 2.0) * (bb + 2.0)).sqrt()
    }

    /// All instruction sets compute the same as the slow version, in the middle, at borders and beyond them.
    #[test]
    fn lanes_agree_with_the_slow_version() {
        let (picture, other) = (noise(1), noise(2));
        let all = patches(&picture);
        let stream = Stream::new(7, 0, "warps");
        for n in 0..200 {
            let random = |k: u64| 2.0 * stream.uniform::<f32>(16 * n + k) - 1.0;
            let at = stream.below(16 * n + 15, SIZE[0] * SIZE[1]);
            let z = 1.0 + 0.2 * random(0);
            let warp = [
                [z * (12.0 + 14.0 * random(1)), z * (8.0 + 10.0 * random(2)), z],
                [1.0 + 0.3 * random(3), 0.3 * random(4), 0.01 * random(5)],
                [0.3 * random(6), 1.0 + 0.3 * random(7), 0.01 * random(8)],
            ];
            let expected = slowly(&picture, at, warp, &other);
            for level in levels() {
                let found = f64::from(run_at(level, One(&all[at], warp, &other)));
                assert!((found - expected).abs() < 2e-3, "{level:?}, pixel {at}: {found} and {expected}");
            }
        }
    }

    /// A picture is like itself, and unlike its negative.
    #[test]
    fn a_picture_is_like_itself() {
        let picture = noise(3);
        let at = 8 * SIZE[0] + 12;
        let warp = [[12.5, 8.5, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let all = patches(&picture);
        let own = run_at(Level::Portable, One(&all[at], warp, &picture));
        assert!(own.abs() < 0.01, "{own}");
        let mut negative = noise(3);
        negative.quads.iter_mut().for_each(|quad| *quad = !*quad);
        assert!((run_at(Level::Portable, One(&all[at], warp, &negative)) - 2.0).abs() < 0.01);
    }
}
