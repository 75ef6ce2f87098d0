//! The inner loops of optimizers: AdamW updates and weight averages.

use crate::{Real, simd};
use rayon::prelude::*;

/// Elements of one task.
const CHUNK: usize = 1 << 14;
/// Numbers that [`AdamW::step_columns`] updates with one loop, where rows are short enough.
const LOOP: usize = 512;

/// The settings of one AdamW step (Loshchilov and Hutter 2019, arXiv 1711.05101).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamW<T> {
    /// Learning rate.
    pub rate: T,
    /// Decay rate of the first moment, the running mean of gradients.
    pub beta1: T,
    /// Decay rate of the second moment, the running mean of squared gradients.
    pub beta2: T,
    /// Added to the square root of the second moment.
    pub eps: T,
    /// Decoupled weight decay; a step multiplies parameters by 1 - rate * weight_decay.
    pub weight_decay: T,
    /// Factor of all gradients, for instance from gradient clipping.
    pub gradient_scale: T,
}

impl<T: Real> AdamW<T> {
    /// Updates the parameters `p` and their moments `m` and `v` by the gradients `g`, all of one length.
    ///
    /// `step` counts from 1. After the moments are updated,
    /// `p = p (1 - rate weight_decay) - rate (m / (1 - beta1^step)) / (sqrt(v / (1 - beta2^step)) + eps)`.
    ///
    /// # Panics
    ///
    /// If the lengths differ.
    ///
    /// ```
    /// use weaver_kernels::optim::AdamW;
    /// let settings =
    ///     AdamW { rate: 0.5, beta1: 0.5, beta2: 0.75, eps: 0.0, weight_decay: 1.0, gradient_scale: 1.0 };
    /// let (mut p, mut m, mut v) = ([8.0], [0.0], [0.0]);
    /// settings.step(1, &mut p, &[-2.0], &mut m, &mut v);
    /// assert_eq!((p, m, v), ([4.5], [-1.0], [1.0])); // half of 8, plus the rate against the sign of the gradient
    /// ```
    #[inline(never)]
    pub fn step(&self, step: u64, p: &mut [T], g: &[T], m: &mut [T], v: &mut [T]) {
        assert!(p.len() == g.len() && p.len() == m.len() && p.len() == v.len(), "AdamW: lengths");
        let update = Update::new(self, step);
        let chunks =
            p.par_chunks_mut(CHUNK).zip(g.par_chunks(CHUNK)).zip(m.par_chunks_mut(CHUNK)).zip(v.par_chunks_mut(CHUNK));
        chunks.for_each(|(((p, g), m), v)| {
            simd::dispatch(
                #[inline(always)]
                || update.run(p, g, m, v),
            );
        });
    }

    /// Updates a parameter `[rows, columns]` as [`step`](Self::step) does, each column with a rate of its own: `rate`
    /// times `columns`. There is no weight decay.
    ///
    /// # Panics
    ///
    /// If the lengths disagree.
    ///
    /// ```
    /// use weaver_kernels::optim::AdamW;
    /// let settings =
    ///     AdamW { rate: 1.0, beta1: 0.5, beta2: 0.75, eps: 0.0, weight_decay: 0.0, gradient_scale: 1.0 };
    /// let (mut p, mut m, mut v) = ([0.0; 4], [0.0; 4], [0.0; 4]);
    /// settings.step_columns(1, &mut p, &[-2.0; 4], &mut m, &mut v, &[0.5, 2.0]);
    /// assert_eq!(p, [0.5, 2.0, 0.5, 2.0]);
    /// ```
    #[inline(never)]
    pub fn step_columns(&self, step: u64, p: &mut [T], g: &[T], m: &mut [T], v: &mut [T], columns: &[T]) {
        assert!(p.len() == g.len() && p.len() == m.len() && p.len() == v.len(), "AdamW: lengths");
        assert!(
            p.len().is_multiple_of(columns.len().max(1)),
            "AdamW: {} numbers in {} columns",
            p.len(),
            columns.len()
        );
        let update = Update::new(self, step);
        // Several rows at once: one may be shorter than a vector.
        let mut room = [T::ZERO; LOOP];
        let several = LOOP / columns.len().max(1) * columns.len();
        room[..several].chunks_mut(columns.len().max(1)).for_each(|row| row.copy_from_slice(columns));
        let columns = if several > 0 { &room[..several] } else { columns };
        let size = columns.len() * (CHUNK / columns.len().max(1)).max(1);
        let chunks =
            p.par_chunks_mut(size).zip(g.par_chunks(size)).zip(m.par_chunks_mut(size)).zip(v.par_chunks_mut(size));
        chunks.for_each(|(((p, g), m), v)| {
            simd::dispatch(
                #[inline(always)]
                || update.run_columns(p, g, m, v, columns),
            );
        });
    }
}

/// The update of every number in a step.
struct Update<'a, T> {
    settings: &'a AdamW<T>,
    /// The rate over the bias correction of the first moment.
    rate: T,
    /// One over the root of the bias correction of the second moment.
    root: T,
    /// Factor that weight decay leaves.
    keep: T,
}

impl<'a, T: Real> Update<'a, T> {
    fn new(settings: &'a AdamW<T>, step: u64) -> Self {
        // In f64, since 1 - 0.999 has few digits left in f32.
        let correction = |beta: T| 1.0 - beta.to_f64().powf(step as f64);
        Self {
            settings,
            rate: T::from_f64(settings.rate.to_f64() / correction(settings.beta1)),
            root: T::from_f64(1.0 / correction(settings.beta2).sqrt()),
            keep: T::ONE - settings.rate * settings.weight_decay,
        }
    }

    #[inline(always)]
    fn run(&self, p: &mut [T], g: &[T], m: &mut [T], v: &mut [T]) {
        let Self { rate, root, keep, .. } = *self;
        let AdamW { beta1, beta2, eps, gradient_scale, .. } = *self.settings;
        for (((p, g), m), v) in p.iter_mut().zip(g).zip(m).zip(v) {
            let g = *g * gradient_scale;
            *m = beta1 * *m + (T::ONE - beta1) * g;
            *v = beta2 * *v + (T::ONE - beta2) * g * g;
            *p = *p * keep - rate * *m / (v.sqrt() * root + eps);
        }
    }

    #[inline(always)]
    fn run_columns(&self, p: &mut [T], g: &[T], m: &mut [T], v: &mut [T], columns: &[T]) {
        let AdamW { beta1, beta2, eps, gradient_scale, .. } = *self.settings;
        let rows = columns.len();
        let all = p.chunks_mut(rows).zip(g.chunks(rows)).zip(m.chunks_mut(rows)).zip(v.chunks_mut(rows));
        for (((p, g), m), v) in all {
            for ((((p, g), m), v), column) in p.iter_mut().zip(g).zip(m).zip(v).zip(columns) {
                let g = *g * gradient_scale;
                *m = beta1 * *m + (T::ONE - beta1) * g;
                *v = beta2 * *v + (T::ONE - beta2) * g * g;
                *p -= self.rate * *column * *m / (v.sqrt() * self.root + eps);
            }
        }
    }
}

/// Exponential moving average: average = decay average + (1 - decay) x.
///
/// # Panics
///
/// If the lengths differ.
///
/// ```
/// use weaver_kernels::optim::lerp;
/// let mut average = [1.0];
/// lerp(&mut average, &[3.0], 0.75);
/// assert_eq!(average, [1.5]);
/// ```
pub fn lerp<T: Real>(average: &mut [T], x: &[T], decay: T) {
    assert_eq!(average.len(), x.len(), "lerp: lengths");
    average.par_chunks_mut(CHUNK).zip(x.par_chunks(CHUNK)).for_each(|(average, x)| {
        simd::dispatch(
            #[inline(always)]
            || average.iter_mut().zip(x).for_each(|(a, x)| *a = decay * *a + (T::ONE - decay) * *x),
        );
    });
}
