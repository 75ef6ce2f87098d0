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

    /// Updates only some rows of a parameter, as [`step`](Self::step) does, and leaves the others untouched.
    ///
    /// Before a row is updated, its moments are decayed for the steps that it missed: k steps with a gradient of zero
    /// make m = beta1^k m and v = beta2^k v. The bias correction belongs to `step`. A row that was left out of no step
    /// gets the same bits from `step`.
    ///
    /// Panics if the lengths disagree, if the rows are not ascending or there are fewer than named, or if a row is
    /// ahead of `step`.
    ///
    /// ```
    /// use weaver_kernels::optim::{AdamW, SparseRows};
    /// let settings =
    ///     AdamW { rate: 0.5, beta1: 0.5, beta2: 0.75, eps: 0.0, weight_decay: 0.0, gradient_scale: 1.0 };
    /// let (mut p, mut m, mut v) = ([0.0, 0.0], [0.0, 8.0], [0.0, 1.0]);
    /// let mut row_steps = [3, 1]; // The second row was left out of steps 2 and 3.
    /// let rows = SparseRows { rows: &[1], row_steps: &mut row_steps };
    /// settings.step_rows(4, &mut p, &[0.0, 0.0], &mut m, &mut v, rows);
    /// assert_eq!((p[0], m, row_steps), (0.0, [0.0, 1.0], [3, 4])); // 8 halved three times.
    /// ```
    #[inline(never)]
    pub fn step_rows(&self, step: u64, p: &mut [T], g: &[T], m: &mut [T], v: &mut [T], rows: SparseRows<'_>) {
        let SparseRows { rows, row_steps } = rows;
        assert!(p.len() == g.len() && p.len() == m.len() && p.len() == v.len(), "AdamW: lengths");
        assert!(rows.is_sorted_by(|a, b| a < b), "AdamW: rows in ascending order");
        let Some(last) = rows.last() else { return };
        assert!((*last as usize) < row_steps.len(), "AdamW: row {last} of {}", row_steps.len());
        let width = p.len() / row_steps.len();
        assert_eq!(p.len(), width * row_steps.len(), "AdamW: {} rows of one width", row_steps.len());
        let update = Update::new(self, step);
        update.run_rows(rows, Part { first_row: 0, width, p, g, m, v, row_steps });
    }
}

/// The rows that [`AdamW::step_rows`] updates.
#[derive(Debug)]
pub struct SparseRows<'a> {
    /// The rows, in ascending order.
    pub rows: &'a [u32],
    /// For each row of the parameter the step up to which its moments have been decayed; the update sets the entries of
    /// its own rows.
    pub row_steps: &'a mut [u64],
}

/// The update of every number in a step.
struct Update<'a, T> {
    settings: &'a AdamW<T>,
    step: u64,
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
            step,
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

    /// Updates some rows of a part; large parts are divided among threads where the rows are.
    fn run_rows(&self, rows: &[u32], mut part: Part<'_, T>) {
        if rows.len() > 1 && rows.len() * part.width > CHUNK {
            let (before, after) = rows.split_at(rows.len() / 2);
            let (left, right) = part.split_at(after[0] as usize);
            rayon::join(|| self.run_rows(before, left), || self.run_rows(after, right));
        } else {
            simd::dispatch(
                #[inline(always)]
                || self.run_runs(rows, part),
            );
        }
    }

    /// Updates rows one run after the other: a run is consecutive rows that were left out of equally many steps.
    #[inline(always)]
    fn run_runs(&self, mut rows: &[u32], part: Part<'_, T>) {
        let Part { first_row, width, p, g, m, v, row_steps } = part;
        while let Some(first) = rows.first() {
            let from = *first as usize - first_row;
            let last_step = row_steps[from];
            let continues =
                |(i, row): &(usize, &u32)| **row as usize == from + first_row + i && row_steps[from + i] == last_step;
            let length = rows.iter().enumerate().take_while(continues).count();
            rows = &rows[length..];
            row_steps[from..from + length].fill(self.step);
            let numbers = from * width..(from + length) * width;
            let (m, v) = (&mut m[numbers.clone()], &mut v[numbers.clone()]);
            assert!(last_step < self.step, "AdamW: row {first} has taken step {last_step} before {}", self.step);
            let skipped = self.step - 1 - last_step;
            if skipped > 0 {
                let decay = |beta: T| T::from_f64(beta.to_f64().powf(skipped as f64));
                let (decay1, decay2) = (decay(self.settings.beta1), decay(self.settings.beta2));
                for (m, v) in m.iter_mut().zip(v.iter_mut()) {
                    *m *= decay1;
                    *v *= decay2;
                }
            }
            self.run(&mut p[numbers.clone()], &g[numbers], m, v);
        }
    }
}

/// Consecutive rows of a parameter, of its gradient and of its moments.
struct Part<'a, T> {
    first_row: usize,
    width: usize,
    p: &'a mut [T],
    g: &'a [T],
    m: &'a mut [T],
    v: &'a mut [T],
    row_steps: &'a mut [u64],
}

impl<T> Part<'_, T> {
    /// Splits before a row.
    fn split_at(&mut self, row: usize) -> (Part<'_, T>, Part<'_, T>) {
        let &mut Self { first_row, width, .. } = self;
        let rows = row - first_row;
        let (p, more_p) = self.p.split_at_mut(rows * width);
        let (g, more_g) = self.g.split_at(rows * width);
        let (m, more_m) = self.m.split_at_mut(rows * width);
        let (v, more_v) = self.v.split_at_mut(rows * width);
        let (row_steps, more_steps) = self.row_steps.split_at_mut(rows);
        let left = Part { first_row, width, p, g, m, v, row_steps };
        (left, Part { first_row: row, width, p: more_p, g: more_g, m: more_m, v: more_v, row_steps: more_steps })
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
