//! Runs that leave out steps, so that they end in time.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Steps that are left out of the rest of a run: of those from number `at` on, `kept` are taken, evenly spread.
///
/// Steps keep their numbers, and what is planned by numbers goes on as planned, density control among it. Rates fall by
/// the steps that are taken.
#[derive(Clone, Copy, Debug, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Thinning {
    /// Number of the first step that may be left out.
    pub at: usize,
    /// Steps that are taken from there to the end of the run.
    pub kept: usize,
    /// The most Gaussians from there on, where fewer steps mean fewer of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gaussians: Option<usize>,
}

impl Thinning {
    /// Steps that are left out of the rest of the run.
    pub fn new(at: usize, kept: usize) -> Self {
        Self { at, kept, gaussians: None }
    }

    /// Steps taken from `at` to before number `step` in a run of so many steps.
    ///
    /// ```
    /// use weaver_fit::Thinning;
    /// // Of 10 steps every second one from the fourth on: 4, 6 and 8.
    /// let thinning = Thinning::new(4, 3);
    /// assert_eq!([4, 6, 8, 10].map(|step| thinning.taken(step, 10)), [0, 1, 2, 3]);
    /// assert_eq!([4, 6, 8].map(|step| thinning.next(step, 10)), [6, 8, 10]);
    /// ```
    pub fn taken(&self, step: usize, steps: usize) -> usize {
        let left = steps.saturating_sub(self.at).max(1);
        step.saturating_sub(self.at) * self.kept.min(left) / left
    }

    /// Number of the step after number `step`, in a run of so many steps.
    pub fn next(&self, step: usize, steps: usize) -> usize {
        let left = steps.saturating_sub(self.at).max(1);
        let kept = self.kept.clamp(1, left);
        self.at + ((self.taken(step, steps) + 1) * left).div_ceil(kept)
    }
}
