//! Losses on the router, of any model that has one.

use super::{BudgetForm, RouterLosses};
use crate::Terms;
use weaver_autograd::Var;
use weaver_losses as losses;

/// The routing of one tuple's context.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Routed<'a, 't> {
    /// The router's logits `[P, E]`.
    pub logits: Var<'t, f32>,
    /// Wavelet energy `[P]`.
    pub energy: Var<'t, f32>,
    /// The straight-through choice `[P, E]`, if the router made it.
    pub choice: Option<Var<'t, f32>>,
    /// Renders of the context `[V, 3, H, W]`.
    pub own: Var<'t, f32>,
    /// Its photos `[V, 3, H, W]`.
    pub photos: Var<'t, f32>,
    /// Which pixels count `[P]`; `None` if all do.
    pub inside: Option<&'a [bool]>,
}

impl RouterLosses {
    /// Adds the losses of one tuple, which counts `share`; `ranking` is true while the ranking loss is on.
    pub(crate) fn add<'t>(&self, terms: &mut Terms<'t>, share: f64, ranking: bool, routed: &Routed<'_, 't>) {
        let &Routed { logits, energy, choice, own, photos, inside } = routed;
        let among: Option<Vec<u32>> =
            inside.map(|inside| (0..).zip(inside).filter(|(_, inside)| **inside).map(|(pixel, _)| pixel).collect());
        let counted = |rows: Var<'t, f32>| among.as_ref().map_or(rows, |among| rows.gather_rows(among));
        if ranking {
            terms.add("rank", self.rank, share, || {
                let (quantiles, smoothing) = (&self.rank_quantiles, self.label_smoothing);
                losses::ranking_cross_entropy(counted(logits), counted(energy), quantiles, smoothing)
            });
        }
        if let Some(choice) = choice.map(counted) {
            terms.add("budget", self.budget, share, || {
                let shares = match self.budget_form {
                    BudgetForm::Shares => true,
                    BudgetForm::Limit => false,
                    BudgetForm::SharesThenLimit => ranking,
                };
                if shares {
                    losses::share_budget(choice, &self.budget_shares)
                } else {
                    losses::global_budget(choice, self.budget_limit)
                }
            });
        }
        terms.add("error_regression", self.error_regression, share, || {
            let score = logits.slice(1, 1, 1) - logits.slice(1, 0, 1);
            let error = own.tape().without_gradient(|| (own.detach() - photos).square().mean_axis(1));
            losses::error_regression(score.reshape(error.shape()), error.detach(), among.as_deref())
        });
    }
}
