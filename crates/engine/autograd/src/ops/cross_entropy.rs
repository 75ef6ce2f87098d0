//! Cross entropy with label smoothing.

use crate::{Backward, Buffer, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, softmax::softmax_forward};

#[derive(Debug)]
struct CrossEntropy<T: Real> {
    labels: Buffer<u32>,
    smoothing: f64,
    probabilities: Option<Buffer<T>>,
}

impl<T: Real> Op<T> for CrossEntropy<T> {
    fn name(&self) -> &'static str {
        "cross_entropy"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let rows = self.labels.len();
        ensure_shape!(
            ins.len() == 1 && ins[0].rank() == 2 && ins[0][0] == rows,
            "logits [{rows}, E], a row for every label"
        );
        if let Some(last) = self.labels.iter().max() {
            ensure_shape!((*last as usize) < ins[0][1], "logits [N, E] with class {last}");
        }
        Ok(Shapes::one(Shape::SCALAR))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], pool: &Pool) {
        let classes = ins[0].shape().last();
        let mut probabilities = pool.buffer(ins[0].len());
        softmax_forward(classes, 1, &ins[0], &mut probabilities);
        // -sum_e t_e ln p_e = ln(sum of exponentials) - sum_e t_e x_e, since the targets add up to 1.
        let mut total = 0.0;
        for (x, &label) in ins[0].chunks_exact(classes.max(1)).zip(self.labels.iter()) {
            let max = x.iter().copied().fold(-T::INFINITY, T::max);
            let log_sum = x.iter().map(|x| (*x - max).to_f64().exp()).sum::<f64>().ln();
            let mean = x.iter().map(|x| (*x - max).to_f64()).sum::<f64>() / classes as f64;
            // A logit of minus infinity counts only where its target is not 0.
            let term = |weight: f64, x: f64| if weight == 0.0 { 0.0 } else { weight * x };
            let at_label = (x[label as usize] - max).to_f64();
            total += log_sum - term(1.0 - self.smoothing, at_label) - term(self.smoothing, mean);
        }
        outs[0][0] = T::from_f64(total / self.labels.len().max(1) as f64);
        self.probabilities = Some(probabilities);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        let Some(dx) = &mut dins[0] else { return };
        let p = self.probabilities.as_ref().expect("the forward pass came first");
        let classes = ins[0].shape().last();
        let factor = douts[0][0] / T::from_usize(self.labels.len().max(1));
        let everywhere = T::from_f64(self.smoothing / classes as f64);
        let at_label = T::from_f64(1.0 - self.smoothing);
        dx.add_each(|i| {
            let is_label = self.labels[i / classes] as usize == i % classes;
            let target = everywhere + if is_label { at_label } else { T::ZERO };
            (p[i] - target) * factor
        });
    }
}

/// The mean cross entropy of softmax(logits) against labels, with label smoothing (Szegedy et al., arXiv 1512.00567).
///
/// It is -mean over n of sum over e of t_ne ln softmax(logits)_ne, with targets t_ne = (1 - smoothing) [e = label_n] +
/// smoothing / E. Logits are `[N, E]`, with one label below E for each row; the result is a scalar, 0 if there are no
/// rows. Differentiable in the logits; labels and smoothing are constant. A logit of minus infinity, which marks an
/// impossible class, counts only where its target is not 0.
///
/// ```
/// use weaver_autograd::{Tape, ops};
/// let tape = Tape::<f64>::new();
/// let logits = tape.constant(&[0.0, 0.0], [1, 2]);
/// assert!((ops::cross_entropy(logits, &[1], 0.1).item() - 2_f64.ln()).abs() < 1e-15);
/// ```
#[track_caller]
pub fn cross_entropy<'t, T: Real>(logits: Var<'t, T>, labels: &[u32], smoothing: f64) -> Var<'t, T> {
    let labels = logits.tape().pool().copy_of(labels);
    let [loss] = logits.tape().apply(CrossEntropy { labels, smoothing, probabilities: None }, &[logits]);
    loss
}
