//! Norm, clipping and presence of the gradients of all parameters.

use weaver_autograd::{Params, Real, Tape};
use weaver_kernels::reduce;

/// The Euclidean norm of all parameters' gradients together, summed in the order of the parameters; NaN or infinite if
/// a gradient is.
///
/// ```
/// use weaver_autograd::{Params, Tape};
/// let mut params = Params::<f64>::new();
/// let w = params.add("w", [2], vec![1.5, 2.0]);
/// let tape = Tape::new();
/// tape.param(&params, w).square().sum().backward(); // gradient (3, 4)
/// assert_eq!(weaver_nn::global_norm(&params, &tape), 5.0);
/// ```
pub fn global_norm<T: Real>(params: &Params<T>, tape: &Tape<T>) -> f64 {
    let squared = |(id, _)| tape.param_grad(id).map_or(0.0, |g| reduce::squared_norm(&g).to_f64());
    params.iter().map(squared).sum::<f64>().sqrt()
}

/// The factor that brings gradients of this norm to at most `max_norm`: min(1, max_norm / (norm + 1e-6)), as PyTorch
/// clips.
///
/// ```
/// assert_eq!(weaver_nn::clip_factor(0.5, 1.0), 1.0);
/// assert!((weaver_nn::clip_factor(5.0, 1.0) - 0.2).abs() < 1e-6);
/// ```
pub fn clip_factor(norm: f64, max_norm: f64) -> f64 {
    (max_norm / (norm + 1e-6)).min(1.0)
}

/// Scales the gradients on the tape so that their global norm is at most `max_norm`, and returns the norm that they
/// had. If it is not finite, the gradients are left as they are, and the step should not be taken.
///
/// ```
/// use weaver_autograd::{Params, Tape};
/// let mut params = Params::<f64>::new();
/// let w = params.add("w", [2], vec![1.5, 2.0]);
/// let mut tape = Tape::new();
/// tape.param(&params, w).square().sum().backward(); // gradient (3, 4)
/// assert_eq!(weaver_nn::clip_global_norm(&params, &mut tape, 1.0), 5.0);
/// assert!((weaver_nn::global_norm(&params, &tape) - 1.0).abs() < 1e-6);
/// ```
pub fn clip_global_norm<T: Real>(params: &Params<T>, tape: &mut Tape<T>, max_norm: f64) -> f64 {
    let norm = global_norm(params, tape);
    let factor = clip_factor(norm, max_norm);
    if norm.is_finite() && factor < 1.0 {
        for id in params.ids() {
            tape.scale_param_grad(id, T::from_f64(factor));
        }
    }
    norm
}

/// Adds `factor * p` to the gradient of every parameter p that has one: an L2 penalty of `factor / 2 |p|^2`, which Adam
/// then scales as it does the rest of the gradient. PyTorch's `Adam(weight_decay=factor)` is [`AdamW`](crate::AdamW)
/// without decay behind this.
///
/// ```
/// use weaver_autograd::{Params, Tape};
/// let mut params = Params::<f64>::new();
/// let w = params.add("w", [1], vec![4.0]);
/// let mut tape = Tape::new();
/// tape.param(&params, w).sum().backward();
/// weaver_nn::add_l2_gradient(&params, &mut tape, 0.5);
/// assert_eq!(tape.param_grad(w).unwrap()[0], 3.0);
/// ```
pub fn add_l2_gradient<T: Real>(params: &Params<T>, tape: &mut Tape<T>, factor: f64) {
    let factor = T::from_f64(factor);
    for (id, param) in params.iter() {
        if let Some(gradient) = tape.param_grad_mut(id) {
            gradient.iter_mut().zip(param.value()).for_each(|(g, p)| *g += factor * *p);
        }
    }
}

/// The names of all parameters that are to be trained but received no gradient.
///
/// A gradient of zeros counts as received; only a parameter that the backward pass did not reach is missing one.
///
/// ```
/// use weaver_autograd::{Params, Tape};
/// let mut params = Params::<f64>::new();
/// let (a, _) = (params.add("a", [1], vec![1.0]), params.add("b", [1], vec![1.0]));
/// let tape = Tape::new();
/// tape.param(&params, a).sum().backward();
/// assert_eq!(weaver_nn::missing_gradients(&params, &tape), ["b"]);
/// ```
pub fn missing_gradients<T: Real>(params: &Params<T>, tape: &Tape<T>) -> Vec<String> {
    let missing = params.iter().filter(|(id, param)| !param.is_frozen() && tape.param_grad(*id).is_none());
    missing.map(|(_, param)| param.name().to_string()).collect()
}
