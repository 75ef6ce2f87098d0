//! Checkpoints of a training: detector, optimizer and position.

use crate::command::arguments::VadPlan;
use crate::{Checkpoint, Detector, Training};
use serde::{Deserialize, Serialize};
use weaver_command::Failure;
use weaver_io::safetensors::Tensors;
use weaver_run::state::{is_of_optimizer, optimizer_state, put_optimizer};

const STAGE: &str = "vad.stage";
const STEP: &str = "vad.step";

/// Contents of a checkpoint beside the weights.
#[derive(Serialize, Deserialize)]
pub struct RunState {
    pub plan: VadPlan,
    /// Numbers of normal and abnormal videos.
    pub videos: [usize; 2],
    /// A checksum of features and labels; runs of earlier versions have none.
    #[serde(default)]
    pub features: Option<String>,
    /// Finished steps of all stages.
    pub done: usize,
}

/// All tensors for going on.
pub fn write(training: &Training<'_>, run: &RunState) -> Tensors {
    let (detector, (stage, step, optimizer)) = (training.detector(), training.position());
    let mut tensors = detector.tensors(&serde_json::to_string(run).expect("a plan is plain data"));
    put_optimizer(&mut tensors, detector.params(), optimizer);
    tensors.metadata.insert(STAGE.into(), stage.into());
    tensors.metadata.insert(STEP.into(), step.to_string());
    tensors
}

/// Reads a checkpoint.
pub fn read(tensors: &Tensors) -> Result<(Detector, Checkpoint, RunState), Failure> {
    let path = tensors.origin().display().to_string();
    let optimizer = optimizer_state(tensors)?;
    let mut network = tensors.clone();
    network.tensors.retain(|key, _| !is_of_optimizer(key));
    let (detector, metadata) = Detector::of_tensors(&network)?;
    let run: RunState = serde_json::from_str(&metadata)
        .map_err(|error| Failure::message(format!("{path}: expected what was trained, found {error}")))?;
    let value = |key: &str| tensors.metadata.get(key);
    let step = value(STEP).and_then(|step| step.parse().ok());
    let (Some(stage), Some(step)) = (value(STAGE).cloned(), step) else {
        return Err(Failure::message(format!("{path}: metadata: expected `{STAGE}` and `{STEP}`, found none")));
    };
    Ok((detector, Checkpoint { stage, step, state: optimizer }, run))
}
