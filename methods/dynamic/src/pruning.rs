//! Scores of a mixture's Gaussians for pruning.

use crate::{Gated, PixelRouter, Shot};
use weaver_autograd::{Params, Real, Tape};
use weaver_nn::Context;
use weaver_splat::GaussianVars;

/// Score of a mixture's Gaussian.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Score {
    /// Contribution to the picture it makes: sum_u G_k T_i alpha_i over the pixels, k its expert. Ours.
    #[default]
    Contribution,
    /// Dependence of the gate on it: |d sum_u G_k / d(w, w_dir, w_time)|, as published (equation 10). It vanishes under
    /// a certain gate, and drops even a region's only Gaussians.
    Sensitivity,
}

/// Draws the list of all Gaussians for a tape, at the time of a shot, without gradients.
pub type Drawn<'a, T> = dyn for<'t> Fn(Context<'t, '_, T>) -> (GaussianVars<'t, T>, Shot<'a, 't, T>) + 'a;

/// The score of each Gaussian of the list in one view at one time `[N]`; sum over views for [`Score::Contribution`],
/// take the mean for [`Score::Sensitivity`].
pub fn scores<T: Real>(router: &PixelRouter, params: &Params<T>, score: Score, drawn: &Drawn<'_, T>) -> Vec<f64> {
    match score {
        Score::Contribution => contributions(router, params, drawn),
        Score::Sensitivity => sensitivities(router, params, drawn),
    }
}

/// The gradient by w of sum_k sum_u G_k W_k0, the gate held constant: each Gaussian's addition to its expert's map,
/// times the gate.
fn contributions<T: Real>(router: &PixelRouter, params: &Params<T>, drawn: &Drawn<'_, T>) -> Vec<f64> {
    let tape = Tape::new();
    let cx = Context::new(&tape, params);
    let (gaussians, shot) = drawn(cx);
    let Gated { maps, gate, .. } = router.gated(cx, &gaussians, &shot);
    (maps.slice(2, 0, 1).reshape(gate.shape()) * gate.detach()).sum().backward();
    let gradient = tape.param_grad(router.base());
    gradient.map_or(Vec::new(), |gradient| gradient.chunks(2).map(|row| row[0].to_f64()).collect())
}

/// Lengths of the gradients of each expert's gate by the carried numbers of its own Gaussians.
fn sensitivities<T: Real>(router: &PixelRouter, params: &Params<T>, drawn: &Drawn<'_, T>) -> Vec<f64> {
    let mut all = vec![0.0; router.rows().iter().map(Vec::len).sum()];
    for (expert, rows) in router.rows().iter().enumerate() {
        let tape = Tape::new();
        let cx = Context::new(&tape, params);
        let (gaussians, shot) = drawn(cx);
        router.gated(cx, &gaussians, &shot).gate.slice(0, expert, 1).sum().backward();
        let [base, time] = [router.base(), router.time()].map(|id| tape.param_grad(id));
        for row in rows {
            let row = *row as usize;
            let of = |gradient: Option<&[T]>, i: usize| gradient.map_or(0.0, |g| g[i].to_f64());
            let parts = [of(base.as_deref(), 2 * row), of(base.as_deref(), 2 * row + 1), of(time.as_deref(), row)];
            all[row] = parts.iter().map(|x| x * x).sum::<f64>().sqrt();
        }
    }
    all
}

/// The best `share` of the Gaussians by their scores, in the order of the list; the first of equal ones.
///
/// # Panics
/// Unless the share is above 0 and at most 1.
///
/// ```
/// assert_eq!(weaver_dynamic::best(&[0.1, 0.5, 0.0, 0.5], 0.5), [1, 3]);
/// ```
pub fn best(scores: &[f64], share: f64) -> Vec<u32> {
    assert!(share > 0.0 && share <= 1.0, "a share above 0 and at most 1, found {share}");
    let kept = ((share * scores.len() as f64).round() as usize).min(scores.len());
    let mut order: Vec<u32> = (0..scores.len() as u32).collect();
    order.sort_by(|a, b| scores[*b as usize].total_cmp(&scores[*a as usize]).then(a.cmp(b)));
    order.truncate(kept);
    order.sort_unstable();
    order
}
