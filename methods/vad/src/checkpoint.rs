//! Checkpoints of a training: the detector, the optimizer's state and the step.

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
    /// Finished steps of the stage.
    pub step: usize,
}

impl Snapshot<'_> {
    /// A checkpoint, with a copy of the detector.
    pub fn checkpoint(&self) -> Checkpoint {
        let state = self.optimizer.state(self.detector.params());
        let state = state.map(|(name, steps, moments)| (name.to_string(), (steps, moments.clone()))).collect();
        Checkpoint { stage: self.stage.into(), step: self.step, state }
    }
}

/// Position of a training, and the state of its optimizer.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// The stage.
    pub stage: String,
    /// Finished steps of the stage.
    pub step: usize,
    /// Steps and moments of the optimizer of the stage, by the names of parameters.
    pub state: BTreeMap<String, (u64, Moments<f32>)>,
}

impl Checkpoint {
    /// Restores the optimizer's state.
    pub(crate) fn restore(self, params: &Params<f32>, optimizer: &mut AdamW) -> Result<()> {
        Ok(optimizer.set_state(params, self.state)?)
    }

    /// An error: training never reached the checkpoint's position.
    pub(crate) fn wrong_stage(&self) -> Error {
        Error::Stage { found: self.stage.clone() }
    }
}
