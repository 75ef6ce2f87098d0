//! Checkpoints of a training: the stage, the step and the optimizer's state.

use crate::Error;
use std::collections::BTreeMap;
use weaver_nn::Moments;

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
    /// An error: training never reached the checkpoint's position.
    pub(crate) fn wrong_stage(&self) -> Error {
        Error::Stage { found: self.stage.clone() }
    }
}
