//! Enlargement, blur and gradients of images, in lanes.

use super::{GRAIN, Image};
use weaver_kernels::lanes::{self, LANES, LaneKernel, Lanes};
use weaver_kernels::parallel::for_chunks;
use weaver_kernels::simd;

/// Radius of a Gaussian's window, in its deviations.
const REACH: f32 = 3.0;
/// The most pixels that a blur reaches to a side.
const FARTHEST: usize = 15;
/// Pixels that a spline reaches beyond the border.
const MARGIN: usize = 2;
/// Vectors of a step along a row: as many sums as hide each other's latency.
const VECTORS: usize = 4;

/// A photo enlarged by a whole factor, in `room`, by cubic splines through pixel centers (Keys, 1981).
pub fn enlarged<'a>(photo: Image<'a>, factor: usize, room: &'a mut [f32]) -> Image<'a> {
    if factor == 1 {
        return photo;
    }
    let width = photo.width * factor;
    let taps: Vec<(isize, [f32; 4])> = (0..factor).map(|i| spline(i, factor)).collect();
    for_chunks(room, factor * width, |y, rows| {
        let mut padded = vec![0.0; photo.width + 2 * MARGIN];
        let mut phases = vec![0.0; photo.width];
        for (row, (first, weights)) in rows.chunks_exact_mut(width).zip(&taps) {
            let line = |k: isize| {
                let y = y as isize + first + k;
                photo.row(y.clamp(0, photo.height as isize - 1) as usize)
            };
            let lines = [line(0), line(1), line(2), line(3)];
            lanes::run(Spline { lines, weights, out: &mut padded[MARGIN..][..photo.width] });
            extend(&mut padded, MARGIN);
            for (phase, (first, weights)) in taps.iter().enumerate() {
                let shifted = |k: usize| &padded[(MARGIN as isize + first) as usize + k..][..photo.width];
                let lines = [shifted(0), shifted(1), shifted(2), shifted(3)];
                lanes::run(Spline { lines, weights, out: &mut phases });
                row[phase..].iter_mut().step_by(factor).zip(&phases).for_each(|(to, from)| *to = *from);
            }
        }
    });
    Image { width, height: photo.height * factor, values: room }
}

/// The first pixel, relative to the pixel of the same number, and the weights of four pixels that give pixel `i` of
/// `factor` to a pixel.
fn spline(i: usize, factor: usize) -> (isize, [f32; 4]) {
    let at = (i as f32 + 0.5) / factor as f32 - 0.5;
    let t = at - at.floor();
    let weight = |d: f32| match d.abs() {
        d if d < 1.0 => (1.5 * d - 2.5) * d * d + 1.0,
        d => ((-0.5 * d + 2.5) * d - 4.0) * d + 2.0,
    };
    (at.floor() as isize - 1, std::array::from_fn(|k| weight(t + 1.0 - k as f32)))
}

/// Fills the margins of a row with its first and its last pixel.
#[inline(always)]
fn extend(padded: &mut [f32], margin: usize) {
    let end = padded.len() - margin;
    let (first, last) = (padded[margin], padded[end - 1]);
    padded[..margin].fill(first);
    padded[end..].fill(last);
}

/// A weighted sum of four rows.
struct Spline<'a> {
    lines: [&'a [f32]; 4],
    weights: &'a [f32; 4],
    out: &'a mut [f32],
}

impl LaneKernel<f32> for Spline<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lanes<Scalar = f32>>(self) {
        let weights = self.weights.map(V::splat);
        lanes::map(
            self.lines,
            self.out,
            #[inline(always)]
            |[a, b, c, d]: [V; 4], _| {
                let outer = a.mul_add(weights[0], d * weights[3]);
                b.mul_add(weights[1], c.mul_add(weights[2], outer))
            },
        );
    }
}

/// An image blurred by a Gaussian of this deviation, into `out`; beyond the border lies its last pixel.
pub fn blur(image: Image, sigma: f32, out: &mut [f32]) {
    let width = image.width;
    let radius = (REACH * sigma).ceil().max(1.0) as usize;
    let mut taps: Vec<f32> = (0..=radius).map(|i| (-0.5 * (i as f32 / sigma).powi(2)).exp()).collect();
    let sum = taps[0] + 2.0 * taps[1..].iter().sum::<f32>();
    taps.iter_mut().for_each(|t| *t /= sum);
    for_chunks(out, GRAIN * width, |chunk, out| {
        // Down first, then across while the row is in the cache.
        let mut padded = vec![0.0; width + 2 * radius];
        for (i, out) in out.chunks_exact_mut(width).enumerate() {
            let y = chunk * GRAIN + i;
            let pair = |d: usize| [image.row(y.saturating_sub(d)), image.row((y + d).min(image.height - 1))];
            lanes::run(Symmetric { taps: &taps, pairs: pairs(&taps, pair), out: &mut padded[radius..][..width] });
            extend(&mut padded, radius);
            let pair = |d: usize| [&padded[radius - d..][..width], &padded[radius + d..][..width]];
            lanes::run(Symmetric { taps: &taps, pairs: pairs(&taps, pair), out });
        }
    });
}

/// The neighbors to both sides at distances up to the last tap's; at distance 0, the pixel itself.
#[inline(always)]
fn pairs<'a>(taps: &[f32], pair: impl Fn(usize) -> [&'a [f32]; 2]) -> [[&'a [f32]; 2]; FARTHEST + 1] {
    let mut pairs = [[&[][..]; 2]; FARTHEST + 1];
    pairs[..taps.len()].iter_mut().enumerate().for_each(|(d, to)| *to = pair(d));
    pairs
}

/// A row weighted with its neighbors on both sides: out = t_0 x_0 + sum t_d (x_-d + x_d).
struct Symmetric<'a> {
    taps: &'a [f32],
    pairs: [[&'a [f32]; 2]; FARTHEST + 1],
    out: &'a mut [f32],
}

impl LaneKernel<f32> for Symmetric<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Lanes<Scalar = f32>>(self) {
        const STEP: usize = VECTORS * LANES;
        let width = self.out.len();
        let mut x = 0;
        while x + STEP <= width {
            let sums = self.sums::<V, VECTORS>(x);
            self.out[x..x + STEP].copy_from_slice(sums.as_flattened());
            x += STEP;
        }
        if x < width && width >= STEP {
            // The last step ends with the row, and does some pixels again.
            x = width - STEP;
            let sums = self.sums::<V, VECTORS>(x);
            self.out[x..].copy_from_slice(sums.as_flattened());
        } else {
            for x in x..width {
                let sides = self.taps.iter().zip(&self.pairs).skip(1);
                let sides = sides.map(|(tap, [a, b])| (a[x] + b[x]) * tap);
                self.out[x] = self.pairs[0][0][x] * self.taps[0] + sides.sum::<f32>();
            }
        }
    }
}

impl Symmetric<'_> {
    /// The sums of some vectors from `x` on.
    #[inline(always)]
    fn sums<V: Lanes<Scalar = f32>, const N: usize>(&self, x: usize) -> [[f32; LANES]; N] {
        let mut sums = [V::zero(); N];
        let [center, _] = self.pairs[0];
        let (center, tap) = (vectors::<N>(center, x), V::splat(self.taps[0]));
        for k in 0..N {
            sums[k] = V::load(&center[k]) * tap;
        }
        for (tap, [a, b]) in self.taps.iter().zip(&self.pairs).skip(1) {
            let (a, b, tap) = (vectors::<N>(a, x), vectors::<N>(b, x), V::splat(*tap));
            for k in 0..N {
                sums[k] = (V::load(&a[k]) + V::load(&b[k])).mul_add(tap, sums[k]);
            }
        }
        let mut out = [[0.0; LANES]; N];
        for k in 0..N {
            sums[k].store(&mut out[k]);
        }
        out
    }
}

/// Some vectors of a row.
#[inline(always)]
fn vectors<const N: usize>(row: &[f32], x: usize) -> &[[f32; LANES]] {
    &row[x..x + N * LANES].as_chunks::<LANES>().0[..N]
}

/// Twice the gradients of the middle one of three rows: across and down.
pub fn gradients([above, here, below]: [&[f32]; 3], out: &mut [[f32; 2]]) {
    let last = out.len() - 1;
    simd::dispatch(
        #[inline(always)]
        || {
            let across = here[2..].iter().zip(here);
            let down = below[1..].iter().zip(&above[1..]);
            for (to, ((right, left), (below, above))) in out[1..last].iter_mut().zip(across.zip(down)) {
                *to = [right - left, below - above];
            }
        },
    );
    for (x, left, right) in [(0, 0, 1), (last, last - 1, last)] {
        out[x] = [here[right] - here[left], below[x] - above[x]];
    }
}
