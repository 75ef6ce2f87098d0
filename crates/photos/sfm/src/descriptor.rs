//! Descriptors of keypoints: directions and histograms of gradients of their surroundings.

use crate::scale_space::Gradients;
use std::f32::consts::{FRAC_PI_2, PI, TAU};
use std::sync::LazyLock;
use weaver_geometry::glam::{Vec2, Vec4};
use weaver_kernels::lanes::{self, LANES, LaneKernel, LaneMask, Lanes};

/// Numbers of a descriptor: 4 x 4 cells of 8 directions.
pub const DESCRIPTOR: usize = CELLS * CELLS * DIRECTIONS;
/// Length of a descriptor up to rounding: with half a unit of error in each number, its square stays below 2^16.
pub(crate) const LENGTH: f32 = 250.0;
/// Largest number of a descriptor.
const LARGEST: f32 = 127.0;
/// Bins of the histogram that directions are read from.
const BINS: usize = 36;
/// Deviations of its window over the keypoint's, and its radius over those.
const WINDOW: f32 = 1.5;
const RADIUS: f32 = 3.0;
/// Peaks that are this part of the largest give a direction too.
const PEAK: f32 = 0.8;
/// Cells to a side of a descriptor, directions of a cell, and width of a cell over the keypoint's deviation.
const CELLS: usize = 4;
const DIRECTIONS: usize = 8;
const CELL: f32 = 3.2;
/// Largest part of a descriptor's length that the square of one number may have, which limits the effect of glare.
const GLARE: f32 = 0.2;
/// Samples to a side of a patch, as many as lanes: less than the keypoint's deviation apart, so that a blurred image
/// has nothing in between.
const SIDE: usize = LANES;
/// Cells across a patch of a descriptor: half a cell beyond the outer ones still counts for them.
const ACROSS: f32 = CELLS as f32 + 1.0;

/// Place of a keypoint in an image, pixels, and the deviation that it was found with.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub at: Vec2,
    pub sigma: f32,
}

/// Weights of the samples of a patch along a side.
struct Windows {
    /// The window of the histogram that directions are read from.
    direction: [f32; SIDE],
    /// The part of each row of cells, falling off from its middle to the next ones', times the window of descriptors.
    cells: [[f32; SIDE]; CELLS],
}

static WINDOWS: LazyLock<Windows> = LazyLock::new(|| {
    // From -1 to 1.
    let at = |i: usize| (2 * i + 1) as f32 / SIDE as f32 - 1.0;
    let half = 0.5 * CELLS as f32;
    let cell = |c: usize, i: usize| {
        let u = at(i) * 0.5 * ACROSS;
        let off = u - (c as f32 + 0.5 - half);
        (1.0 - off.abs()).max(0.0) * (-0.5 * u * u / (half * half)).exp()
    };
    Windows {
        direction: std::array::from_fn(|i| (-0.5 * (RADIUS * at(i)).powi(2)).exp()),
        cells: std::array::from_fn(|c| std::array::from_fn(|i| cell(c, i))),
    }
});

/// Gradients in a square grid around a keypoint, between pixels, row by row.
struct Patch<V> {
    across: [V; SIDE],
    down: [V; SIDE],
}

impl<V: Lanes<Scalar = f32>> Patch<V> {
    /// Samples `step` apart, pixels, along axes that are turned; beyond the border lie its gradients.
    #[inline(always)]
    fn new(image: &Gradients, at: Vec2, step: Vec2) -> Self {
        // Adding it leaves no room for fractions, which rounds to the nearest whole number.
        const WHOLE: f32 = 8_388_608.0;
        let (mut across, mut down) = ([V::zero(); SIDE], [V::zero(); SIDE]);
        let middle = 0.5 * (SIDE as f32 - 1.0);
        let lane = V::from_fn(
            #[inline(always)]
            |i| i as f32 - middle,
        );
        let [right, bottom] = [image.width - 2, image.height - 2].map(|last| V::splat(last as f32 + 0.9999));
        let (zero, half, whole) = (V::zero(), V::splat(0.5), V::splat(WHOLE));
        for (row, (across, down)) in across.iter_mut().zip(&mut down).enumerate() {
            let off = row as f32 - middle;
            let x = lane.mul_add(V::splat(step.x), V::splat(at.x - off * step.y));
            let y = lane.mul_add(V::splat(step.y), V::splat(at.y + off * step.x));
            let inside = x.ge(zero).and(right.ge(x)).and(y.ge(zero)).and(bottom.ge(y));
            let (x, y) = (x.max(zero).min(right), y.max(zero).min(bottom));
            // Rounding half a pixel less may leave a whole pixel between them: the same place.
            let (left, top) = (((x - half) + whole) - whole, ((y - half) + whole) - whole);
            let (left, top) = (left.max(zero), top.max(zero));
            let start = top.mul_add(V::splat(image.width as f32), left).to_array();
            let (x, y) = ((x - left).to_array(), (y - top).to_array());
            let (mut a, mut b) = ([0.0; SIDE], [0.0; SIDE]);
            for i in 0..SIDE {
                let start = start[i] as usize;
                let two = |start: usize| Vec4::from_slice(image.values[start..start + 2].as_flattened());
                let (above, below) = (two(start), two(start + image.width));
                let between = above + (below - above) * y[i];
                let between = between + (Vec4::new(between.z, between.w, between.z, between.w) - between) * x[i];
                (a[i], b[i]) = (between.x, between.y);
            }
            (*across, *down) = (V::load(&a).only(inside), V::load(&b).only(inside));
        }
        Self { across, down }
    }
}

/// The size of a vector and its direction, from 0 to `turn` for a whole turn, within 2e-5 of it.
///
/// Source: Hastings, Approximations for digital computers, 1955, for the arc tangent.
#[inline(always)]
fn polar<V: Lanes<Scalar = f32>>(x: V, y: V, turn: f32) -> (V, V) {
    let (a, b) = (x.abs(), y.abs());
    let most = a.max(b).max(V::splat(1e-20));
    let t = a.min(b) * most.recip();
    let square = t * t;
    let series = [0.020_835_1, -0.085_133, 0.180_141, -0.330_299_5, 0.999_866];
    let mut angle = V::splat(series[0]);
    for term in &series[1..] {
        angle = angle.mul_add(square, V::splat(*term));
    }
    angle = angle * t;
    angle = (V::splat(FRAC_PI_2) - angle).or(b.gt(a), angle);
    angle = (V::splat(PI) - angle).or(V::zero().gt(x), angle);
    angle = (V::splat(TAU) - angle).or(V::zero().gt(y), angle);
    (x.mul_add(x, y * y).sqrt(), angle * V::splat(turn / TAU))
}

/// The histogram of directions around a keypoint.
struct Directions<'a>(&'a Gradients, Place);

impl LaneKernel<f32> for Directions<'_> {
    type Output = [f32; BINS];
    #[inline(always)]
    fn run<V: Lanes<Scalar = f32>>(self) -> [f32; BINS] {
        let Self(image, Place { at, sigma }) = self;
        let step = 2.0 * RADIUS * WINDOW * sigma / SIDE as f32;
        let patch = Patch::<V>::new(image, at, Vec2::new(step, 0.0));
        let window = &WINDOWS.direction;
        let columns = V::load(window);
        // Two histograms by turns: sums do not wait for one another. The last bin is the first again.
        let mut raw = [[0.0; BINS + 1]; 2];
        for ((across, down), weight) in patch.across.into_iter().zip(patch.down).zip(window) {
            let (size, angle) = polar(across, down, BINS as f32);
            let size = (size * columns * V::splat(*weight)).to_array();
            let bin = (angle + V::splat(0.5)).to_array();
            for i in 0..SIDE {
                raw[i % 2][(bin[i] as usize).min(BINS)] += size[i];
            }
        }
        let mut sums: [f32; BINS] = std::array::from_fn(|i| raw[0][i] + raw[1][i]);
        sums[0] += raw[0][BINS] + raw[1][BINS];
        sums
    }
}

/// Directions of a keypoint: the peaks of the histogram of gradients around it.
pub(crate) fn orientations(image: &Gradients, place: Place) -> impl Iterator<Item = f32> {
    let raw = lanes::run(Directions(image, place));
    let at = |i: usize, by: usize| raw[(i + BINS + by - 2) % BINS];
    let smooth: [f32; BINS] =
        std::array::from_fn(|i| (at(i, 0) + at(i, 4)) / 16.0 + (at(i, 1) + at(i, 3)) / 4.0 + at(i, 2) * 0.375);
    let most = smooth.iter().copied().fold(0.0, f32::max);
    (0..BINS).filter_map(move |i| {
        let (before, here, after) = (smooth[(i + BINS - 1) % BINS], smooth[i], smooth[(i + 1) % BINS]);
        let high = here > before && here > after && here >= PEAK * most;
        high.then(|| (i as f32 + 0.5 * (before - after) / (before - 2.0 * here + after)) / BINS as f32 * TAU)
    })
}

/// The histograms of the cells of a keypoint that is turned by an angle.
struct Cells<'a>(&'a Gradients, Place, f32);

impl LaneKernel<f32> for Cells<'_> {
    type Output = [u8; DESCRIPTOR];
    #[inline(always)]
    fn run<V: Lanes<Scalar = f32>>(self) -> [u8; DESCRIPTOR] {
        let Self(image, Place { at, sigma }, angle) = self;
        let axis = Vec2::from_angle(angle);
        let patch = Patch::<V>::new(image, at, axis * (ACROSS * CELL * sigma / SIDE as f32));
        let window = &WINDOWS.cells;
        let (sin, cos) = (V::splat(axis.y), V::splat(axis.x));
        // Sums down each column of samples, for each row of cells.
        let mut sums = [[V::zero(); DIRECTIONS]; CELLS];
        for row in 0..SIDE {
            let (x, y) = (patch.across[row], patch.down[row]);
            let (along, off) = (x.mul_add(cos, y * sin), y.mul_add(cos, -(x * sin)));
            let (size, turned) = polar(along, off, DIRECTIONS as f32);
            let parts: [V; DIRECTIONS] = shares(size, turned);
            for (sums, window) in sums.iter_mut().zip(window) {
                if window[row] > 0.0 {
                    let weight = V::splat(window[row]);
                    for (sum, part) in sums.iter_mut().zip(parts) {
                        *sum = part.mul_add(weight, *sum);
                    }
                }
            }
        }
        let mut histogram = [0.0; DESCRIPTOR];
        let columns = window.map(|w| V::load(&w));
        for (sums, out) in sums.iter().zip(histogram.as_chunks_mut::<{ CELLS * DIRECTIONS }>().0) {
            for (columns, out) in columns.as_chunks::<2>().0.iter().zip(out.as_chunks_mut::<LANES>().0) {
                let mut products = [V::zero(); LANES];
                for (i, product) in products.iter_mut().enumerate() {
                    *product = sums[i % DIRECTIONS] * columns[i / DIRECTIONS];
                }
                V::sums(&products).store(out);
            }
        }
        rounded::<V>(&histogram)
    }
}

/// Share of each direction in a gradient's size: all where it points, none at the next ones.
#[inline(always)]
fn shares<V: Lanes<Scalar = f32>>(size: V, turned: V) -> [V; DIRECTIONS] {
    let mut parts = [V::zero(); DIRECTIONS];
    for (d, part) in parts.iter_mut().enumerate() {
        let off = (turned - V::splat(d as f32)).abs();
        let off = if d == 0 { off.min(V::splat(DIRECTIONS as f32) - off) } else { off };
        *part = (V::splat(1.0) - off).max(V::zero()) * size;
    }
    parts
}

/// The square roots of a histogram that is cut off and normalized, in whole numbers.
#[inline(always)]
fn rounded<V: Lanes<Scalar = f32>>(histogram: &[f32; DESCRIPTOR]) -> [u8; DESCRIPTOR] {
    let vectors = histogram.as_chunks::<LANES>().0;
    let mut squares = V::zero();
    for v in vectors {
        squares = V::load(v).mul_add(V::load(v), squares);
    }
    let most = V::splat(GLARE * squares.to_array().iter().sum::<f32>().sqrt());
    let mut sum = V::zero();
    for v in vectors {
        sum = sum + V::load(v).min(most);
    }
    let scale = V::splat(LENGTH * LENGTH / sum.to_array().iter().sum::<f32>().max(f32::MIN_POSITIVE));
    let mut out = [0; DESCRIPTOR];
    for (from, to) in vectors.iter().zip(out.as_chunks_mut::<LANES>().0) {
        let root = (V::load(from).min(most) * scale).sqrt().min(V::splat(LARGEST)) + V::splat(0.5);
        to.iter_mut().zip(root.to_array()).for_each(|(to, root)| *to = root as u8);
    }
    out
}

/// Histograms of gradients in 4 x 4 cells, turned with the keypoint; the square roots of the normalized numbers, whose
/// length is [`LENGTH`].
pub(crate) fn describe(image: &Gradients, place: Place, angle: f32) -> [u8; DESCRIPTOR] {
    lanes::run(Cells(image, place, angle))
}
