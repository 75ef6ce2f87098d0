//! Separable linear resampling of maps `[planes, h, w]`: bilinear and bicubic resizing, box filters.
//!
//! A [`Resample`] lists, for every output row and column, the input rows and columns whose weighted sum it is, and the
//! transposed lists for the gradient. It is built once per size.

use crate::parallel::for_chunks;
use crate::target::{Target, put};
use crate::{Real, simd};
use std::ops::Range;

/// The weights along one axis: output i is the sum of `weight * input[index]` over `taps[ends[i]..ends[i + 1]]`.
#[derive(Clone, Debug)]
struct Axis<T> {
    inputs: usize,
    ends: Vec<usize>,
    taps: Vec<(usize, T)>,
}

impl<T: Real> Axis<T> {
    /// `taps(i)` lists the inputs of output i with their weights.
    fn new<I: IntoIterator<Item = (usize, f64)>>(inputs: usize, outputs: usize, taps: impl Fn(usize) -> I) -> Self {
        let mut axis = Self { inputs, ends: vec![0], taps: Vec::new() };
        for i in 0..outputs {
            axis.taps.extend(taps(i).into_iter().map(|(index, weight)| (index, T::from_f64(weight))));
            axis.ends.push(axis.taps.len());
        }
        axis
    }

    fn outputs(&self) -> usize {
        self.ends.len() - 1
    }

    fn taps(&self, i: usize) -> &[(usize, T)] {
        &self.taps[self.ends[i]..self.ends[i + 1]]
    }

    fn transposed(&self) -> Self {
        let mut lists = vec![Vec::new(); self.inputs];
        for i in 0..self.outputs() {
            for (index, weight) in self.taps(i) {
                lists[*index].push((i, weight.to_f64()));
            }
        }
        Self::new(self.outputs(), self.inputs, |i| lists[i].iter().copied())
    }

    /// Interpolation between the two nearest inputs.
    fn bilinear(inputs: usize, outputs: usize, align_corners: bool) -> Self {
        Self::new(inputs, outputs, |i| {
            let last = inputs as f64 - 1.0;
            let at = match (align_corners, outputs) {
                (true, 1) => 0.0,
                (true, _) => i as f64 * last / (outputs as f64 - 1.0),
                (false, _) => (i as f64 + 0.5) * inputs as f64 / outputs as f64 - 0.5,
            };
            let at = at.clamp(0.0, last);
            let low = at.floor();
            let high = (low + 1.0).min(last);
            [(low as usize, 1.0 - (at - low)), (high as usize, at - low)].into_iter().filter(|tap| tap.1 != 0.0)
        })
    }

    /// Keys' cubic kernel with a = -3/4 over the four nearest inputs; positions outside are clamped to the border.
    fn bicubic(inputs: usize, outputs: usize) -> Self {
        Self::new(inputs, outputs, |i| {
            let at = (i as f64 + 0.5) * inputs as f64 / outputs as f64 - 0.5;
            let nearest = at.floor() as isize - 1..at.floor() as isize + 3;
            nearest.map(move |j| (j.clamp(0, inputs as isize - 1) as usize, keys(at - j as f64, -0.75)))
        })
    }

    /// Keys' cubic kernel with a = -1/2, stretched when shrinking; weights outside are dropped and the others scaled to
    /// sum to 1.
    fn bicubic_antialiased(inputs: usize, outputs: usize) -> Self {
        Self::new(inputs, outputs, |i| {
            let scale = inputs as f64 / outputs as f64;
            let stretch = scale.max(1.0);
            let center = (i as f64 + 0.5) * scale;
            let from = (center - 2.0 * stretch + 0.5).max(0.0) as usize;
            let to = ((center + 2.0 * stretch + 0.5) as usize).min(inputs);
            let weight = move |j: usize| keys((j as f64 + 0.5 - center) / stretch, -0.5);
            let total: f64 = (from..to).map(weight).sum();
            (from..to).map(move |j| (j, weight(j) / total))
        })
    }

    /// The average of the inputs within a window of `width` around each position.
    fn box_filter(n: usize, width: usize) -> Self {
        Self::new(n, n, |i| {
            let inside: Range<usize> = i.saturating_sub(width / 2)..n.min(i + width / 2 + 1);
            let share = 1.0 / inside.len() as f64;
            inside.map(move |j| (j, share))
        })
    }
}

/// Keys' cubic convolution kernel (1981), whose slope at 1 is `a`.
fn keys(x: f64, a: f64) -> f64 {
    match x.abs() {
        x if x < 1.0 => ((a + 2.0) * x - (a + 3.0)) * x * x + 1.0,
        x if x < 2.0 => ((a * x - 5.0 * a) * x + 8.0 * a) * x - 4.0 * a,
        _ => 0.0,
    }
}

/// A linear resampling of maps of one size to maps of another.
///
/// ```
/// use weaver_kernels::resample::Resample;
/// let mut y = [0.0; 3];
/// Resample::bilinear([1, 2], [1, 3], true).forward(&[1.0, 3.0], &mut y);
/// assert_eq!(y, [1.0, 2.0, 3.0]);
/// ```
#[derive(Clone, Debug)]
pub struct Resample<T> {
    rows: Axis<T>,
    cols: Axis<T>,
    rows_back: Axis<T>,
    cols_back: Axis<T>,
}

impl<T: Real> Resample<T> {
    fn new(rows: Axis<T>, cols: Axis<T>) -> Self {
        let (rows_back, cols_back) = (rows.transposed(), cols.transposed());
        Self { rows, cols, rows_back, cols_back }
    }

    /// Bilinear resizing from one `[h, w]` to another.
    ///
    /// With `align_corners`, the centers of the corner pixels of input and output coincide; otherwise the corners of
    /// the images do, and border pixels are repeated.
    pub fn bilinear(from: [usize; 2], to: [usize; 2], align_corners: bool) -> Self {
        let axis = |i: usize| Axis::bilinear(from[i], to[i], align_corners);
        Self::new(axis(0), axis(1))
    }

    /// Bicubic resizing from one `[h, w]` to another, without `align_corners` and without antialiasing.
    ///
    /// Uses Keys' kernel with a = -3/4 over the four nearest pixels along each axis, however much the map shrinks;
    /// border pixels are repeated.
    pub fn bicubic(from: [usize; 2], to: [usize; 2]) -> Self {
        let axis = |i: usize| Axis::bicubic(from[i], to[i]);
        Self::new(axis(0), axis(1))
    }

    /// Antialiased bicubic resizing from one `[h, w]` to another, without `align_corners`.
    ///
    /// Uses Keys' kernel with a = -1/2, stretched by the scale when the map shrinks; pixels outside the image have no
    /// weight.
    pub fn bicubic_antialiased(from: [usize; 2], to: [usize; 2]) -> Self {
        let axis = |i: usize| Axis::bicubic_antialiased(from[i], to[i]);
        Self::new(axis(0), axis(1))
    }

    /// Box filter of odd `width` at stride 1 on maps of `size` `[h, w]`: the average over the part of the window inside
    /// the image.
    ///
    /// # Panics
    ///
    /// If `width` is even.
    pub fn box_filter(size: [usize; 2], width: usize) -> Self {
        assert_eq!(width % 2, 1, "box_filter: expected an odd width, found {width}");
        let [rows, cols] = size.map(|n| Axis::box_filter(n, width));
        Self::new(rows, cols)
    }

    /// Input size `[h, w]`.
    pub fn input_size(&self) -> [usize; 2] {
        [self.rows.inputs, self.cols.inputs]
    }

    /// Output size `[h, w]`.
    pub fn output_size(&self) -> [usize; 2] {
        [self.rows.outputs(), self.cols.outputs()]
    }

    /// Resamples `x` `[planes, h, w]` of the input size to `y` of the output size.
    ///
    /// # Panics
    ///
    /// If a length does not fit, or a map is empty.
    #[inline(never)]
    pub fn forward(&self, x: &[T], y: &mut [T]) {
        self.check(x.len(), y.len());
        let ([h, w], [out_h, out_w]) = (self.input_size(), self.output_size());
        for_chunks(y, out_h * out_w, |plane, y| {
            let x = &x[plane * h * w..][..h * w];
            T::with_scratch(h * out_w, |wide| {
                simd::dispatch(
                    #[inline(always)]
                    || {
                        across(&self.cols, x, (&mut *wide, T::ZERO));
                        down(&self.rows, wide, out_w, (y, T::ZERO));
                    },
                );
            });
        });
    }

    /// Gradient of [`Resample::forward`] with respect to its input: its adjoint applied to `dy`.
    ///
    /// # Panics
    ///
    /// If a length does not fit, or a map is empty.
    #[inline(never)]
    pub fn backward(&self, dy: &[T], dx: Target<T>) {
        let (dx, beta) = dx;
        self.check(dx.len(), dy.len());
        let ([h, w], [out_h, out_w]) = (self.input_size(), self.output_size());
        for_chunks(dx, h * w, |plane, dx| {
            let dy = &dy[plane * out_h * out_w..][..out_h * out_w];
            T::with_scratch(h * out_w, |wide| {
                simd::dispatch(
                    #[inline(always)]
                    || {
                        down(&self.rows_back, dy, out_w, (&mut *wide, T::ZERO));
                        across(&self.cols_back, wide, (dx, beta));
                    },
                );
            });
        });
    }

    fn check(&self, x: usize, y: usize) {
        let ([h, w], [out_h, out_w]) = (self.input_size(), self.output_size());
        assert!(h * w > 0 && out_h * out_w > 0, "resample: an empty map");
        assert!(
            x.is_multiple_of(h * w) && y == x / (h * w) * out_h * out_w,
            "resample: lengths {x} and {y} for {h} x {w} to {out_h} x {out_w}"
        );
    }
}

/// Applies `axis` within every row.
#[inline(always)]
fn across<T: Real>(axis: &Axis<T>, x: &[T], y: Target<T>) {
    let (y, beta) = y;
    for (x, y) in x.chunks_exact(axis.inputs).zip(y.chunks_exact_mut(axis.outputs())) {
        for (i, y) in y.iter_mut().enumerate() {
            let sum = match axis.taps(i) {
                // Bilinear resizing has two weights; without a loop it takes little more than half the time.
                [(j, w), (k, v)] => *w * x[*j] + *v * x[*k],
                taps => taps.iter().fold(T::ZERO, |sum, (j, w)| sum + *w * x[*j]),
            };
            put(y, beta, sum);
        }
    }
}

/// Applies `axis` to whole rows of length `w`.
#[inline(always)]
fn down<T: Real>(axis: &Axis<T>, x: &[T], w: usize, y: Target<T>) {
    let (y, beta) = y;
    for (i, y) in y.chunks_exact_mut(w).enumerate() {
        let mut beta = beta;
        for (j, weight) in axis.taps(i) {
            for (y, x) in y.iter_mut().zip(&x[j * w..][..w]) {
                put(y, beta, *weight * *x);
            }
            beta = T::ONE;
        }
        if axis.taps(i).is_empty() {
            y.iter_mut().for_each(|y| put(y, beta, T::ZERO));
        }
    }
}
