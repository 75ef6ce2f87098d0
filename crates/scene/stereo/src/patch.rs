//! What surrounds a pixel, and how like it is to a part of another photo.

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

/// The surroundings of a pixel: weights of the samples, which sum to 1, and those times the differences of their luma from its mean.
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

/// 1 - ZNCC of a patch and what another photo shows at `p + dx gx + dy gy` (homogeneous) for the samples' offsets: 0 where both are
/// alike, 1 where they have nothing in common, 2 where one is the other's negative.
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
    // Numbers so large that what is added to them is rounded to a whole, in the lowest bits.
    let (whole, integers) = (V::splat(1.5 * 8_388_608.0), V::splat(8_388_608.0));
    let (right, bottom) = (V::splat((width - 1) as f32), V::splat((height - 1) as f32));
    let (half, width) = (V::splat(0.5), V::splat(width as f32));
    let (mut mean, mut square, mut product) = (V::zero(), V::zero(), V::zero());
    for k in 0..2 {
        let [x, y, z] = [0, 1, 2].map(
            #[inline(always)]
            |i| offsets.x[k].mul_add(V::splat(gx[i]), offsets.y[k].mul_add(V::splat(gy[i]), V::splat(p[i]))),
        );
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
