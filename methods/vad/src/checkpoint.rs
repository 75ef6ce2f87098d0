//! A training under way: what it has learned, and where it is.

use crate::detector::Detector;
use crate::{Error, Result};
use std::collections::BTreeMap;
use weaver_autograd::Params;
use weaver_nn::{AdamW, Moments};

/// State of the training at a step.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot<'a> {
    /// The detector.
    pub detector: &'a Detector,
    /// The optimizer of the stage.
    pub optimizer: &'a AdamW,
    /// The stage.
    pub stage: &'a str,
    /// Steps of it done.
    pub step: usize,
}

impl Snapshot<'_> {
    /// A copy to go on from, with one of the detector.
    pub fn checkpoint(&self) -> Checkpoint {
        let state = self.optimizer.state(self.detector.params());
        let state = state.map(|(name, steps, moments)| (name.to_string(), (steps, moments.clone()))).collect();
        Checkpoint { stage: self.stage.into(), step: self.step, state }
    }
}

/// Where a training was.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// The stage.
    pub stage: String,
    /// Steps of it that were done.
    pub step: usize,
    /// Steps and moments of the optimizer of the stage, by the names of parameters.
    pub state: BTreeMap<String, (u64, Moments<f32>)>,
}

impl Checkpoint {
    /// Gives the optimizer its state.
    pub(crate) fn restore(self, params: &Params<f32>, optimizer: &mut AdamW) -> Result<()> {
        Ok(optimizer.set_state(params, self.state)?)
    }

    /// An error: training never came to where this was.
    pub(crate) fn wrong_stage(&self) -> Error {
        Error::Stage { found: self.stage.clone() }
    }
}
