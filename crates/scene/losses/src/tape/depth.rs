//! Losses on depth maps.

use weaver_autograd::{Real, Var, apply_pointwise, pointwise};
use weaver_kernels::order::quantile;

pointwise!(
    /// (depth - target)^2 where the mask is positive, else 0.
    MaskedSquaredError, 3, |depth, target, mask| {
        if mask.value > T::ZERO { (depth - target) * (depth - target) } else { 0.0.into() }
    }
);

pointwise!(
    /// |l - ln(scale t)| where the depth t is known (positive), else 0.
    LogDepthError { scale: f64 }, 2, |l, t| if t.value > T::ZERO { (l - (t * scale).ln()).abs() } else { 0.0.into() }
);

pointwise!(
    /// |l - ln t| / e^u + u where the depth t is known (positive), else 0.
    LaplacianError, 3, |l, u, t| if t.value > T::ZERO { (l - t.ln()).abs() / u.exp() + u } else { 0.0.into() }
);

/// The mean squared difference of depths at the pixels where the teacher is confident, a scalar.
///
/// The mask of view v holds the pixels whose confidence is above (strictly) the `q`-quantile of the confidences of that
/// view; the mean runs over the masked pixels of all views together, and is 0 when there are none. All arguments are
/// `[V, H, W]` in the units of the scene; differentiable in `depth` and `target`, the mask is constant. Source:
/// distillation loss of the official SplatWeaver code, with q = 0.3 and weight 0.1.
#[track_caller]
pub fn masked_depth_mse<'t, T: Real>(
    depth: Var<'t, T>,
    target: Var<'t, T>,
    confidence: Var<'t, T>,
    q: f64,
) -> Var<'t, T> {
    let tape = depth.tape();
    let shape = confidence.shape();
    let found = [depth.shape(), target.shape(), shape];
    let fits = shape.rank() == 3 && found == [shape; 3];
    tape.ensure_shapes(fits, "masked_depth_mse", "depth, target and confidence [V, H, W]", &found);
    let pixels = shape[1] * shape[2];
    let mut count = 0;
    let mask = tape.constant_with(shape, |mask| {
        let confidence = confidence.value();
        let mut scratch = tape.pool().buffer::<T>(pixels);
        for (mask, confidence) in mask.chunks_mut(pixels).zip(confidence.chunks(pixels)) {
            scratch.copy_from_slice(confidence);
            let threshold = quantile(&mut scratch, q);
            for (m, c) in mask.iter_mut().zip(confidence) {
                *m = if *c > threshold { T::ONE } else { T::ZERO };
                count += usize::from(*c > threshold);
            }
        }
    });
    apply_pointwise(MaskedSquaredError, [depth, target, mask]).sum() * (1.0 / count.max(1) as f64)
}

/// The L1 distance of log depth at the pixels whose depth is known, for instance from triangulated points, a scalar.
///
/// It is the sum over known pixels of |log_depth - ln(scale * target)|, divided by the number of known pixels plus 1.
/// `log_depth` and `target` are `[V, H, W]`; a target of 0 means unknown; `scale` turns the target's units into the
/// prediction's. The 1 in the denominator bounds the influence of each point where there are few. Differentiable in
/// `log_depth`, with derivative 0 where the two are equal.
#[track_caller]
pub fn sparse_log_depth_l1<'t, T: Real>(log_depth: Var<'t, T>, target: Var<'t, T>, scale: f64) -> Var<'t, T> {
    assert!(scale > 0.0, "sparse_log_depth_l1: expected a positive scale, found {scale}");
    let known = target.value().iter().filter(|t| **t > T::ZERO).count();
    apply_pointwise(LogDepthError { scale }, [log_depth, target.detach()]).sum() * (1.0 / (known + 1) as f64)
}

/// The negative log likelihood of known depth under a Laplacian of log depth at each pixel, a scalar: the spread that
/// it rewards is the mean absolute error.
///
/// It is the sum over known pixels of |l - ln t| / b + ln b, with l the `log_depth` and ln b the `log_spread`, divided
/// by the number of known pixels plus 1; the constant ln 2 is left out. All arguments are `[V, H, W]`; a `target` of 0
/// means unknown. Differentiable in `log_depth`, with derivative 0 where it is right, and in `log_spread`. Source:
/// Kendall and Gal, What uncertainties do we need in Bayesian deep learning for computer vision?, 2017, section 3.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let [l, spread, target] = [[0.5, 0.0], [0.0, 7.0], [1.0, 0.0]].map(|x| tape.constant(&x, [1, 1, 2]));
/// // One known pixel, half a unit off at a spread of 1.
/// assert_eq!(weaver_losses::laplacian_log_depth(l, spread, target).item(), 0.25);
/// ```
#[track_caller]
pub fn laplacian_log_depth<'t, T: Real>(
    log_depth: Var<'t, T>,
    log_spread: Var<'t, T>,
    target: Var<'t, T>,
) -> Var<'t, T> {
    let known = target.value().iter().filter(|t| **t > T::ZERO).count();
    apply_pointwise(LaplacianError, [log_depth, log_spread, target.detach()]).sum() * (1.0 / (known + 1) as f64)
}
