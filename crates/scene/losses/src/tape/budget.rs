//! Losses on the number of Gaussians that the router spends.

use weaver_autograd::{Real, Var};

/// Five times the squared distance of the experts' shares of the pixels from their targets, a scalar.
///
/// It is 5 sum_{e >= 1} (mean_p c_pe - t_e)^2.
/// `choice` c is `[P, E]`, the (straight-through) one-hot choice of every pixel; `targets` are t_1 .. t_{E-1}, the
/// shares of the experts that make Gaussians. Differentiable in the choice. Panics unless E is one more than the
/// targets. Source: the official SplatWeaver code, with targets 0.2, 0.02, 0.02.
#[track_caller]
pub fn share_budget<'t, T: Real>(choice: Var<'t, T>, targets: &[f64]) -> Var<'t, T> {
    let shares = shares(choice, targets.len() + 1, "share_budget").slice(0, 1, targets.len());
    let targets = shares.tape().constant_with([targets.len()], |t| {
        t.iter_mut().zip(targets).for_each(|(t, target)| *t = T::from_f64(*target));
    });
    (shares - targets).square().sum() * 5.0
}

/// The squared excess of the number of Gaussians per pixel over `tau`, a scalar.
///
/// It is max(0, mean_p sum_e e c_pe - tau)^2. `choice` c is `[P, E]`; expert e makes e Gaussians. Differentiable in the
/// choice, with gradient 0 below the budget, so that simple scenes may use less. Source: the global budget of Wan et
/// al., SplatWeaver, arXiv 2605.07287.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let choice = tape.leaf(&[1.0, 0.0, 0.0, 1.0], [2, 2]);
/// assert_eq!(weaver_losses::global_budget(choice, 0.25).item(), 0.0625);
/// ```
#[track_caller]
pub fn global_budget<T: Real>(choice: Var<'_, T>, tau: f64) -> Var<'_, T> {
    let experts = choice.shape().last();
    let counts = choice.tape().constant_with([experts], |counts| {
        counts.iter_mut().enumerate().for_each(|(e, c)| *c = T::from_usize(e));
    });
    ((shares(choice, experts, "global_budget") * counts).sum() - tau).relu().square()
}

/// The share of each expert, `[E]`.
#[track_caller]
fn shares<'t, T: Real>(choice: Var<'t, T>, experts: usize, of: &'static str) -> Var<'t, T> {
    let shape = choice.shape();
    let fits = shape.rank() == 2 && shape[1] == experts;
    choice.tape().ensure_shapes(fits, of, format_args!("a choice [P, {experts}]"), &[shape]);
    choice.mean_axis(0)
}
