//! The photometric loss and its gradient on a band of rows.
//!
//! Pixels are taken as rows of numbers: the next pixel of the same channel is three numbers away, so that filters along
//! x are sums of shifted rows, without taking channels apart. A row of windows needs eleven rows of pixels, and a row
//! of the gradient eleven rows of windows; both are kept in rings, which stay in the second-level cache.
//!
//! The moments of a window belong to the target b and the difference d = a - b, not to both images, as
//!
//! ```text
//! 1 - brightness = E[d]^2 / (E[a]^2 + E[b]^2 + C1)
//! 1 - structure  = D / (D + 2 C + C2),  D = E[d^2] - E[d]^2,  C = E[ab] - E[a] E[b]
//! ```
//!
//! have no cancellation where the images are nearly equal, which is where a fit ends.

use super::{BandSums, CHANNELS};
use crate::ssim_window::{BORDER, C1, C2, CENTER, WINDOW};
use std::ops::Range;
use weaver_kernels::Real;
use weaver_kernels::lanes::{self, LANES, LaneKernel, LaneMask, Lanes};

/// Numbers from the first to the last pixel of a window.
const REACH: usize = BORDER * CHANNELS;
/// Numbers that a vector of windows covers.
const SPAN: usize = REACH + LANES;
/// Numbers kept of a pixel: the difference and the target.
const PIXEL: usize = 2;
/// E[d], E[b], E[d^2] and E[ab].
const MOMENTS: usize = 4;
/// Parts of a pixel's derivative: one of its own, a multiple of the difference, a multiple of the target.
const MAPS: usize = 3;

/// A vector's numbers in memory, K kinds side by side.
type Kinds<T, const K: usize> = [[T; LANES]; K];

/// Vectors that hold a row of `line` numbers.
fn vectors(line: usize) -> usize {
    line.div_ceil(LANES)
}

/// Length of a row that is read by filters along x, which look beyond its last vector.
fn stride(line: usize) -> usize {
    (vectors(line) + REACH.div_ceil(LANES)) * LANES
}

/// Length of the scratch memory of a band whose rows have `line` numbers.
pub(super) fn workspace_len(line: usize) -> usize {
    (WINDOW * (PIXEL + MAPS) + 1) * vectors(line) * LANES + (MOMENTS + MAPS) * stride(line)
}

/// The loss on some rows of pixels, and on the windows that begin in them.
pub(super) struct Band<'a, T> {
    /// The whole images `[H, W, 3]`.
    pub image: &'a [T],
    pub target: &'a [T],
    /// (H, W).
    pub size: [usize; 2],
    /// The rows of the band.
    pub rows: Range<usize>,
    /// The window's weights, up to the middle one.
    pub taps: &'a [T; WINDOW / 2 + 1],
    /// The derivatives of the loss with respect to |d| of a pixel, and to 1 - SSIM of a window.
    pub slopes: [T; 2],
    /// The rows of the gradient.
    pub gradient: &'a mut [T],
    pub workspace: &'a mut [T],
}

/// The parts of a workspace.
struct Parts<'a, T> {
    /// The last eleven rows of pixels.
    pixels: &'a mut [Kinds<T, PIXEL>],
    /// The maps of the last eleven rows of windows, spread along x to the pixels.
    spread: &'a mut [Kinds<T, MAPS>],
    /// The means of a row of pixels over y, one moment after the other.
    moments: &'a mut [T],
    /// The maps of a row of windows, one after the other, each between zeros.
    maps: &'a mut [T],
    /// A row of the gradient.
    row: &'a mut [[T; LANES]],
}

impl<'a, T> Parts<'a, T> {
    fn new(line: usize, workspace: &'a mut [T]) -> Self {
        let (vectors, stride) = (vectors(line), stride(line));
        let (pixels, rest) = workspace.split_at_mut(WINDOW * PIXEL * vectors * LANES);
        let (spread, rest) = rest.split_at_mut(WINDOW * MAPS * vectors * LANES);
        let (row, rest) = rest.split_at_mut(vectors * LANES);
        let (moments, maps) = rest.split_at_mut(MOMENTS * stride);
        Self {
            pixels: pixels.as_chunks_mut().0.as_chunks_mut().0,
            spread: spread.as_chunks_mut().0.as_chunks_mut().0,
            moments,
            maps,
            row: row.as_chunks_mut().0,
        }
    }
}

/// The row of a ring where row `y` is.
#[inline(always)]
fn slot<T>(ring: &mut [T], vectors: usize, y: usize) -> &mut [T] {
    &mut ring[y % WINDOW * vectors..][..vectors]
}

/// The rows of a ring from row `y` on.
#[inline(always)]
fn ring_rows<T>(ring: &[T], vectors: usize, y: usize) -> [&[T]; WINDOW] {
    let mut rows = [&ring[..0]; WINDOW];
    for (k, row) in rows.iter_mut().enumerate() {
        *row = &ring[(y + k) % WINDOW * vectors..][..vectors];
    }
    rows
}

/// The K sums of `taps[k] x(k)`, by pairs of equal weight.
#[inline(always)]
#[expect(clippy::needless_range_loop, reason = "K sums in registers go side by side through three arrays")]
fn filter<V: Lanes, const K: usize>(taps: &[V; WINDOW / 2 + 1], x: impl Fn(usize) -> [V; K]) -> [V; K] {
    const MIDDLE: usize = WINDOW / 2;
    let mut sums = x(MIDDLE);
    for sum in &mut sums {
        *sum = *sum * taps[MIDDLE];
    }
    for k in 0..MIDDLE {
        let (before, after) = (x(k), x(BORDER - k));
        for i in 0..K {
            sums[i] = (before[i] + after[i]).mul_add(taps[k], sums[i]);
        }
    }
    sums
}

/// The K sums along x at vector `v` of rows that lie `stride` apart.
#[inline(always)]
fn filter_along<V: Lanes, const K: usize>(
    taps: &[V; WINDOW / 2 + 1],
    rows: &[V::Scalar],
    stride: usize,
    v: usize,
) -> [V; K] {
    let mut spans = [&rows[..0]; K];
    for (i, span) in spans.iter_mut().enumerate() {
        *span = &rows[i * stride + v * LANES..][..SPAN];
    }
    filter(
        taps,
        #[inline(always)]
        |k| {
            let mut x = [V::zero(); K];
            for i in 0..K {
                x[i] = V::load(spans[i][k * CHANNELS..].first_chunk().expect("inside of the span"));
            }
            x
        },
    )
}

/// The sum of a vector's lanes.
#[inline(always)]
fn total<V: Lanes>(x: V) -> f64 {
    x.to_array().iter().map(|x| x.to_f64()).sum()
}

impl<T: Real> LaneKernel<T> for Band<'_, T> {
    type Output = BandSums;

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) -> BandSums {
        let Self { image, target, size: [height, width], rows, taps, slopes, gradient, workspace } = self;
        let line = width * CHANNELS;
        let (vectors, stride, windows) = (vectors(line), stride(line), height - BORDER);
        let parts = Parts::new(line, workspace);
        let mut weights = [V::zero(); WINDOW / 2 + 1];
        for (weight, tap) in weights.iter_mut().zip(taps) {
            *weight = V::splat(*tap);
        }
        parts.moments.fill(T::ZERO);
        parts.maps.fill(T::ZERO);
        // Windows that begin above the image have no part in its first rows, nor those below the last row of windows.
        let first = rows.start.saturating_sub(BORDER);
        for y in first..first + BORDER {
            keep_pixels::<V>([image, target], line, y, parts.pixels);
        }
        if rows.start < BORDER {
            parts.spread.fill([[T::ZERO; LANES]; MAPS]);
        }
        let mut sums = BandSums::default();
        for y in first..rows.end {
            let spread = slot(parts.spread, vectors, y);
            if y < windows {
                keep_pixels::<V>([image, target], line, y + BORDER, parts.pixels);
                average_rows(&weights, ring_rows(parts.pixels, vectors, y), parts.moments, stride);
                let dissimilarity = compare(&weights, parts.moments, parts.maps, line, V::splat(slopes[1]));
                spread_row(&weights, parts.maps, stride, spread);
                if rows.contains(&y) {
                    sums.dissimilarity += dissimilarity;
                }
            } else {
                spread.fill([[T::ZERO; LANES]; MAPS]);
            }
            if rows.contains(&y) {
                let pixels = slot(parts.pixels, vectors, y);
                // The oldest row of windows is the one after `y` in the ring.
                let spread = ring_rows(parts.spread, vectors, y + 1);
                sums.absolute += collect(&weights, pixels, spread, V::splat(slopes[0]), parts.row);
                gradient[(y - rows.start) * line..][..line].copy_from_slice(&parts.row.as_flattened()[..line]);
            }
        }
        sums
    }
}

/// Takes row `y` of the pixels into the ring.
#[inline(always)]
fn keep_pixels<V: Lanes>(images: [&[V::Scalar]; 2], line: usize, y: usize, ring: &mut [Kinds<V::Scalar, PIXEL>]) {
    let [image, target] = images.map(
        #[inline(always)]
        |image| &image[y * line..][..line],
    );
    let center = V::constant(CENTER);
    for (v, [difference, centered]) in slot(ring, vectors(line), y).iter_mut().enumerate() {
        let (a, b) = (lanes::at::<V>(image, v * LANES), lanes::at::<V>(target, v * LANES));
        (a - b).store(difference);
        (b - center).store(centered);
    }
}

/// The moments of eleven rows of pixels, over y.
#[inline(always)]
fn average_rows<V: Lanes>(
    taps: &[V; WINDOW / 2 + 1],
    pixels: [&[Kinds<V::Scalar, PIXEL>]; WINDOW],
    moments: &mut [V::Scalar],
    stride: usize,
) {
    for v in 0..pixels[0].len() {
        let sums = filter(
            taps,
            #[inline(always)]
            |k| {
                let (d, b) = (V::load(&pixels[k][v][0]), V::load(&pixels[k][v][1]));
                [d, b, d * d, (d + b) * b]
            },
        );
        for (m, sum) in sums.into_iter().enumerate() {
            sum.store(moments[m * stride + v * LANES..].first_chunk_mut().expect("a whole vector"));
        }
    }
}

/// The maps of a row of windows, times `slope`, and the sum of 1 - SSIM.
#[inline(always)]
fn compare<V: Lanes>(
    taps: &[V; WINDOW / 2 + 1],
    moments: &[V::Scalar],
    maps: &mut [V::Scalar],
    line: usize,
    slope: V,
) -> f64 {
    let (stride, windows) = (stride(line), line - REACH);
    let (one, two, center) = (V::constant(1.0), V::constant(2.0), V::constant(CENTER));
    let (c1, c2) = (V::constant(C1), V::constant(C2));
    let slope = two * slope;
    let mut sum = V::zero();
    for v in 0..vectors(windows) {
        let inside = V::Mask::from_bits(u16::MAX >> LANES.saturating_sub(windows - v * LANES));
        let [d, b, dd, ab] = filter_along::<V, MOMENTS>(taps, moments, stride, v);
        let a = d + b;
        let (mean_a, mean_b) = (a + center, b + center);
        let brightness_scale = mean_a.mul_add(mean_a, mean_b.mul_add(mean_b, c1)).recip();
        let unlike_brightness = d * d * brightness_scale;
        let variance = d.neg_mul_add(d, dd);
        let structure_scale = two.mul_add(a.neg_mul_add(b, ab), variance + c2).recip();
        let unlike_structure = variance * structure_scale;
        let (brightness, structure) = (one - unlike_brightness, one - unlike_structure);
        sum = sum + brightness.mul_add(unlike_structure, unlike_brightness).only(inside);
        let common = slope * brightness * structure_scale;
        let by_difference = common * structure;
        let by_target = -(common * unlike_structure);
        let by_mean = slope * structure * brightness_scale * mean_a.neg_mul_add(unlike_brightness, d);
        let own = by_difference.neg_mul_add(d, by_target.neg_mul_add(b, by_mean));
        for (m, map) in [own, by_difference, by_target].into_iter().enumerate() {
            let to = &mut maps[m * stride + REACH + v * LANES..];
            map.only(inside).store(to.first_chunk_mut().expect("rows are longer than their last vector"));
        }
    }
    total(sum)
}

/// Spreads the maps of a row of windows along x.
#[inline(always)]
fn spread_row<V: Lanes>(
    taps: &[V; WINDOW / 2 + 1],
    maps: &[V::Scalar],
    stride: usize,
    to: &mut [Kinds<V::Scalar, MAPS>],
) {
    for (v, to) in to.iter_mut().enumerate() {
        let sums = filter_along::<V, MAPS>(taps, maps, stride, v);
        for (sum, to) in sums.into_iter().zip(to) {
            sum.store(to);
        }
    }
}

/// A row of the gradient from the maps of the windows that reach into it, and the sum of |d|.
#[inline(always)]
fn collect<V: Lanes>(
    taps: &[V; WINDOW / 2 + 1],
    pixels: &[Kinds<V::Scalar, PIXEL>],
    maps: [&[Kinds<V::Scalar, MAPS>]; WINDOW],
    slope: V,
    gradient: &mut [[V::Scalar; LANES]],
) -> f64 {
    let mut sum = V::zero();
    for v in 0..maps[0].len() {
        let [own, by_difference, by_target] = filter(
            taps,
            #[inline(always)]
            |k| {
                let [own, by_difference, by_target] = &maps[k][v];
                [V::load(own), V::load(by_difference), V::load(by_target)]
            },
        );
        let (d, b) = (V::load(&pixels[v][0]), V::load(&pixels[v][1]));
        sum = sum + d.abs();
        let sign = slope.only(d.gt(V::zero())) - slope.only(V::zero().gt(d));
        (by_difference.mul_add(d, by_target.mul_add(b, own)) + sign).store(&mut gradient[v]);
    }
    total(sum)
}
