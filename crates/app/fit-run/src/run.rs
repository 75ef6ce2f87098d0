//! A fit of a capture, under way.

use crate::compressed;
use crate::fitting::Fitting;
use crate::loaded::{Loaded, load};
use crate::{Coverage, Matching, RunError, RunFile, RunSettings};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;
use weaver_fit::{ColorAgreement, Fit, FitRasterizer, Judge, steps_in};
use weaver_io::SceneFormat;
use weaver_run::{Folder, Kind, StepReport};
use weaver_scene::{Gaussians, Photo};
use weaver_view::Shot;

/// A run under way. Its folder is its own until this value is dropped.
#[derive(Debug)]
pub struct Run(pub(crate) weaver_run::Run<Fitting>);

/// The Gaussians that a run began with.
const INIT: &str = "init.ply";
/// The folder of the cameras and points as COLMAP has them.
pub(crate) const MODEL: &str = "sparse/0";
const KIND: Kind = Kind {
    command: "fit",
    settings: RunFile::NAME,
    results: &[
        "scene.ply",
        crate::view::FILE,
        "transforms.json",
        "sparse/0/cameras.bin",
        "sparse/0/images.bin",
        "sparse/0/points3D.bin",
    ],
};

impl Run {
    /// Claims a folder for a run that reads these files and folders. Meant to be called before any other work.
    ///
    /// # Errors
    /// As [`Folder::claim`].
    pub fn claim<P: AsRef<Path>>(folder: &Path, inputs: impl IntoIterator<Item = P>) -> Result<Folder, RunError> {
        Ok(Folder::claim(folder, KIND, inputs)?)
    }

    /// Claims a folder and begins a run in it: [`claim`](Self::claim), with the capture as what is read, and [`begin`](Self::begin).
    ///
    /// # Errors
    /// As these two.
    pub fn create(
        folder: &Path,
        settings: RunSettings,
        given: Option<&Gaussians>,
        judge: Judge,
        rasterizer: Arc<dyn FitRasterizer>,
    ) -> Result<Self, RunError> {
        Self::begin(Self::claim(folder, [&settings.capture])?, settings, given, judge, rasterizer)
    }

    /// Begins a run in a folder that was [claimed](Self::claim). `given` are the Gaussians of [`Initial::Given`](crate::Initial::Given); `rasterizer` draws.
    ///
    /// With [`RunSettings::minutes`], the number of steps is chosen now, such that the run, results included, ends in time if
    /// the machine goes on as fast, but for [`RunSettings::least_steps`]; it is written down, so that the run can be repeated to the same bits.
    ///
    /// # Errors
    /// When the capture cannot be read or gives nothing to fit, a setting is out of range, or a file cannot be written; nothing is then
    /// left behind.
    pub fn begin(
        folder: Folder,
        mut settings: RunSettings,
        given: Option<&Gaussians>,
        judge: Judge,
        rasterizer: Arc<dyn FitRasterizer>,
    ) -> Result<Self, RunError> {
        let started = Instant::now();
        folder.out().check(further(&settings))?;
        settings.fit.check()?;
        settings.capture = std::path::absolute(&settings.capture).unwrap_or(settings.capture);
        let capture = load(&mut settings, given, rasterizer)?;
        let mut job = Fitting::new(settings, capture, judge, started);
        if let Some(minutes) = job.settings.minutes {
            let reserve = job.seconds_of_results()?;
            let left = 60.0 * minutes - started.elapsed().as_secs_f64() - reserve;
            let enough = steps_in(&mut job.capture.fit, left.max(0.0))?;
            let steps = enough.max(job.settings.least_steps);
            let few = format!("{minutes:.2} minutes are enough for {enough} steps");
            if steps > enough {
                job.capture.remarks.push(format!("{few}; {steps} are made, which takes longer"));
            } else if steps < job.fit().photos() {
                job.capture.remarks.push(format!(
                    "{few}, fewer than there are photos; judging them at the end is counted as {reserve:.1} s"
                ));
            }
            job.capture.fit.set_steps(steps);
            job.settings.fit.steps = steps;
        }
        if let Some(given) = given.or(job.capture.found.take().as_ref()) {
            weaver_io::write_gaussians(folder.out().file(INIT)?, given)?;
        }
        let Loaded { sources, coverage, .. } = &job.capture;
        let file = RunFile { settings: job.settings.clone(), sources: sources.clone(), coverage: coverage.clone() };
        folder.store_text(&file.text(folder.path())?)?;
        Ok(Self(weaver_run::Run::begin(folder, job)))
    }

    /// Goes on with a run from its last checkpoint, or from the start if there is none.
    ///
    /// # Errors
    /// When there is no run or it is under way elsewhere, its files or its capture cannot be read, or they no longer belong together.
    pub fn resume(folder: &Path, judge: Judge, rasterizer: Arc<dyn FitRasterizer>) -> Result<Self, RunError> {
        let started = Instant::now();
        let RunFile { mut settings, sources, coverage } = RunFile::read(folder)?;
        let given = folder.join(INIT);
        let further = further(&settings).chain([INIT.into()]);
        let folder = Folder::reopen_with(folder, KIND, further)?;
        let given = given.exists().then(|| weaver_io::read_gaussians(&given)).transpose()?;
        let mut capture = load(&mut settings, given.as_ref(), rasterizer)?;
        capture.coverage = coverage;
        capture.sources.check(&sources, &settings.capture, &folder.path().join(RunFile::NAME))?;
        Ok(Self(weaver_run::Run::resume(folder, Fitting::new(settings, capture, judge, started))?))
    }

    /// The optimization alone, at its beginning, drawn by `rasterizer`: nothing is written.
    ///
    /// # Errors
    /// When the capture cannot be read or gives nothing to fit, or a setting is out of range.
    pub fn optimization(settings: &RunSettings, rasterizer: Arc<dyn FitRasterizer>) -> Result<Fit, RunError> {
        Ok(load(&mut settings.clone(), None, rasterizer)?.fit)
    }

    /// The settings, with the number of steps.
    pub fn settings(&self) -> &RunSettings {
        &self.0.job.settings
    }

    /// The optimization.
    pub fn fit(&self) -> &Fit {
        self.0.job.fit()
    }

    /// Agreement of photos about points, if cameras are refined.
    pub fn matching(&self) -> Option<Matching> {
        self.0.job.capture.matching
    }

    /// True if photos agree about the colors of points that they share.
    pub fn colors(&self) -> &ColorAgreement {
        &self.0.job.capture.colors
    }

    /// The part of each photo that others show too.
    pub fn coverage(&self) -> &Coverage {
        &self.0.job.capture.coverage
    }

    /// Remarks for the user about how the capture was loaded.
    pub fn remarks(&self) -> &[String] {
        &self.0.job.capture.remarks
    }

    /// The photos that are held out.
    pub fn held_out(&self) -> &[Photo] {
        &self.0.job.capture.held_out
    }

    /// The cameras of the photos as they are now, held-out ones first as they were given, and the photos of some of them: for a page to look at.
    ///
    /// # Errors
    /// When a photo cannot be encoded.
    pub fn shots(&self) -> Result<Vec<Shot>, RunError> {
        let given: Vec<_> = self.held_out().iter().map(|photo| photo.camera).collect();
        crate::view::shots(&self.0.job, &given)
    }

    /// Seconds since the run began, those of earlier sessions included.
    pub fn seconds(&self) -> f64 {
        self.0.job.seconds()
    }

    /// Lets a page follow the run: [`Folder::follow`].
    pub fn follow(&mut self) {
        self.0.folder.follow();
    }

    /// Runs to the last step, or until `stop` is set, and leaves a checkpoint. `observe` is called after every step.
    ///
    /// # Errors
    /// As [`Fit::step`](weaver_fit::Fit::step), and when a file cannot be written; the last checkpoint then stays as it was.
    pub fn advance(&mut self, stop: &AtomicBool, mut observe: impl FnMut(&StepReport)) -> Result<(), RunError> {
        self.0.advance(stop, |report| {
            observe(report);
            Ok(())
        })?;
        Ok(())
    }
}

/// The files of the scene beside `scene.ply`.
fn further(settings: &RunSettings) -> impl Iterator<Item = String> {
    settings.formats.iter().map(file_of_scene).chain(settings.compress.map(|_| compressed::FILE.into()))
}

/// The file of the scene in this format.
pub(crate) fn file_of_scene(format: &SceneFormat) -> String {
    format!("scene.{}", format.extension)
}
