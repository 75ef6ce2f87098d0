//! The straight-through Gumbel softmax: a hard choice forward, a soft one backward.

use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};

/// The position of the largest sum of logit and noise in a row, the first one if several are equal.
pub(crate) fn argmax<T: Real>(logits: &[T], noise: Option<&[T]>) -> usize {
    let value = |e: usize| logits[e] + noise.map_or(T::ZERO, |n| n[e]);
    (1..logits.len()).fold(0, |best, e| if value(e) > value(best) { e } else { best })
}

#[derive(Debug)]
struct GumbelSoftmax {
    temperature: f64,
}

impl<T: Real> Op<T> for GumbelSoftmax {
    fn name(&self) -> &'static str {
        "gumbel_softmax_straight_through"
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins[0].rank() == 2 && ins[0][1] > 0, "logits [P, E] with E > 0");
        ensure_shape!(ins.iter().all(|s| *s == ins[0]), "noise of the logits' shape");
        Ok(Shapes::one(ins[0]).and(ins[0]))
    }

    fn auxiliary_outputs(&self) -> usize {
        1
    }

    fn differentiable(&self, index: usize) -> bool {
        index == 0
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let [choice, soft] = outs else { unreachable!("two outputs") };
        let experts = ins[0].shape().last();
        let cool = T::from_f64(1.0 / self.temperature);
        choice.fill(T::ZERO);
        let rows = choice.chunks_exact_mut(experts).zip(soft.chunks_exact_mut(experts)).enumerate();
        for (p, (choice, soft)) in rows {
            let row = p * experts..(p + 1) * experts;
            let logits = &ins[0][row.clone()];
            let noise = ins.get(1).map(|noise| &noise[row]);
            let best = argmax(logits, noise);
            choice[best] = T::ONE;
            let value = |e: usize| logits[e] + noise.map_or(T::ZERO, |n| n[e]);
            let top = value(best);
            let mut sum = T::ZERO;
            for (e, y) in soft.iter_mut().enumerate() {
                *y = ((value(e) - top) * cool).exp();
                sum += *y;
            }
            soft.iter_mut().for_each(|y| *y /= sum);
        }
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, outs, douts, dins, .. } = at;
        let Some(dlogits) = &mut dins[0] else { return };
        let experts = ins[0].shape().last();
        let cool = T::from_f64(1.0 / self.temperature);
        let (soft, dchoice) = (outs[1], douts[0]);
        let rows = dlogits.accumulator().chunks_exact_mut(experts);
        for ((dl, y), dc) in rows.zip(soft.chunks_exact(experts)).zip(dchoice.chunks_exact(experts)) {
            let mean: T = y.iter().zip(dc).map(|(y, dc)| *y * *dc).sum();
            for e in 0..experts {
                dl[e] += cool * y[e] * (dc[e] - mean);
            }
        }
    }
}

/// Chooses one of E experts for every pixel: one-hot forward, the gradient of a softmax backward.
///
/// y = softmax((l + g) / t), c = onehot(argmax(l + g)) - stop_gradient(y) + y: the value is exactly one-hot, and
/// dL/dl_e = y_e (dL/dc_e - sum_f y_f dL/dc_f) / t. With standard Gumbel noise g the choice is an exact sample of
/// softmax(l), at any temperature t; without noise it is the argmax, the first one if several are equal.
///
/// `logits` `[P, E]` are differentiable, `noise` `[P, E]` is constant; the result is `[P, E]`. Panics on other shapes
/// and unless the temperature is positive. Source: Jang, Gu, Poole, Categorical Reparameterization with Gumbel-Softmax,
/// ICLR 2017, section 2.2.
///
/// ```
/// use weaver_autograd::Tape;
/// use weaver_router::gumbel_softmax_straight_through;
/// let tape = Tape::<f64>::new();
/// let logits = tape.leaf(&[0.0, 1.0, 3.0, 1.0], [2, 2]);
/// let choice = gumbel_softmax_straight_through(logits, None, 0.5);
/// assert_eq!(choice.to_vec(), [0.0, 1.0, 1.0, 0.0]);
/// ```
#[track_caller]
pub fn gumbel_softmax_straight_through<'t, T: Real>(
    logits: Var<'t, T>,
    noise: Option<Var<'t, T>>,
    temperature: f64,
) -> Var<'t, T> {
    assert!(temperature > 0.0, "the temperature of a Gumbel softmax is positive, not {temperature}");
    let op = GumbelSoftmax { temperature };
    let tape = logits.tape();
    let [choice, _soft] = match noise {
        Some(noise) => tape.apply(op, &[logits, noise]),
        None => tape.apply(op, &[logits]),
    };
    choice
}
