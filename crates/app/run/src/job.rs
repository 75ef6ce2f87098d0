//! Work in steps that can be stopped and gone on with.

use crate::{Error, Folder, Recorder, Rhythm, StepReport};
use std::sync::atomic::AtomicBool;
use weaver_io::safetensors::Tensors;

/// Work in steps, independent of files.
///
/// A job at its beginning that is given the [state](Self::state) of another after `n` steps goes on to the same bits as
/// that one.
pub trait Job {
    /// Why a step fails.
    type Error: From<Error>;

    /// Steps done, and steps of the whole work, which may turn out to be fewer on the way.
    fn steps(&self) -> [usize; 2];

    /// Does the next step.
    ///
    /// # Errors
    /// When it cannot be done; the state is then as before the step.
    fn step(&mut self) -> Result<StepReport, Self::Error>;

    /// Everything needed to go on.
    ///
    /// # Errors
    /// When it cannot be had, as from a device that is lost.
    fn state(&mut self) -> Result<Tensors, Self::Error>;

    /// Takes the job back to a state.
    ///
    /// # Errors
    /// When the state is of other work.
    fn restore(&mut self, state: &Tensors) -> Result<(), Self::Error>;

    /// Intervals of logging and saving.
    fn rhythm(&self) -> Rhythm {
        Rhythm::default()
    }

    /// Writes files of the step just done, such as a sample picture.
    ///
    /// # Errors
    /// When it cannot be written.
    fn stepped(&mut self, folder: &Folder) -> Result<(), Self::Error> {
        let _ = folder;
        Ok(())
    }
}

/// Does the steps of a job to the last, or until `stop` is set, and leaves a checkpoint; true if it came to the end.
/// `observe` is called after every step.
///
/// # Errors
/// As [`Job::step`], and when a file cannot be written; the last checkpoint then stays as it was.
pub fn advance<J: Job>(
    job: &mut J,
    folder: &Folder,
    stop: &AtomicBool,
    mut observe: impl FnMut(&StepReport) -> Result<(), J::Error>,
) -> Result<bool, J::Error> {
    let [mut done, mut of] = job.steps();
    let mut recorder = Recorder::open(folder, done, job.rhythm(), stop)?;
    let mut saved = folder.checkpoint_path().exists().then_some(done);
    while done < of && !recorder.stopped() {
        let report = job.step()?;
        recorder.log(&report)?;
        observe(&report)?;
        [done, of] = job.steps();
        if recorder.is_due(done) {
            recorder.save(|| job.state())?;
            saved = Some(done);
        }
        job.stepped(folder)?;
    }
    if saved != Some(done) {
        recorder.save(|| job.state())?;
    }
    Ok(done == of)
}

/// A job in a folder: logged, saved, stopped and gone on with.
#[derive(Debug)]
pub struct Run<J> {
    /// The folder.
    pub folder: Folder,
    /// The work.
    pub job: J,
}

impl<J: Job> Run<J> {
    /// A run of a job at its beginning.
    pub fn begin(folder: Folder, job: J) -> Self {
        Self { folder, job }
    }

    /// Goes on with a run from its last checkpoint, or from the start if there is none; `job` is at its beginning.
    ///
    /// # Errors
    /// When the checkpoint cannot be read, or is of another job.
    pub fn resume(folder: Folder, mut job: J) -> Result<Self, J::Error> {
        if let Some(state) = folder.checkpoint()? {
            job.restore(&state)?;
        }
        Ok(Self { folder, job })
    }

    /// Runs to the last step, or until `stop` is set: [`advance`].
    ///
    /// # Errors
    /// As [`advance`].
    pub fn advance(
        &mut self,
        stop: &AtomicBool,
        observe: impl FnMut(&StepReport) -> Result<(), J::Error>,
    ) -> Result<bool, J::Error> {
        advance(&mut self.job, &self.folder, stop, observe)
    }
}
