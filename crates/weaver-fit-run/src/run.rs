//! A fit of a capture, under way.

use crate::loaded::{Loaded, load};
use crate::{Matching, Record, RunError, RunFile, RunSettings};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use weaver_fit::{ColorAgreement, Fit, FitRasterizer, Judge, Photo, StepReport, steps_in};
use weaver_io::safetensors::Tensors;
use weaver_io::{OutputFolder, SceneFormat, colmap};
use weaver_report::{MetricsLog, TensorBoard};
use weaver_scene::Gaussians;

/// A run under way. Its folder is its own until this value is dropped.
#[derive(Debug)]
pub struct Run {
    pub(crate) out: OutputFolder,
    pub(crate) settings: RunSettings,
    pub(crate) capture: Loaded,
    pub(crate) judge: Judge,
    /// Seconds of earlier sessions.
    before: f64,
    started: Instant,
}

/// What a run's folder says that its files were written by.
pub(crate) const COMMAND: &str = "fit";
/// The Gaussians that a run began with.
const INIT: &str = "init.ply";
const CHECKPOINT: &str = "checkpoint.safetensors";
/// The folder of the cameras and points as COLMAP has them.
pub(crate) const MODEL: &str = "sparse/0";
/// Records of a run, whatever its length.
const RECORDS: usize = 500;
/// Time between two checkpoints over the time that one takes to write, at least.
const SAVING: u32 = 30;

impl Run {
    /// Claims a folder for a run that reads these files and folders. Meant to be called before any other work.
    ///
    /// # Errors
    /// When the folder holds a run, or as [`OutputFolder::claim`] and [`OutputFolder::check`].
    pub fn claim<P: AsRef<Path>>(folder: &Path, inputs: impl IntoIterator<Item = P>) -> Result<OutputFolder, RunError> {
        if folder.join(RunFile::NAME).exists() {
            return Err(RunError::RunExists { folder: folder.into() });
        }
        let out = OutputFolder::claim(folder, COMMAND, inputs)?;
        out.check(files())?;
        Ok(out)
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
        out: OutputFolder,
        mut settings: RunSettings,
        given: Option<&Gaussians>,
        judge: Judge,
        rasterizer: Arc<dyn FitRasterizer>,
    ) -> Result<Self, RunError> {
        let started = Instant::now();
        out.check(settings.formats.iter().map(file_of_scene))?;
        settings.fit.check()?;
        settings.capture = std::path::absolute(&settings.capture).unwrap_or(settings.capture);
        let capture = load(&settings, given, rasterizer)?;
        let mut run = Self { out, settings, capture, judge, before: 0.0, started };
        if let Some(minutes) = run.settings.minutes {
            let reserve = run.seconds_of_results()?;
            let left = 60.0 * minutes - started.elapsed().as_secs_f64() - reserve;
            let enough = steps_in(&mut run.capture.fit, left.max(0.0))?;
            let steps = enough.max(run.settings.least_steps);
            let few = format!("{minutes} minutes are enough for {enough} steps");
            if steps > enough {
                run.capture.remarks.push(format!("{few}; {steps} are made, which takes longer"));
            } else if steps < run.fit().photos() {
                run.capture.remarks.push(format!(
                    "{few}, fewer than there are photos; judging them at the end is counted as {reserve:.1} s"
                ));
            }
            run.capture.fit.set_steps(steps);
            run.settings.fit.steps = steps;
        }
        if let Some(given) = given {
            weaver_io::write_gaussians(run.out.file(INIT)?, given)?;
        }
        let file = RunFile { settings: run.settings.clone(), sources: run.capture.sources.clone() };
        let text = file.text(run.out.path())?;
        weaver_io::write_text(run.out.file(RunFile::NAME)?, &text)?;
        Ok(run)
    }

    /// Goes on with a run from its last checkpoint, or from the start if there is none.
    ///
    /// # Errors
    /// When there is no run or it is under way elsewhere, its files or its capture cannot be read, or they no longer belong together.
    pub fn resume(folder: &Path, judge: Judge, rasterizer: Arc<dyn FitRasterizer>) -> Result<Self, RunError> {
        let started = Instant::now();
        let RunFile { settings, sources } = RunFile::read(folder)?;
        let formats = settings.formats.iter().map(file_of_scene);
        let out = OutputFolder::reopen(folder, COMMAND, files().chain([INIT.into()]).chain(formats))?;
        let given = folder.join(INIT);
        let given = given.exists().then(|| weaver_io::read_gaussians(&given)).transpose()?;
        let capture = load(&settings, given.as_ref(), rasterizer)?;
        capture.sources.check(&sources, &settings.capture, &folder.join(RunFile::NAME))?;
        let mut run = Self { out, settings, capture, judge, before: 0.0, started };
        let checkpoint = folder.join(CHECKPOINT);
        if checkpoint.exists() {
            let state = Tensors::read(&checkpoint)?;
            run.capture.fit.restore(&state)?;
            run.before = state.metadata.get("seconds").and_then(|s| s.parse().ok()).unwrap_or(0.0);
        }
        Ok(run)
    }

    /// The optimization alone, at its beginning, drawn by `rasterizer`: nothing is written.
    ///
    /// # Errors
    /// When the capture cannot be read or gives nothing to fit, or a setting is out of range.
    pub fn optimization(settings: &RunSettings, rasterizer: Arc<dyn FitRasterizer>) -> Result<Fit, RunError> {
        Ok(load(settings, None, rasterizer)?.fit)
    }

    /// What was asked for, with the number of steps.
    pub fn settings(&self) -> &RunSettings {
        &self.settings
    }

    /// The optimization.
    pub fn fit(&self) -> &Fit {
        &self.capture.fit
    }

    /// What photos were found to agree about, if cameras are refined.
    pub fn matching(&self) -> Option<Matching> {
        self.capture.matching
    }

    /// Whether photos agree about the colors of points that they share.
    pub fn colors(&self) -> &ColorAgreement {
        &self.capture.colors
    }

    /// What the user should know about how the capture was loaded.
    pub fn remarks(&self) -> &[String] {
        &self.capture.remarks
    }

    /// The photos that are held out.
    pub fn held_out(&self) -> &[Photo] {
        &self.capture.held_out
    }

    /// Seconds since the run began, those of earlier sessions included.
    pub fn seconds(&self) -> f64 {
        self.before + self.started.elapsed().as_secs_f64()
    }

    /// Runs to the last step, or until `stop` is set, and leaves a checkpoint. `observe` is called after every step.
    ///
    /// # Errors
    /// As [`Fit::step`], and when a file cannot be written; the last checkpoint then stays as it was.
    pub fn advance(&mut self, stop: &AtomicBool, mut observe: impl FnMut(&StepReport)) -> Result<(), RunError> {
        let steps = self.fit().settings().steps;
        let every = steps.div_ceil(RECORDS);
        let mut log = MetricsLog::open(self.out.file("metrics.jsonl")?, self.fit().steps_done())?;
        let mut events = TensorBoard::create(self.out.path().join("events"))?;
        let (mut sums, mut count) = (Record::default(), 0);
        let least = Duration::from_secs_f64(self.settings.save_every);
        let (mut saved, mut pause) = (Instant::now(), least);
        while self.fit().steps_done() < steps && !stop.load(Ordering::Relaxed) {
            let report = self.capture.fit.step()?;
            observe(&report);
            sums.add(&report);
            count += 1;
            if report.step.is_multiple_of(every) || report.step == steps {
                let record = sums.mean(count, self.seconds());
                log.append(&record)?;
                events.scalars(record.step, &record.scalars())?;
                (sums, count) = (Record::default(), 0);
            }
            if saved.elapsed() >= pause {
                let start = Instant::now();
                self.save()?;
                (saved, pause) = (Instant::now(), least.max(start.elapsed() * SAVING));
            }
        }
        self.save()
    }

    /// Writes a checkpoint.
    ///
    /// # Errors
    /// When it cannot be written; the last one then stays as it was.
    pub fn save(&mut self) -> Result<(), RunError> {
        self.capture.fit.fetch()?;
        let mut state = self.fit().state();
        state.metadata.insert("seconds".into(), format!("{:.3}", self.seconds()));
        Ok(state.write(self.out.file(CHECKPOINT)?)?)
    }
}

/// The file of the scene in this format.
pub(crate) fn file_of_scene(format: &SceneFormat) -> String {
    format!("scene.{}", format.extension)
}

/// The files of every run.
fn files() -> impl Iterator<Item = String> {
    let results = ["scene.ply", "transforms.json", "metrics.jsonl", "summary.json", "report.html"];
    let model = colmap::Model::FILES.map(|name| format!("{MODEL}/{name}"));
    [RunFile::NAME, CHECKPOINT].into_iter().chain(results).map(String::from).chain(model)
}
