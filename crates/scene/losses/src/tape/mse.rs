//! Mean squared error between images.

use weaver_autograd::{Real, Var, apply_pointwise, pointwise};

pointwise!(
    /// (a - b)^2.
    SquaredError, 2, |a, b| (a - b) * (a - b)
);

/// The mean squared error: the mean over all elements of (render - target)^2, a scalar.
///
/// Both have the same shape. Differentiable in both. Its weight in the published recipe is 1.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let (render, target) = (tape.leaf(&[0.5, 1.0], [2]), tape.constant(&[0.0, 1.0], [2]));
/// let loss = weaver_losses::mse(render, target);
/// loss.backward();
/// assert_eq!((loss.item(), render.grad().unwrap()), (0.125, vec![0.5, 0.0]));
/// ```
#[track_caller]
pub fn mse<'t, T: Real>(render: Var<'t, T>, target: Var<'t, T>) -> Var<'t, T> {
    apply_pointwise(SquaredError, [render, target]).mean()
}

/// The mean squared error of each image of a batch, which [`weighted_mean`] can combine.
///
/// Two tensors `[N, ..]` of the same shape give `[N]`. Differentiable in both.
#[track_caller]
pub fn mse_per_image<'t, T: Real>(render: Var<'t, T>, target: Var<'t, T>) -> Var<'t, T> {
    let error = apply_pointwise(SquaredError, [render, target]);
    let images = error.shape()[0];
    error.reshape([images, error.shape().len() / images.max(1)]).mean_axis(1)
}

/// The weighted mean (1/N) sum_i weights_i x_i of x `[N]`, a scalar: the sum is divided by N, not by the sum of the weights.
///
/// Differentiable in x; the weights are constants. Panics unless there are N weights.
#[track_caller]
pub fn weighted_mean<'t, T: Real>(x: Var<'t, T>, weights: &[f64]) -> Var<'t, T> {
    let weights = x.tape().constant_with([weights.len()], |w| {
        w.iter_mut().zip(weights).for_each(|(w, weight)| *w = T::from_f64(*weight));
    });
    (x * weights).mean()
}
