//! Training without the type of its recipe.

use crate::{DryRun, Error, Observer, Ranks, Recipe, Session, Summary};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use weaver_run::{Folder, StepReport};
use weaver_splat::AnyRasterizer;

/// A training run of some model.
pub trait Training: Send {
    /// Steps done and steps planned.
    fn steps(&self) -> (usize, usize);

    /// A description of the run for people.
    fn plan(&self) -> String;

    /// See [`Session::draw_by`].
    fn draw_by(&mut self, rasterizer: AnyRasterizer<f32>);

    /// See [`Session::trace_to`].
    fn trace_to(&mut self, path: &Path);

    /// See [`Session::share`].
    ///
    /// # Errors
    /// When the processes do not hold the same run, or there are too many.
    fn share(&mut self, ranks: Arc<dyn Ranks>) -> Result<(), Error>;

    /// See [`Session::follow`].
    ///
    /// # Errors
    /// When a loss diverges.
    fn follow(&mut self) -> Result<(), Error>;

    /// See [`Session::dry_run`].
    ///
    /// # Errors
    /// As [`Training::train`].
    fn dry_run(self: Box<Self>, folder: &Folder) -> Result<DryRun, Error>;

    /// See [`Session::train`].
    ///
    /// # Errors
    /// When a loss diverges or something cannot be written.
    fn train(&mut self, folder: &Folder, observer: &mut dyn Observer, stop: &AtomicBool) -> Result<Summary, Error>;

    /// Label of a progress bar beside the step.
    fn labeler(&self) -> fn(&StepReport) -> String;
}

impl<R: Recipe> Training for Session<R> {
    fn steps(&self) -> (usize, usize) {
        self.steps()
    }

    fn plan(&self) -> String {
        self.plan()
    }

    fn draw_by(&mut self, rasterizer: AnyRasterizer<f32>) {
        self.draw_by(rasterizer);
    }

    fn trace_to(&mut self, path: &Path) {
        self.trace_to(path);
    }

    fn share(&mut self, ranks: Arc<dyn Ranks>) -> Result<(), Error> {
        self.share(ranks)
    }

    fn follow(&mut self) -> Result<(), Error> {
        self.follow()
    }

    fn dry_run(self: Box<Self>, folder: &Folder) -> Result<DryRun, Error> {
        Session::dry_run(*self, folder)
    }

    fn train(&mut self, folder: &Folder, observer: &mut dyn Observer, stop: &AtomicBool) -> Result<Summary, Error> {
        self.train(folder, observer, stop)
    }

    fn labeler(&self) -> fn(&StepReport) -> String {
        R::label
    }
}
