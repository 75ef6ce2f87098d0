//! Layer normalisation over the last axis.

use crate::{Buffer, Grad, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, parallel, reduce::column_sums};

#[derive(Debug)]
struct LayerNorm<T: Real> {
    eps: f64,
    /// Per row: the mean, and one over the standard deviation.
    statistics: Option<Buffer<T>>,
}

impl<T: Real> Op<T> for LayerNorm<T> {
    fn name(&self) -> &'static str {
        "layer_norm"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let width = Shape::from([ins[0].last()]);
        ensure_shape!(ins[0].rank() > 0 && ins[1..].iter().all(|s| *s == width), "x [.., D], w [D], b [D]");
        Ok(Shapes::one(ins[0]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], pool: &Pool) {
        let (x, width) = (&ins[0], ins[0].shape().last());
        let mut statistics = pool.buffer(2 * x.shape().rows());
        let scale = T::ONE / T::from_usize(width);
        parallel::for_chunks(&mut statistics, 2, |row, s| {
            let x = &x[row * width..][..width];
            let mean = x.iter().copied().sum::<T>() * scale;
            let variance = x.iter().map(|x| (*x - mean) * (*x - mean)).sum::<T>() * scale;
            s[0] = mean;
            s[1] = T::ONE / (variance + T::from_f64(self.eps)).sqrt();
        });
        let affine = ins.get(1).zip(ins.get(2));
        parallel::for_chunks(&mut outs[0], width, |row, y| {
            let (mean, rstd) = (statistics[2 * row], statistics[2 * row + 1]);
            let x = &x[row * width..][..width];
            y.iter_mut().zip(x).for_each(|(y, x)| *y = (*x - mean) * rstd);
            if let Some((w, b)) = affine {
                y.iter_mut().zip(w.iter().zip(b.iter())).for_each(|(y, (w, b))| *y = *y * *w + *b);
            }
        });
        self.statistics = Some(statistics);
    }
    fn backward(
        &self,
        ins: &[View<'_, T>],
        _outs: &[View<'_, T>],
        douts: &[View<'_, T>],
        dins: &mut [Option<Grad<'_, T>>],
        _pool: &Pool,
    ) {
        let (x, dy, width) = (&ins[0], &douts[0], ins[0].shape().last());
        let statistics = self.statistics.as_ref().expect("forward came first");
        let normal = |row: usize, i: usize| (x[row * width + i] - statistics[2 * row]) * statistics[2 * row + 1];
        let rows = x.shape().rows();
        if let Some(dx) = &mut dins[0] {
            let w = ins.get(1);
            let scale = T::ONE / T::from_usize(width);
            let (dx, beta) = dx.target();
            parallel::for_chunks(dx, width, |row, dx| {
                let g = |i: usize| dy[row * width + i] * w.map_or(T::ONE, |w| w[i]);
                let mean = (0..width).map(g).sum::<T>() * scale;
                let along = (0..width).map(|i| g(i) * normal(row, i)).sum::<T>() * scale;
                for (i, dx) in dx.iter_mut().enumerate() {
                    let d = statistics[2 * row + 1] * (g(i) - mean - normal(row, i) * along);
                    *dx = if beta == T::ZERO { d } else { *dx + d };
                }
            });
        }
        if let Some(Some(dw)) = dins.get_mut(1) {
            let dw = dw.accumulator();
            for row in 0..rows {
                dw.iter_mut().enumerate().for_each(|(i, dw)| *dw += dy[row * width + i] * normal(row, i));
            }
        }
        if let Some(Some(db)) = dins.get_mut(2) {
            column_sums(rows, width, dy, db.target());
        }
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// Every row of the last axis brought to mean 0 and variance 1, then scaled and shifted:
    /// y = (x - mean) / sqrt(variance + eps) * w + b, with the population variance (Ba et al., arXiv 1607.06450).
    ///
    /// x `[.., D]`; w and b `[D]` each, or none.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f64>::new();
    /// assert_eq!(tape.constant(&[1.0, 3.0], [1, 2]).layer_norm(None, 0.0).to_vec(), [-1.0, 1.0]);
    /// ```
    #[track_caller]
    pub fn layer_norm(self, affine: Option<(Self, Self)>, eps: f64) -> Self {
        let op = LayerNorm { eps, statistics: None };
        let [y] = match affine {
            Some((w, b)) => self.tape().apply(op, &[self, w, b]),
            None => self.tape().apply(op, &[self]),
        };
        y
    }
}
