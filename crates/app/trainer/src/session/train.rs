//! A session as a run in a folder.

use super::Session;
use crate::figures::Summary;
use crate::observe::{CURVES, Observer, page};
use crate::{Error, Recipe, TrainingState, evaluate, samples};
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Instant;
use weaver_data::Scene;
use weaver_inference::{Checkpoint, RunFolder};
use weaver_io::safetensors::Tensors;
use weaver_run::{Folder, Job, Log, Rhythm, Save, StepReport, advance};

impl<R: Recipe> Session<R> {
    /// Trains to the end, or until `stop` is set, and writes the files of the run folder.
    ///
    /// # Errors
    /// When a loss diverges or something cannot be written. A checkpoint of an earlier step is never lost.
    pub fn train(&mut self, folder: &Folder, observer: &mut dyn Observer, stop: &AtomicBool) -> Result<Summary, Error> {
        let started = Instant::now();
        folder.out().file(SAMPLES)?;
        if !folder.checkpoint_path().exists() {
            folder.save(&self.tensors())?;
        }
        let finished = advance(self, folder, stop, |report| observer.step(report)).map_err(|error| match error {
            Error::Numeric { step, term, value, .. } => {
                Error::Numeric { step, term, value, last_good: Some(folder.checkpoint_path()) }
            }
            error => error,
        })?;
        self.announce(false);
        if finished {
            self.sample(folder)?;
        }
        let evaluation = if finished { Some(self.evaluate_some(usize::MAX)?) } else { None };
        let summary = Summary {
            preset: self.config.preset.clone(),
            seed: self.config.seed,
            steps: self.step,
            planned: self.config.steps(),
            parameters: self.params.count(),
            seconds: started.elapsed().as_secs_f64(),
            checksum: self.checksum(),
            evaluation,
        };
        folder.summarize(&summary)?;
        folder.report(page(R::ARCHITECTURE, folder.path(), &summary)?.curves(&folder.records()?, &CURVES))?;
        Ok(summary)
    }

    /// Everything needed to go on, and for inference.
    pub(super) fn tensors(&self) -> Tensors {
        let state = TrainingState { params: &self.params, optimizer: &self.optimizer, ema: &self.ema };
        state.tensors(&self.config, self.step, &self.sources)
    }

    /// Writes a checkpoint.
    ///
    /// # Errors
    /// When it cannot be written; an earlier one is then left as it was.
    pub fn save(&self, path: &Path) -> Result<(), Error> {
        Ok(self.tensors().write(path)?)
    }

    /// Takes the session to the state of a checkpoint of the same run.
    pub(super) fn go_to(&mut self, checkpoint: &Checkpoint) -> Result<(), Error> {
        self.sources.check(checkpoint, &self.config)?;
        TrainingState::restore(checkpoint, &mut self.params, &mut self.optimizer, &mut self.ema)?;
        self.step = checkpoint.step;
        Ok(())
    }

    pub(super) fn sample(&self, folder: &Folder) -> Result<(), Error> {
        folder.out().file(SAMPLES)?;
        let path = RunFolder::at(folder.path()).sample_path(self.step);
        samples::write(&mut *self.predictor()?, &self.options(), &self.scenes, &path)
    }

    /// Evaluates at most `most` scenes.
    pub(super) fn evaluate_some(&self, most: usize) -> Result<crate::Evaluation, Error> {
        let mut predictor = self.predictor()?;
        let with_held_out = self.scenes.iter().filter(|s| !s.held_out_views().is_empty());
        let held_out: Vec<&Scene> = with_held_out.take(most).collect();
        evaluate::evaluate(&mut *predictor, &held_out, &self.options(), None, &mut |_, _| {})
    }
}

/// The folder of sample pictures.
pub(crate) const SAMPLES: &str = "samples/";

impl<R: Recipe> Job for Session<R> {
    type Error = Error;

    fn steps(&self) -> [usize; 2] {
        [self.step, self.config.steps()]
    }

    fn step(&mut self) -> Result<StepReport, Error> {
        let [step, _] = Job::steps(self);
        self.announce(true);
        self.advance()?.ok_or_else(|| Error::Input(format!("step {step}: expected one of the run, which is complete")))
    }

    fn state(&mut self) -> Result<Tensors, Error> {
        Ok(self.tensors())
    }

    fn restore(&mut self, state: &Tensors) -> Result<(), Error> {
        let checkpoint = Checkpoint::of(state.clone())?;
        TrainingState::check_resumed(&checkpoint, &self.config)?;
        self.go_to(&checkpoint)
    }

    fn rhythm(&self) -> Rhythm {
        let output = &self.config.output;
        Rhythm { log: Log::Every(output.log_every), save: Save::Steps(output.checkpoint_every) }
    }

    fn stepped(&mut self, folder: &Folder) -> Result<(), Error> {
        match self.step.is_multiple_of(self.config.output.sample_every) {
            true => self.sample(folder),
            false => Ok(()),
        }
    }
}
