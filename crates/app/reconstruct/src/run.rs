//! A fit of a capture, under way.

use crate::compressed;
use crate::fitting::{Fitting, INIT, Next};
use crate::gaining::BEFORE;
use crate::keeping::Keeping;
use crate::loaded::load;
use crate::{Coverage, Error, Matching, RunFile, RunSettings};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;
use weaver_fit::{ColorAgreement, Fit, FitError, FitRasterizer, Judge, in_time, steps_in};
use weaver_io::SceneFormat;
use weaver_io::safetensors::Tensors;
use weaver_ranks::{Alone, Ranks, agreed_text};
use weaver_run::{Folder, Job, Kind, StepReport};
use weaver_scene::{Gaussians, Photo};
use weaver_view::Shot;

/// A run under way. Its folder is locked until this value is dropped.
#[derive(Debug)]
pub struct Run(pub(crate) weaver_run::Run<Fitting>);

/// The folder of the cameras and points as COLMAP has them.
pub(crate) const MODEL: &str = "sparse/0";
/// Steps of a run over those that a rehearsal has time for: a scene that is in place has fewer pairs of Gaussian and
/// pixel than one that is rehearsed.
const EASIER: f64 = 1.6;
/// Steps that are planned over those that are expected. What is too much is left out as the pace shows.
const GENEROUS: f64 = 1.5;
/// The folder of masks of transients, which single photos show.
pub(crate) const TRANSIENTS: &str = "transients";
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
    /// The command that the record of written files names.
    pub const COMMAND: &str = KIND.command;
    /// The file of settings. A folder that has it holds a run.
    pub const SETTINGS: &str = KIND.settings;

    /// Claims a folder for a run that reads these files and folders. Meant to be called before any other work.
    ///
    /// # Errors
    /// As [`Folder::claim`].
    pub fn claim<P: AsRef<Path>>(folder: &Path, inputs: impl IntoIterator<Item = P>) -> Result<Folder, Error> {
        let folder = Folder::claim(folder, KIND, inputs)?;
        folder.out().check_folder(TRANSIENTS)?;
        Ok(folder)
    }

    /// Claims a folder and begins a run in it: [`claim`](Self::claim), with the capture as input, and
    /// [`begin`](Self::begin).
    ///
    /// # Errors
    /// As [`claim`](Self::claim) and [`begin`](Self::begin).
    pub fn create(
        folder: &Path,
        settings: RunSettings,
        given: Option<&Gaussians>,
        judge: Judge,
        rasterizer: Arc<dyn FitRasterizer>,
    ) -> Result<Self, Error> {
        Self::begin(Self::claim(folder, [&settings.capture])?, settings, given, judge, rasterizer)
    }

    /// Begins a run in a folder that was [claimed](Self::claim). `given` are the Gaussians of
    /// [`Initial::Given`](crate::Initial::Given); `rasterizer` draws.
    ///
    /// With [`RunSettings::minutes`], the number of steps is chosen now, such that the run, results included, ends in
    /// time if the machine goes on as fast, but for [`RunSettings::least_steps`] and [`RunSettings::most_rounds`].
    /// Where the machine turns out to be slower, steps are [left out](weaver_fit::FitSettings::thinned). Both are
    /// written down, so that the run can be repeated to the same bits.
    ///
    /// # Errors
    /// When the capture cannot be read or gives nothing to fit, a setting is out of range, or a file cannot be written;
    /// nothing is then left behind.
    pub fn begin(
        folder: Folder,
        settings: RunSettings,
        given: Option<&Gaussians>,
        judge: Judge,
        rasterizer: Arc<dyn FitRasterizer>,
    ) -> Result<Self, Error> {
        Self::begin_shared(folder, settings, given, judge, rasterizer, Arc::new(Alone))
    }

    /// [Begins](Self::begin) a run whose steps several processes share; the others [take part](Self::take_part).
    ///
    /// # Errors
    /// As [`begin`](Self::begin), and as [`Fit::share`].
    pub fn begin_shared(
        folder: Folder,
        mut settings: RunSettings,
        given: Option<&Gaussians>,
        judge: Judge,
        rasterizer: Arc<dyn FitRasterizer>,
        ranks: Arc<dyn Ranks>,
    ) -> Result<Self, Error> {
        let started = Instant::now();
        folder.out().check(further(&settings))?;
        settings.check()?;
        settings.fit.check_processes(ranks.size())?;
        settings.capture = std::path::absolute(&settings.capture).unwrap_or(settings.capture);
        let capture = load(&mut settings, given, rasterizer, Some(folder.path()))?;
        let mut job = Fitting::new(settings, capture, judge, started);
        let found = job.capture.found.take();
        let store = |job: &Fitting| {
            let given = given.or(found.as_ref());
            given.map_or(Ok(()), |given| weaver_io::write_gaussians(folder.out().file(INIT)?, given))?;
            job.store(&folder)
        };
        if ranks.size() > 1 {
            // The others read it; the number of steps may still change.
            store(&job)?;
            job.share(ranks, &folder)?;
            job.ranks.agreed(job.settings.minutes.is_some().into());
        }
        if let Some(minutes) = job.settings.minutes {
            job.plan_steps(minutes)?;
        }
        store(&job)?;
        Ok(Self(weaver_run::Run::begin(folder, job)))
    }

    /// True if the run ends before its time is over, for [`RunSettings::most_rounds`].
    pub fn ends_early(&self) -> bool {
        let job = &self.0.job;
        let in_time = job.settings.fit.thinned.is_empty();
        job.settings.minutes.is_some() && in_time && job.most_steps() == Some(job.settings.fit.steps)
    }

    /// Goes on with a run from its last checkpoint, or from the start if there is none.
    ///
    /// # Errors
    /// When there is no run or it is under way elsewhere, its files or its capture cannot be read, or they no longer
    /// belong together.
    pub fn resume(folder: &Path, judge: Judge, rasterizer: Arc<dyn FitRasterizer>) -> Result<Self, Error> {
        Self::resume_shared(folder, judge, rasterizer, Arc::new(Alone))
    }

    /// [Goes on](Self::resume) with a run whose steps several processes share, in any number; the others [take
    /// part](Self::take_part).
    ///
    /// # Errors
    /// As [`resume`](Self::resume), and as [`Fit::share`].
    pub fn resume_shared(
        folder: &Path,
        judge: Judge,
        rasterizer: Arc<dyn FitRasterizer>,
        ranks: Arc<dyn Ranks>,
    ) -> Result<Self, Error> {
        let file = RunFile::read(folder)?;
        if file.settings.gaining.is_some() && ranks.size() > 1 {
            let expected = "1 for a run that goes on for as long as it gains".into();
            let found = ranks.size().to_string();
            return Err(FitError::Setting { key: "processes", expected, found }.into());
        }
        let further = further(&file.settings).chain([INIT.into()]);
        let folder = Folder::reopen_with(folder, KIND, further)?;
        folder.out().check_folder(TRANSIENTS)?;
        let job = Fitting::stored(file, folder.path(), judge, rasterizer)?;
        let mut run = weaver_run::Run::resume(folder, job)?;
        if ranks.size() > 1 {
            run.job.share(ranks, &run.folder)?;
            run.job.ranks.agreed(false.into());
        }
        Ok(Self(run))
    }

    /// The work of every process but the first in a shared run: reads the run that the first one has begun, in its
    /// folder, and takes part in every step until the last. Writes nothing.
    ///
    /// # Errors
    /// When run, capture or checkpoint cannot be read or differ from the first process; as [`Fit::step`].
    pub fn take_part(rasterizer: Arc<dyn FitRasterizer>, ranks: Arc<dyn Ranks>) -> Result<(), Error> {
        // Waits for the first process.
        let folder = PathBuf::from(agreed_text(&*ranks, ""));
        let mut job = Fitting::stored(RunFile::read(&folder)?, &folder, Judge::default(), rasterizer)?;
        let checkpoint = folder.join(Folder::CHECKPOINT);
        if checkpoint.exists() {
            job.restore(&Tensors::read(&checkpoint)?)?;
        }
        job.capture.fit.share(ranks.clone())?;
        if ranks.agreed(0) == 1 {
            steps_in(&mut job.capture.fit, 0.0)?;
            job.capture.fit.set_steps(ranks.agreed(0) as usize);
        }
        loop {
            match Next::of(ranks.agreed(0)) {
                Next::End => return Ok(()),
                Next::Step => drop(job.capture.fit.step()?),
                Next::LeaveOut(kept) => job.capture.fit.leave_out(kept, None),
            }
        }
    }

    /// The optimization alone, at its beginning, drawn by `rasterizer`: nothing is written.
    ///
    /// # Errors
    /// When the capture cannot be read or gives nothing to fit, or a setting is out of range.
    pub fn optimization(settings: &RunSettings, rasterizer: Arc<dyn FitRasterizer>) -> Result<Fit, Error> {
        Ok(load(&mut settings.clone(), None, rasterizer, None)?.fit)
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

    /// A note about the photos whose depth counts, if any was asked for.
    pub(crate) fn depths(&self) -> Option<&str> {
        self.0.job.capture.depths.as_deref()
    }

    /// Remarks for the user about how the capture was loaded.
    pub fn remarks(&self) -> &[String] {
        &self.0.job.capture.remarks
    }

    /// The photos that are held out.
    pub fn held_out(&self) -> &[Photo] {
        &self.0.job.capture.held_out
    }

    /// The cameras of the photos as they are now, held-out ones first as they were given, and the photos of some of
    /// them: for a page to look at.
    ///
    /// # Errors
    /// When a photo cannot be encoded.
    pub fn shots(&self) -> Result<Vec<Shot>, Error> {
        let given: Vec<_> = self.held_out().iter().map(|photo| photo.camera).collect();
        crate::view::shots(&self.0.job, &given)
    }

    /// Seconds since the run began, with earlier sessions.
    pub fn seconds(&self) -> f64 {
        self.0.job.seconds()
    }

    /// Lets a page follow the run: [`Folder::follow`].
    pub fn follow(&mut self) {
        self.0.folder.follow();
    }

    /// Runs to the last step, or until `stop` is set, and leaves a checkpoint. `observe` is called after every step.
    /// Other processes have then done their part.
    ///
    /// # Errors
    /// As [`Fit::step`](weaver_fit::Fit::step), and when a file cannot be written; the last checkpoint then stays as
    /// it was.
    pub fn advance(&mut self, stop: &AtomicBool, mut observe: impl FnMut(&StepReport)) -> Result<(), Error> {
        self.0.advance(stop, |report| {
            observe(report);
            Ok(())
        })?;
        self.0.job.announce(Next::End);
        Ok(())
    }
}

impl Fitting {
    /// Chooses the number of steps that fits into `minutes`, with the time since the run began and its results.
    fn plan_steps(&mut self, minutes: f64) -> Result<(), Error> {
        let [looks, results] = self.seconds_of_results()?;
        let seconds = 60.0 * minutes;
        let left = seconds - self.seconds() - looks - results;
        let (enough, rehearsal) = in_time(&mut self.capture.fit, left.max(0.0))?;
        let (most, least) = (self.most_steps().unwrap_or(usize::MAX), self.settings.least_steps);
        let enough = (EASIER * enough as f64) as usize;
        let made = enough.min(most).max(least);
        let generous = ((GENEROUS * enough as f64) as usize).min(most).max(made);
        let steps = self.ranks.agreed(generous as u64) as usize;
        let few = format!("{minutes:.2} minutes are enough for {enough}");
        if made > enough {
            let steps = rehearsal.seconds(made) / EASIER;
            let all = self.seconds() + steps + looks + results;
            let remark = format!("{few} of the {made} steps that are made at least; all of it takes about {all:.0} s");
            self.capture.remarks.push(remark);
        } else if made < self.fit().photos().min(most) {
            let remark = format!("fewer than there are photos; judging them at the end is counted as {results:.1} s");
            self.capture.remarks.push(format!("{few} steps, {remark}"));
        }
        self.capture.fit.set_steps(steps);
        self.settings.fit.steps = steps;
        // Processes that share a run do not hear of another number of Gaussians.
        let in_time = self.settings.gaussians_in_time && self.ranks.size() == 1;
        let mut keeping = Keeping::new(rehearsal, [seconds, results, self.seconds()], least);
        keeping.gaussians = in_time.then_some(self.settings.fit.gaussians);
        self.keeping = Some(keeping);
        if made < steps {
            self.leave_out(made);
        }
        Ok(())
    }
}

/// The files of the scene beside `scene.ply`.
fn further(settings: &RunSettings) -> impl Iterator<Item = String> {
    let kept = settings.gaining.is_some().then(|| BEFORE.into());
    settings.formats.iter().map(file_of_scene).chain(settings.compress.map(|_| compressed::FILE.into())).chain(kept)
}

/// The file of the scene in this format.
pub(crate) fn file_of_scene(format: &SceneFormat) -> String {
    format!("scene.{}", format.extension)
}
