//! A fit of a capture on disk: a folder with the scene, cameras, checkpoints, logs and a report.
//!
//! | file | content |
//! |---|---|
//! | `run.json` | what was asked for, with the number of steps once it is known |
//! | `checkpoint.safetensors` | everything needed to go on |
//! | `scene.ply` | the Gaussians; also `scene.splat`, `scene.spz` if asked for |
//! | `transforms.json`, `sparse/0` | the cameras, refined ones too, of the photos as they are on disk |
//! | `summary.json` | the outcome |
//! | `metrics.jsonl`, `events/` | logged values, also for TensorBoard |
//! | `report.html` | held-out photos beside renders, maps, curves |

mod maps;
mod outcome;
mod plan;
mod report;

pub use outcome::{Outcome, PoseChange, Views};
pub use plan::{Plan, dry_run};

use crate::fit::{Fit, StepReport};
use crate::photos::Photo;
use crate::settings::FitSettings;
use crate::{FitError, Judge, init, steps_in};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use weaver_data::capture::HoldOut;
use weaver_data::posed::{self, PosedOptions, PosedPhoto};
use weaver_geometry::Camera;
use weaver_io::checkpoint::Tensors;
use weaver_report::{MetricsLog, TensorBoard};
use weaver_scene::Gaussians;

/// What is asked of a run.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct RunSettings {
    /// The capture: a folder, or a transforms.json.
    pub capture: PathBuf,
    /// Longest side of the photos, pixels; `None` takes them as they are.
    pub long_side: Option<usize>,
    /// Whether no photo is held out.
    pub all: bool,
    /// Whether masks are read.
    pub masks: bool,
    /// Where the Gaussians begin.
    pub init: Initial,
    /// Time for all of it, minutes; the number of steps follows from the speed. `None` takes [`FitSettings::steps`].
    pub minutes: Option<f64>,
    /// Further files of the scene.
    pub formats: Vec<SceneFormat>,
    /// How the scene is fitted.
    pub fit: FitSettings,
}

/// Where Gaussians begin.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Initial {
    /// On the capture's points, at random if it has none.
    #[default]
    Auto,
    /// On the capture's points.
    Points,
    /// At random.
    Random,
    /// As given to [`Run::create`].
    Given,
}

/// File formats of a scene beside PLY.
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum SceneFormat {
    /// 32 bytes a Gaussian, no harmonics.
    Splat,
    /// Compressed, with harmonics.
    Spz,
}

/// A photo's place on disk.
#[derive(Clone, Debug)]
struct Origin {
    name: String,
    path: PathBuf,
    file_camera: Camera,
}

/// A run under way.
#[derive(Debug)]
pub struct Run {
    folder: PathBuf,
    settings: RunSettings,
    fit: Fit,
    held_out: Vec<Photo>,
    /// Of the training photos, then of the held-out ones.
    origins: Vec<Origin>,
    judge: Judge,
    /// Seconds of earlier sessions.
    before: f64,
    started: Instant,
}

/// A logged moment: means over the steps since the last one.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Record {
    /// Steps done.
    pub step: usize,
    /// Seconds since the run began.
    pub seconds: f64,
    /// The loss.
    pub loss: f64,
    /// Mean absolute difference.
    pub l1: f64,
    /// Of the photos looked at, dB, at the size they were looked at.
    pub psnr: f64,
    /// Gaussians.
    pub gaussians: usize,
    /// Millions of Gaussians times pixels that were blended.
    pub pairs: f64,
}

/// Records of a run, whatever its length.
const RECORDS: usize = 500;
/// Time between two checkpoints, at least; and how often longer than one takes to write.
const CHECKPOINT_PAUSE: (Duration, u32) = (Duration::from_secs(20), 30);

impl Run {
    /// Begins a run in a new folder. `given` are the Gaussians of [`Initial::Given`].
    ///
    /// With [`RunSettings::minutes`], the number of steps is chosen now, such that the run, results included, ends in time if
    /// the machine goes on as fast; it is written down, so that the run can be repeated to the same bits.
    ///
    /// # Errors
    /// When the capture cannot be read or gives nothing to fit, a setting is out of range, or the folder holds a run or
    /// cannot be written; nothing is then left behind.
    pub fn create(
        folder: &Path,
        mut settings: RunSettings,
        given: Option<&Gaussians>,
        judge: Judge,
    ) -> Result<Self, FitError> {
        let started = Instant::now();
        if run_path(folder).exists() || folder.join("scene.ply").exists() {
            return Err(FitError::RunExists { folder: folder.into() });
        }
        settings.fit.check()?;
        settings.capture = std::path::absolute(&settings.capture).unwrap_or(settings.capture);
        let (fit, held_out, origins) = load(&settings, given)?;
        let mut run = Self { folder: folder.into(), settings, fit, held_out, origins, judge, before: 0.0, started };
        if let Some(minutes) = run.settings.minutes {
            let reserve = run.seconds_of_results()?;
            let left = 60.0 * minutes - started.elapsed().as_secs_f64() - reserve;
            let steps = steps_in(&mut run.fit, left.max(0.0))?;
            run.fit.plan(steps);
            run.settings.fit.steps = steps;
        }
        weaver_io::create_folder(folder)?;
        weaver_io::check_writable(folder)?;
        let text = serde_json::to_string_pretty(&run.settings).expect("settings are plain data");
        weaver_io::write_text(run_path(folder), &(text + "\n"))?;
        Ok(run)
    }

    /// Goes on with a run from its last checkpoint, or from the start if there is none.
    ///
    /// # Errors
    /// When there is no run, its files or its capture cannot be read, or they no longer belong together.
    pub fn resume(folder: &Path, judge: Judge) -> Result<Self, FitError> {
        let started = Instant::now();
        let path = run_path(folder);
        let settings: RunSettings = serde_json::from_str(&weaver_io::read_text(&path)?).map_err(|e| {
            FitError::File(weaver_io::Error::Invalid {
                path: path.clone(),
                place: "settings".into(),
                expected: "those of a fit".into(),
                found: e.to_string(),
            })
        })?;
        let checkpoint = checkpoint_path(folder);
        let given = folder.join("init.ply");
        let given = given.exists().then(|| weaver_io::read_gaussians(&given)).transpose()?;
        let (fit, held_out, origins) = load(&settings, given.as_ref())?;
        let mut run = Self { folder: folder.into(), settings, fit, held_out, origins, judge, before: 0.0, started };
        if checkpoint.exists() {
            let state = Tensors::read(&checkpoint)?;
            run.fit.restore(&state)?;
            run.before = state.metadata.get("seconds").and_then(|s| s.parse().ok()).unwrap_or(0.0);
        }
        Ok(run)
    }

    /// What was asked for, with the number of steps.
    pub fn settings(&self) -> &RunSettings {
        &self.settings
    }

    /// The optimization.
    pub fn fit(&self) -> &Fit {
        &self.fit
    }

    /// The photos that are held out.
    pub fn held_out(&self) -> &[Photo] {
        &self.held_out
    }

    /// Seconds since the run began, those of earlier sessions included.
    pub fn seconds(&self) -> f64 {
        self.before + self.started.elapsed().as_secs_f64()
    }

    /// Runs to the last step, or until `stop` is set, and leaves a checkpoint. `observe` is called after every step.
    ///
    /// # Errors
    /// As [`Fit::step`], and when a file cannot be written; the last checkpoint then stays as it was.
    pub fn advance(&mut self, stop: &AtomicBool, mut observe: impl FnMut(&StepReport)) -> Result<(), FitError> {
        let steps = self.fit.settings().steps;
        let every = steps.div_ceil(RECORDS);
        let mut log = MetricsLog::open(self.folder.join("metrics.jsonl"), self.fit.steps_done())?;
        let mut events = TensorBoard::create(self.folder.join("events"))?;
        let (mut sums, mut count) = (Record::default(), 0);
        let (mut saved, mut pause) = (Instant::now(), CHECKPOINT_PAUSE.0);
        while self.fit.steps_done() < steps && !stop.load(Ordering::Relaxed) {
            let report = self.fit.step()?;
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
                (saved, pause) = (Instant::now(), CHECKPOINT_PAUSE.0.max(start.elapsed() * CHECKPOINT_PAUSE.1));
            }
        }
        self.save()
    }

    /// Writes a checkpoint.
    ///
    /// # Errors
    /// When it cannot be written; the last one then stays as it was.
    pub fn save(&self) -> Result<(), FitError> {
        let mut state = self.fit.state();
        state.metadata.insert("seconds".into(), format!("{:.3}", self.seconds()));
        Ok(state.write(checkpoint_path(&self.folder))?)
    }
}

fn run_path(folder: &Path) -> PathBuf {
    folder.join("run.json")
}

fn checkpoint_path(folder: &Path) -> PathBuf {
    folder.join("checkpoint.safetensors")
}

/// How to load the photos of a run.
fn posed_options(settings: &RunSettings) -> PosedOptions {
    PosedOptions {
        long_side: settings.long_side,
        hold_out: if settings.all { HoldOut::Nothing } else { HoldOut::Listed },
        masks: settings.masks,
        background: settings.fit.background,
    }
}

fn load(settings: &RunSettings, given: Option<&Gaussians>) -> Result<(Fit, Vec<Photo>, Vec<Origin>), FitError> {
    let capture = posed::load(&settings.capture, &posed_options(settings))?;
    let (mut training, mut held_out) = (Vec::new(), Vec::new());
    let (mut origins, mut held_out_origins) = (Vec::new(), Vec::new());
    for PosedPhoto { name, path, camera, file_camera, rgb, mask, held_out: out } in capture.photos {
        let photo = Photo { name: name.clone(), camera, rgb, mask };
        // The optimization leaves out photos without a pixel that counts.
        if photo.is_masked() {
            continue;
        }
        let (photos, places) = if out { (&mut held_out, &mut held_out_origins) } else { (&mut training, &mut origins) };
        photos.push(photo);
        places.push(Origin { name, path, file_camera });
    }
    origins.append(&mut held_out_origins);
    if training.is_empty() {
        let expected = "at least one to fit to with pixels that count; --all holds none out";
        return Err(FitError::setting("photos", expected, format!("{} held out, none other", held_out.len())));
    }
    let initial = match (settings.init, capture.points.is_empty()) {
        (Initial::Given, _) => {
            let none = || FitError::setting("init", "Gaussians to begin with", "none");
            init::from_gaussians(given.ok_or_else(none)?, &settings.fit)?
        }
        (Initial::Random, _) | (Initial::Auto, true) => init::random(&training, &settings.fit)?,
        (Initial::Points | Initial::Auto, _) => init::from_points(&capture.points, &settings.fit)?,
    };
    Ok((Fit::new(training, &initial, settings.fit.clone())?, held_out, origins))
}

impl Record {
    fn add(&mut self, report: &StepReport) {
        self.step = report.step;
        self.gaussians = report.gaussians;
        self.loss += report.loss;
        self.l1 += report.l1;
        self.psnr += report.psnr;
        self.pairs += report.pairs as f64 / 1e6;
    }

    fn mean(&self, count: usize, seconds: f64) -> Self {
        let over = 1.0 / count as f64;
        let Self { loss, l1, psnr, pairs, .. } = *self;
        Self { seconds, loss: loss * over, l1: l1 * over, psnr: psnr * over, pairs: pairs * over, ..*self }
    }

    fn scalars(&self) -> [(&'static str, f32); 5] {
        let gaussians = self.gaussians as f64;
        let all = [
            ("loss", self.loss),
            ("l1", self.l1),
            ("psnr", self.psnr),
            ("gaussians", gaussians),
            ("pairs", self.pairs),
        ];
        all.map(|(name, value)| (name, value as f32))
    }
}
