//! A training under way: what it has learned, and where it is.

use crate::detector::Detector;
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use weaver_autograd::Params;
use weaver_io::safetensors::{Tensor, Tensors};
use weaver_nn::{AdamW, Moments};

/// Names of the optimizer's tensors and of the place in the file.
const FIRST: &str = "optimizer.first.";
const SECOND: &str = "optimizer.second.";
const STEPS: &str = "vad.optimizer.steps";
const STAGE: &str = "vad.stage";
const STEP: &str = "vad.step";

/// What has been learned up to a step.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot<'a> {
    pub(crate) detector: &'a Detector,
    pub(crate) optimizer: &'a AdamW,
    pub(crate) stage: &'a str,
    pub(crate) step: usize,
}

impl Snapshot<'_> {
    /// Writes a file to go on from, atomically; `told` is kept with it.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, path: &Path, told: &str) -> Result<()> {
        let mut tensors = self.detector.tensors(told);
        let mut steps = BTreeMap::new();
        for (name, taken, Moments { first, second, .. }) in self.optimizer.state(self.detector.params()) {
            tensors.insert(format!("{FIRST}{name}"), &[first.len()], first.clone());
            tensors.insert(format!("{SECOND}{name}"), &[second.len()], second.clone());
            steps.insert(name, taken);
        }
        // All parameters of a stage take all its steps, but for those that a step gives no gradient.
        let steps: Vec<String> = steps.iter().map(|(name, taken)| format!("{name}={taken}")).collect();
        let metadata = [(STEPS, steps.join(",")), (STAGE, self.stage.into()), (STEP, self.step.to_string())];
        tensors.metadata.extend(metadata.map(|(key, value)| (key.into(), value)));
        Ok(tensors.write(path)?)
    }
}

/// Where a training was, read back: what the optimizer knew, the stage and the steps of it that were done.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    pub(crate) stage: String,
    pub(crate) step: usize,
    state: BTreeMap<String, (u64, Moments<f32>)>,
    path: PathBuf,
}

impl Checkpoint {
    /// Reads what [`Snapshot::write`] wrote: the detector as it was, where it was, and what was kept with it.
    ///
    /// # Errors
    /// When the file cannot be read or is no checkpoint.
    pub fn read(path: &Path) -> Result<(Detector, Self, String)> {
        let mut tensors = Tensors::read(path)?;
        let mut moments: BTreeMap<String, Tensor> = BTreeMap::new();
        for (name, tensor) in std::mem::take(&mut tensors.tensors) {
            let into = if name.starts_with("optimizer.") { &mut moments } else { &mut tensors.tensors };
            into.insert(name, tensor);
        }
        let told = |key: &str| {
            let missing = || Error::invalid(path, "metadata", format!("`{key}`, as in checkpoints"), "none");
            tensors.metadata.get(key).cloned().ok_or_else(missing)
        };
        let number = |key: &str, text: &str| {
            text.parse::<u64>().map_err(|_| Error::invalid(path, key, "a number of steps", text))
        };
        let (stage, step) = (told(STAGE)?, number(STEP, &told(STEP)?)? as usize);
        let mut state = BTreeMap::new();
        for taken in told(STEPS)?.split(',').filter(|taken| !taken.is_empty()) {
            let (name, count) = taken.rsplit_once('=').unwrap_or((taken, ""));
            let mut part = |prefix: &str| {
                let key = format!("{prefix}{name}");
                let values = moments.remove(&key).and_then(|tensor| tensor.data.widened().map(|x| x.into_owned()));
                values.ok_or_else(|| Error::invalid(path, &key, "an F32 tensor", "none"))
            };
            let (first, second) = (part(FIRST)?, part(SECOND)?);
            state.insert(name.into(), (number(STEPS, count)?, Moments { first, second, row_steps: Vec::new() }));
        }
        let (detector, kept) = Detector::of_tensors(&tensors, path)?;
        Ok((detector, Self { stage, step, state, path: path.to_path_buf() }, kept))
    }

    /// The stage it was in, and the steps of it that were done.
    pub fn place(&self) -> (&str, usize) {
        (&self.stage, self.step)
    }

    /// Gives the optimizer what it knew.
    pub(crate) fn restore(self, params: &Params<f32>, optimizer: &mut AdamW) -> Result<()> {
        let Self { state, path, .. } = self;
        let fits = |error| Error::invalid(&path, "optimizer", "moments of the parameters", error);
        optimizer.set_state(params, state).map_err(fits)
    }

    /// That training never came to where this was.
    pub(crate) fn strange(&self) -> Error {
        Error::invalid(&self.path, "stage", "one of this training", &self.stage)
    }
}
