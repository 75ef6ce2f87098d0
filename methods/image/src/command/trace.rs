//! Log and checkpoints of a fit to one file, for a live page.

use crate::command::job::KIND;
use crate::command::state::insert;
use crate::{FitState, Progress};
use std::path::Path;
use std::sync::atomic::AtomicBool;
use tempfile::TempDir;
use weaver_command::Failure;
use weaver_io::safetensors::Tensors;
use weaver_run::{Folder, Recorder, Rhythm, Scalar, StepReport};

/// A temporary folder for log and checkpoints, removed with this value: a fit of one file has no run folder.
pub struct TraceFolder {
    folder: Folder,
    // Dropped last.
    _temporary: TempDir,
}

impl TraceFolder {
    pub fn new() -> Result<Self, Failure> {
        let temporary = tempfile::Builder::new().prefix("splatweaver-").tempdir()?;
        let mut folder = Folder::claim(temporary.path(), KIND, [""; 0])?;
        folder.follow();
        Ok(Self { folder, _temporary: temporary })
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }
}

/// Log and checkpoints of the trials of a fit.
pub struct Trace<'a> {
    recorder: Recorder<'a>,
    /// Number of trials so far.
    trials: usize,
    /// Steps of a trial, and the most of all trials.
    steps: [usize; 2],
}

impl<'a> Trace<'a> {
    /// A trace of at most `trials` trials of `steps` steps.
    pub fn new(traces: &'a TraceFolder, [steps, trials]: [usize; 2], stop: &'a AtomicBool) -> Result<Self, Failure> {
        let recorder = Recorder::open(&traces.folder, 0, Rhythm::default(), stop)?;
        Ok(Self { recorder, trials: 0, steps: [steps, steps * trials] })
    }

    /// Begins another trial.
    pub fn begin(&mut self) {
        self.trials += 1;
    }

    /// Records a step of the trial.
    pub fn record(&mut self, at: Progress, state: &FitState) -> Result<(), Failure> {
        let [steps, of] = self.steps;
        let step = (self.trials - 1) * steps + at.step;
        let stage = if of > steps { format!("trial {}", self.trials) } else { String::new() };
        let scalars = vec![Scalar::last("gaussians", at.gaussians as f64)];
        self.recorder.log(&StepReport { step, of, stage, loss: at.loss, scalars })?;
        if self.recorder.is_due(step) {
            self.recorder.save(|| {
                let mut tensors = Tensors::default();
                insert(state, &mut tensors);
                Ok::<_, Failure>(tensors)
            })?;
        }
        Ok(())
    }
}
