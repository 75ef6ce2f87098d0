//! Structural similarity of one image plane, and its gradient: the kernel behind the loss and the metric.

use weaver_kernels::Real;
use weaver_kernels::simd;

/// Width of the Gaussian window.
pub(crate) const WINDOW: usize = 11;
/// By how much there are fewer windows than pixels along an axis.
pub(crate) const BORDER: usize = WINDOW - 1;
const SIGMA: f64 = 1.5;
/// (0.01 L)^2 and (0.03 L)^2 for images in [0, 1].
pub(crate) const C1: f64 = 1e-4;
pub(crate) const C2: f64 = 9e-4;
/// Subtracted from the images before squaring, which leaves variances unchanged and reduces their rounding errors.
pub(crate) const CENTER: f64 = 0.5;

/// Normalization of variances and covariances in a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Covariance {
    /// By the number of pixels: `E[ab] - E[a] E[b]`.
    Population,
    /// By the number of pixels less one, here 121/120 times as much, as scikit-image does.
    Sample,
}

/// The windows of planes of one size.
pub(crate) struct Windows<T> {
    taps: [T; WINDOW],
    correction: T,
    height: usize,
    width: usize,
}

/// The windows that count.
#[derive(Clone, Debug)]
pub(crate) struct Kept<T> {
    /// 1 for each window that does, `[h, w]`, and 0 for each that does not.
    weights: Vec<T>,
    /// Number of those that do.
    count: usize,
}

impl<T: Real> Kept<T> {
    /// The windows all of whose pixels are in the mask `[H, W]`.
    pub fn whole(mask: &[bool], [height, width]: [usize; 2]) -> Self {
        let [h, w] = [height - BORDER, width - BORDER];
        // For each pixel, how many of the mask end there, along x; then the same along y.
        let mut runs = vec![0_usize; mask.len()];
        for (i, inside) in mask.iter().enumerate() {
            let before = if i % width == 0 { 0 } else { runs[i - 1] };
            runs[i] = if *inside { before + 1 } else { 0 };
        }
        let mut rows = vec![0_usize; width];
        let mut weights = vec![T::ZERO; h * w];
        for (i, run) in runs.iter().enumerate() {
            let (y, x) = (i / width, i % width);
            rows[x] = if *run >= WINDOW { rows[x] + 1 } else { 0 };
            if rows[x] >= WINDOW {
                weights[(y - BORDER) * w + x - BORDER] = T::ONE;
            }
        }
        let count = weights.iter().filter(|weight| **weight == T::ONE).count();
        Self { weights, count }
    }
}

/// The parts of a workspace.
struct Parts<'a, T> {
    /// E over x of a, b, aa, bb, ab, each `[H, w]`; later the three maps spread over the rows.
    moments: &'a mut [T],
    /// Derivatives with respect to `E[a]`, `E[aa]` and `E[ab]`, each `[h, w]`.
    maps: &'a mut [T],
    /// Five window means of one row of windows, each `[w]`.
    row: &'a mut [T],
    /// One row of pixels.
    line: &'a mut [T],
}

/// The weights of the window along an axis, which add up to 1.
pub(crate) fn taps() -> [f64; WINDOW] {
    let weight = |k: usize| (-0.5 * ((k as f64 - (WINDOW / 2) as f64) / SIGMA).powi(2)).exp();
    let total: f64 = (0..WINDOW).map(weight).sum();
    std::array::from_fn(|k| weight(k) / total)
}

/// sum += weight * x.
#[inline(always)]
fn add_scaled<T: Real>(sum: &mut [T], weight: T, x: &[T]) {
    for (s, x) in sum.iter_mut().zip(x) {
        *s += weight * *x;
    }
}

impl<T: Real> Windows<T> {
    pub fn new([height, width]: [usize; 2], covariance: Covariance) -> Self {
        let pixels = (WINDOW * WINDOW) as f64;
        let correction = match covariance {
            Covariance::Population => 1.0,
            Covariance::Sample => pixels / (pixels - 1.0),
        };
        Self { taps: taps().map(T::from_f64), correction: T::from_f64(correction), height, width }
    }

    /// Rows and columns of windows that lie inside the image.
    fn inside(&self) -> [usize; 2] {
        [self.height - BORDER, self.width - BORDER]
    }

    /// Length of the scratch memory that a plane needs.
    pub fn workspace_len(&self) -> usize {
        let [h, w] = self.inside();
        5 * self.height * w + 3 * h * w + 5 * w + self.width
    }

    fn parts<'a>(&self, workspace: &'a mut [T]) -> Parts<'a, T> {
        let [h, w] = self.inside();
        let (moments, rest) = workspace.split_at_mut(5 * self.height * w);
        let (maps, rest) = rest.split_at_mut(3 * h * w);
        let (row, rest) = rest.split_at_mut(5 * w);
        Parts { moments, maps, row, line: &mut rest[..self.width] }
    }

    /// The mean similarity over all windows inside the planes `a` and `b`, each `[H, W]`, or over the windows in
    /// `kept`.
    pub fn similarity(&self, a: &[T], b: &[T], kept: Option<&Kept<T>>, workspace: &mut [T]) -> f64 {
        simd::dispatch(
            #[inline(always)]
            || {
                let parts = self.parts(workspace);
                self.moments(a, b, parts.moments, parts.line);
                self.windows(parts.moments, parts.row, None, kept)
            },
        )
    }

    /// Writes the derivative of [`similarity`](Self::similarity) with respect to `a`, times `scale`, to `da` `[H, W]`.
    pub fn gradient(&self, [a, b]: [&[T]; 2], kept: Option<&Kept<T>>, scale: T, da: &mut [T], workspace: &mut [T]) {
        simd::dispatch(
            #[inline(always)]
            || {
                let Parts { moments, maps, row, line } = self.parts(workspace);
                self.moments(a, b, moments, line);
                self.windows(moments, row, Some(maps), kept);
                self.spread(maps, moments);
                let [h, w] = self.inside();
                let scale = scale / T::from_usize(kept.map_or(h * w, |kept| kept.count.max(1)));
                self.collect(a, b, scale, moments, line, da);
            },
        );
    }

    /// The window means along x.
    #[inline(always)]
    fn moments(&self, a: &[T], b: &[T], moments: &mut [T], line: &mut [T]) {
        let w = self.width - BORDER;
        let center = T::from_f64(CENTER);
        for (m, moments) in moments.chunks_exact_mut(self.height * w).enumerate() {
            for (y, out) in moments.chunks_exact_mut(w).enumerate() {
                let a = &a[y * self.width..][..self.width];
                let b = &b[y * self.width..][..self.width];
                for (p, (a, b)) in line.iter_mut().zip(a.iter().zip(b)) {
                    let (a, b) = (*a - center, *b - center);
                    *p = match m {
                        0 => a,
                        1 => b,
                        2 => a * a,
                        3 => b * b,
                        _ => a * b,
                    };
                }
                out.fill(T::ZERO);
                for (k, tap) in self.taps.iter().enumerate() {
                    add_scaled(out, *tap, &line[k..k + w]);
                }
            }
        }
    }

    /// The mean similarity; and, on request, the derivatives of every window's similarity with respect to `E[a]`,
    /// `E[aa]`, `E[ab]`.
    #[inline(always)]
    fn windows(&self, moments: &[T], row: &mut [T], maps: Option<&mut [T]>, kept: Option<&Kept<T>>) -> f64 {
        let [h, w] = self.inside();
        match kept {
            None => self.weighted(moments, row, maps, |_| T::ONE) / (h * w) as f64,
            // Images without kept pixels are as similar as can be.
            Some(kept) if kept.count == 0 => self.weighted(moments, row, maps, |_| T::ZERO) + 1.0,
            Some(kept) => self.weighted(moments, row, maps, |i| kept.weights[i]) / kept.count as f64,
        }
    }

    /// The sum of similarities, each times the weight of its window.
    #[inline(always)]
    fn weighted(&self, moments: &[T], row: &mut [T], mut maps: Option<&mut [T]>, weight: impl Fn(usize) -> T) -> f64 {
        let [h, w] = self.inside();
        let (c1, c2, center) = (T::from_f64(C1), T::from_f64(C2), T::from_f64(CENTER));
        let (two, correction) = (T::from_f64(2.0), self.correction);
        let mut total = 0.0;
        for y in 0..h {
            row.fill(T::ZERO);
            for (moments, row) in moments.chunks_exact(self.height * w).zip(row.chunks_exact_mut(w)) {
                for (k, tap) in self.taps.iter().enumerate() {
                    add_scaled(row, *tap, &moments[(y + k) * w..][..w]);
                }
            }
            let mut sum = T::ZERO;
            for x in 0..w {
                let [ma, mb, aa, bb, ab] = std::array::from_fn(|m| row[m * w + x]);
                let (mean_a, mean_b) = (ma + center, mb + center);
                let variances = correction * ((aa - ma * ma) + (bb - mb * mb));
                let covariance = correction * (ab - ma * mb);
                let brightness_scale = T::ONE / (mean_a * mean_a + mean_b * mean_b + c1);
                let brightness = (two * mean_a * mean_b + c1) * brightness_scale;
                let structure_scale = T::ONE / (variances + c2);
                let structure = (two * covariance + c2) * structure_scale;
                let weight = weight(y * w + x);
                sum += weight * (brightness * structure);
                if let Some(maps) = &mut maps {
                    let by_aa = -correction * brightness * structure * structure_scale;
                    let by_ab = two * correction * brightness * structure_scale;
                    let by_mean = two * structure * (mean_b - mean_a * brightness) * brightness_scale;
                    maps[y * w + x] = weight * (by_mean - two * ma * by_aa - mb * by_ab);
                    maps[(h + y) * w + x] = weight * by_aa;
                    maps[(2 * h + y) * w + x] = weight * by_ab;
                }
            }
            total += sum.to_f64();
        }
        total
    }

    /// Spreads the maps `[3, h, w]` over the rows that each window covers: `[3, H, w]`.
    #[inline(always)]
    fn spread(&self, maps: &[T], rows: &mut [T]) {
        let [h, w] = self.inside();
        for (map, rows) in maps.chunks_exact(h * w).zip(rows.chunks_exact_mut(self.height * w)) {
            for (y, out) in rows.chunks_exact_mut(w).enumerate() {
                out.fill(T::ZERO);
                for (k, tap) in self.taps.iter().enumerate() {
                    if (k..h + k).contains(&y) {
                        add_scaled(out, *tap, &map[(y - k) * w..][..w]);
                    }
                }
            }
        }
    }

    /// Spreads the rows along x and puts the three together: da = scale (A + 2 (a - center) B + (b - center) C).
    #[inline(always)]
    fn collect(&self, a: &[T], b: &[T], scale: T, rows: &[T], line: &mut [T], da: &mut [T]) {
        let w = self.width - BORDER;
        let (two, center) = (T::from_f64(2.0), T::from_f64(CENTER));
        for (y, da) in da.chunks_exact_mut(self.width).enumerate() {
            let a = &a[y * self.width..][..self.width];
            let b = &b[y * self.width..][..self.width];
            for m in 0..3 {
                let row = &rows[(m * self.height + y) * w..][..w];
                line.fill(T::ZERO);
                for (k, tap) in self.taps.iter().enumerate() {
                    add_scaled(&mut line[k..k + w], *tap, row);
                }
                for (x, (da, map)) in da.iter_mut().zip(line.iter()).enumerate() {
                    match m {
                        0 => *da = scale * *map,
                        1 => *da += scale * two * (a[x] - center) * *map,
                        _ => *da += scale * (b[x] - center) * *map,
                    }
                }
            }
        }
    }
}
