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
