//! Outputs of encoders.

use weaver_autograd::{Outputs, Real, Var};

/// Features and scores of a batch of videos.
#[derive(Clone, Copy, Debug)]
pub struct Encoded<'t, T: Real = f32> {
    /// Task-aware features, `[B, T, F]`.
    pub features: Var<'t, T>,
    /// Scores, `[B, T]` in (0, 1).
    pub scores: Var<'t, T>,
    /// A score for each class, `[B, T, C]` in (0, 1); `None` for encoders without heads for classes.
    pub class_scores: Option<Var<'t, T>>,
}

impl<T: Real> Outputs<T> for Encoded<'_, T> {
    fn for_each_var(&self, visit: &mut dyn FnMut(Var<'_, T>)) {
        (self.features, self.scores, self.class_scores).for_each_var(visit);
    }
}
