//! AdamW.

use std::collections::BTreeMap;
use weaver_autograd::{ParamId, Params, Real, Tape};
use weaver_kernels::optim;

/// Parameters with a common learning rate and weight decay.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// The parameters.
    pub params: Vec<ParamId>,
    /// Factor of the learning rate.
    pub lr_scale: f64,
    /// Decoupled weight decay, times the learning rate per step.
    pub weight_decay: f64,
}

/// Running means of a parameter's gradient and of its square.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moments<T> {
    /// Running mean of the gradient.
    pub first: Vec<T>,
    /// Running mean of the squared gradient.
    pub second: Vec<T>,
}

/// Adam with decoupled weight decay (Loshchilov and Hutter, arXiv 1711.05101): p = p (1 - lr decay) - lr m^ /
/// (sqrt(v^) + eps), with m = beta1 m + (1 - beta1) g, m^ = m / (1 - beta1^t), and v of g^2 likewise.
///
/// The moments of a parameter are allocated at its first gradient; from then on a step allocates nothing. A parameter
/// that received no gradient in a step is left as it is, weight decay included, and does not count the step.
///
/// ```
/// use weaver_autograd::{Params, Tape};
/// use weaver_nn::{AdamW, Group};
/// let mut params = Params::<f64>::new();
/// let w = params.add("w", [1], vec![1.0]);
/// let mut optimizer = AdamW::new(vec![Group { params: vec![w], lr_scale: 1.0, weight_decay: 0.0 }], 0.9, 0.95, 1e-8);
/// let mut tape = Tape::new();
/// tape.param(&params, w).sum().backward();
/// optimizer.step(&mut params, &mut tape, 0.1);
/// assert!((params.get(w).value()[0] - 0.9).abs() < 1e-8);
/// tape.reset();
/// ```
#[derive(Clone, Debug)]
pub struct AdamW<T: Real = f32> {
    /// The parameters that are trained, each in one group.
    pub groups: Vec<Group>,
    /// Decay of the mean of gradients.
    pub beta1: f64,
    /// Decay of the mean of squared gradients.
    pub beta2: f64,
    /// Added to the root of the mean square.
    pub eps: f64,
    /// By parameter index; the number of steps a parameter has taken beside its moments.
    pub(crate) state: Vec<(u64, Moments<T>)>,
}

impl<T: Real> AdamW<T> {
    /// An optimizer that has not taken a step.
    pub fn new(groups: Vec<Group>, beta1: f64, beta2: f64, eps: f64) -> Self {
        Self { groups, beta1, beta2, eps, state: Vec::new() }
    }

    /// One step along the gradients that the tape holds. The tape lets go of the parameters' values, so that they
    /// change in place; reset it next.
    pub fn step(&mut self, params: &mut Params<T>, tape: &mut Tape<T>, lr: f64) {
        self.step_scaled(params, tape, lr, 1.0);
    }

    /// One [`step`](Self::step) with all gradients multiplied by a factor, as from [`clip_factor`](crate::clip_factor).
    pub fn step_scaled(&mut self, params: &mut Params<T>, tape: &mut Tape<T>, lr: f64, gradient_scale: f64) {
        tape.release_params();
        for group in &self.groups {
            let update = optim::AdamW {
                rate: T::from_f64(lr * group.lr_scale),
                beta1: T::from_f64(self.beta1),
                beta2: T::from_f64(self.beta2),
                eps: T::from_f64(self.eps),
                weight_decay: T::from_f64(group.weight_decay),
                gradient_scale: T::from_f64(gradient_scale),
            };
            for &id in &group.params {
                let Some(gradient) = tape.param_grad(id) else { continue };
                if self.state.len() <= id.index() {
                    self.state.resize_with(params.len(), Default::default);
                }
                let (steps, Moments { first, second }) = &mut self.state[id.index()];
                first.resize(gradient.len(), T::ZERO);
                second.resize(gradient.len(), T::ZERO);
                *steps += 1;
                update.step(*steps, params.value_mut(id), &gradient, first, second);
            }
        }
    }
}

/// A stored state by parameter index.
pub(crate) fn checked<T: Real>(
    params: &Params<T>,
    state: BTreeMap<String, (u64, Moments<T>)>,
) -> Result<Vec<(u64, Moments<T>)>, StateError> {
    let mut list = vec![Default::default(); params.len()];
    for (name, (steps, moments)) in state {
        let Some(id) = params.find(&name) else { return Err(StateError::Unknown { name }) };
        let expected = params.get(id).shape().len();
        if let Some(found) = [moments.first.len(), moments.second.len()].into_iter().find(|len| *len != expected) {
            return Err(StateError::Size { name, expected, found });
        }
        list[id.index()] = (steps, moments);
    }
    Ok(list)
}

/// Why a stored state does not fit a model.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StateError {
    /// No parameter has this name.
    #[error("stored state of `{name}`, which is no parameter of this model")]
    Unknown {
        /// The name.
        name: String,
    },
    /// The parameter has another size.
    #[error("stored state of `{name}`: expected {expected} numbers, found {found}")]
    Size {
        /// The parameter's name.
        name: String,
        /// Its size.
        expected: usize,
        /// The stored size.
        found: usize,
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Optimizer;
    use std::sync::Arc;
    use weaver_autograd::{HalfValues, ParamValues};

    #[test]
    fn state_of_parameters_that_cannot_be_read() {
        let mut params = Params::<f32>::new();
        params.declare("absent", [2]);
        let half = params.declare("half", [2]);
        params.set(half, ParamValues::Half(HalfValues::Bf16(Arc::new(vec![Default::default(); 2]))));
        let mut optimizer = AdamW::<f32>::new(Vec::new(), 0.9, 0.95, 1e-8);
        for name in ["absent", "half"] {
            let state = |len| {
                let moments = Moments { first: vec![0.0; len], second: vec![0.0; len] };
                BTreeMap::from([(name.to_string(), (1, moments))])
            };
            let error = StateError::Size { name: name.into(), expected: 2, found: 3 };
            assert_eq!(optimizer.set_state(&params, state(3)), Err(error));
            assert_eq!(optimizer.set_state(&params, state(2)), Ok(()));
        }
    }
}
