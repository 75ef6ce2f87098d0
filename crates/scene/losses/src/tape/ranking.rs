//! Ranking of pixels by high-frequency energy, as a target for the router.

use weaver_autograd::ops::cross_entropy;
use weaver_autograd::{Pool, Real, Var};
use weaver_kernels::order::quantile;

/// Writes the class of every pixel of a scene: the number of quantiles that its energy reaches.
///
/// `energy` holds all pixels of all views of one scene, which are ranked jointly; thresholds are its `quantiles`
/// (ascending, linearly interpolated), and an energy equal to a threshold belongs to the upper class. The quantiles
/// 0.76, 0.96, 0.98 thus give classes 0 to 3 to 76, 20, 2 and 2 % of the pixels. Classes are
/// constants and have no gradient. Source: `build_frequency_target` of the official SplatWeaver code.
pub fn frequency_targets<T: Real>(energy: &[T], quantiles: &[f64], pool: &Pool, classes: &mut [u32]) {
    assert_eq!(energy.len(), classes.len(), "frequency_targets: one class per pixel");
    classes.fill(0);
    if energy.is_empty() {
        return;
    }
    let mut scratch = pool.copy_of(energy);
    for &q in quantiles {
        let threshold = quantile(&mut scratch, q);
        for (class, e) in classes.iter_mut().zip(energy) {
            *class += u32::from(*e >= threshold);
        }
    }
}

/// The cross entropy of the router's logits against the [`frequency_targets`] of one scene, a scalar.
///
/// It is `-mean_p sum_e t_pe ln softmax(logits_p)_e`, where t has `1 - smoothing + smoothing / E` on the class and
/// `smoothing / E` elsewhere.
///
/// `logits` are `[P, E]`, raw; `energy` holds P numbers in the same order. Differentiable in the logits; the targets
/// are constants. Source: ranking loss of the official SplatWeaver code, with quantiles 0.76, 0.96, 0.98 and smoothing
/// 0.1.
#[track_caller]
pub fn ranking_cross_entropy<'t, T: Real>(
    logits: Var<'t, T>,
    energy: Var<'t, T>,
    quantiles: &[f64],
    smoothing: f64,
) -> Var<'t, T> {
    let pool = logits.tape().pool();
    let mut classes = pool.buffer(energy.shape().len());
    frequency_targets(&energy.value(), quantiles, pool, &mut classes);
    cross_entropy(logits, &classes, smoothing)
}
