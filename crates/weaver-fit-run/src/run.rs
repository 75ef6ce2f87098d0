//! A fit of a capture, under way.

use crate::matching::Matching;
use crate::{Initial, Record, RunError, RunSettings};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use weaver_data::posed::{self, PosedPhoto};
use weaver_fit::{Fit, Judge, Photo, StepReport, init, steps_in};
use weaver_geometry::{Camera, Distortion};
use weaver_io::checkpoint::Tensors;
use weaver_report::{MetricsLog, TensorBoard};
use weaver_scene::Gaussians;
use weaver_splat::AnyRasterizer;

/// A photo's place on disk.
#[derive(Clone, Debug)]
pub(crate) struct Origin {
    pub path: PathBuf,
    /// The camera of the photo as it is on disk.
    pub file_camera: Camera,
    /// The distortion of the photo as it is on disk.
    pub distortion: Option<Distortion>,
    /// The file of the photo's mask.
    pub mask_file: Option<PathBuf>,
    /// When the photo was taken, where the capture says so.
    pub time: Option<f64>,
    /// The number that the capture gives to the photo.
    pub number: Option<u64>,
    /// The camera of the photo as it is fitted, before refinement.
    pub given: Camera,
}

/// A run under way.
#[derive(Debug)]
pub struct Run {
    pub(crate) folder: PathBuf,
    pub(crate) settings: RunSettings,
    pub(crate) fit: Fit,
    pub(crate) held_out: Vec<Photo>,
    /// Of the training photos, then of the held-out ones.
    pub(crate) origins: Vec<Origin>,
    pub(crate) matching: Option<Matching>,
    remarks: Vec<String>,
    pub(crate) judge: Judge,
    /// Seconds of earlier sessions.
    before: f64,
    started: Instant,
}

/// Records of a run, whatever its length.
const RECORDS: usize = 500;
/// Time between two checkpoints over the time that one takes to write, at least.
const SAVING: u32 = 30;

impl Run {
    /// Begins a run in a new folder. `given` are the Gaussians of [`Initial::Given`]; `rasterizer` draws.
    ///
    /// With [`RunSettings::minutes`], the number of steps is chosen now, such that the run, results included, ends in time if
    /// the machine goes on as fast, but for [`RunSettings::least_steps`]; it is written down, so that the run can be repeated to the same bits.
    ///
    /// # Errors
    /// When the capture cannot be read or gives nothing to fit, a setting is out of range, or the folder holds a run or
    /// cannot be written; nothing is then left behind.
    pub fn create(
        folder: &Path,
        mut settings: RunSettings,
        given: Option<&Gaussians>,
        judge: Judge,
        rasterizer: AnyRasterizer<f32>,
    ) -> Result<Self, RunError> {
        let started = Instant::now();
        if run_path(folder).exists() || folder.join("scene.ply").exists() {
            return Err(RunError::RunExists { folder: folder.into() });
        }
        settings.fit.check()?;
        settings.capture = std::path::absolute(&settings.capture).unwrap_or(settings.capture);
        let mut run = Self::loaded(folder, settings, given, (judge, rasterizer), started)?;
        if let Some(minutes) = run.settings.minutes {
            let reserve = run.seconds_of_results()?;
            let left = 60.0 * minutes - started.elapsed().as_secs_f64() - reserve;
            let enough = steps_in(&mut run.fit, left.max(0.0))?;
            let steps = enough.max(run.settings.least_steps);
            let few = format!("{minutes} minutes are enough for {enough} steps");
            if steps > enough {
                run.remarks.push(format!("{few}; {steps} are made, which takes longer"));
            } else if steps < run.fit.photos() {
                run.remarks.push(format!(
                    "{few}, fewer than there are photos; judging them at the end is counted as {reserve:.1} s"
                ));
            }
            run.fit.set_steps(steps);
            run.settings.fit.steps = steps;
        }
        weaver_io::create_folder(folder)?;
        weaver_io::check_writable(folder)?;
        let text = serde_json::to_string_pretty(&run.settings).expect("settings are plain data");
        if let Some(given) = given {
            weaver_io::write_ply(init_path(folder), given)?;
        }
        weaver_io::write_text(run_path(folder), &(text + "\n"))?;
        Ok(run)
    }

    /// A run at its first step.
    fn loaded(
        folder: &Path,
        settings: RunSettings,
        given: Option<&Gaussians>,
        (judge, rasterizer): (Judge, AnyRasterizer<f32>),
        started: Instant,
    ) -> Result<Self, RunError> {
        let Loaded { fit, held_out, origins, matching, remarks } = load(&settings, given, rasterizer)?;
        let folder = folder.into();
        Ok(Self { folder, settings, fit, held_out, origins, matching, remarks, judge, before: 0.0, started })
    }

    /// Goes on with a run from its last checkpoint, or from the start if there is none.
    ///
    /// # Errors
    /// When there is no run, its files or its capture cannot be read, or they no longer belong together.
    pub fn resume(folder: &Path, judge: Judge, rasterizer: AnyRasterizer<f32>) -> Result<Self, RunError> {
        let started = Instant::now();
        let path = run_path(folder);
        let settings: RunSettings = serde_json::from_str(&weaver_io::read_text(&path)?).map_err(|e| {
            RunError::File(weaver_io::Error::Invalid {
                path: path.clone(),
                place: "settings".into(),
                expected: "those of a fit".into(),
                found: e.to_string(),
            })
        })?;
        let checkpoint = checkpoint_path(folder);
        let given = init_path(folder);
        let given = given.exists().then(|| weaver_io::read_gaussians(&given)).transpose()?;
        let mut run = Self::loaded(folder, settings, given.as_ref(), (judge, rasterizer), started)?;
        if checkpoint.exists() {
            let state = Tensors::read(&checkpoint)?;
            run.fit.restore(&state)?;
            run.before = state.metadata.get("seconds").and_then(|s| s.parse().ok()).unwrap_or(0.0);
        }
        Ok(run)
    }

    /// The optimization alone, at its beginning, drawn by `rasterizer`: nothing is written.
    ///
    /// # Errors
    /// When the capture cannot be read or gives nothing to fit, or a setting is out of range.
    pub fn optimization(settings: &RunSettings, rasterizer: AnyRasterizer<f32>) -> Result<Fit, RunError> {
        Ok(load(settings, None, rasterizer)?.fit)
    }

    /// What was asked for, with the number of steps.
    pub fn settings(&self) -> &RunSettings {
        &self.settings
    }

    /// The optimization.
    pub fn fit(&self) -> &Fit {
        &self.fit
    }

    /// What photos were found to agree about, if cameras are refined.
    pub fn matching(&self) -> Option<Matching> {
        self.matching
    }

    /// What the user should know about how the capture was loaded.
    pub fn remarks(&self) -> &[String] {
        &self.remarks
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
    pub fn advance(&mut self, stop: &AtomicBool, mut observe: impl FnMut(&StepReport)) -> Result<(), RunError> {
        let steps = self.fit.settings().steps;
        let every = steps.div_ceil(RECORDS);
        let mut log = MetricsLog::open(self.folder.join("metrics.jsonl"), self.fit.steps_done())?;
        let mut events = TensorBoard::create(self.folder.join("events"))?;
        let (mut sums, mut count) = (Record::default(), 0);
        let least = Duration::from_secs_f64(self.settings.save_every);
        let (mut saved, mut pause) = (Instant::now(), least);
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
        self.fit.fetch()?;
        let mut state = self.fit.state();
        state.metadata.insert("seconds".into(), format!("{:.3}", self.seconds()));
        Ok(state.write(checkpoint_path(&self.folder))?)
    }
}

fn run_path(folder: &Path) -> PathBuf {
    folder.join("run.json")
}

fn init_path(folder: &Path) -> PathBuf {
    folder.join("init.ply")
}

fn checkpoint_path(folder: &Path) -> PathBuf {
    folder.join("checkpoint.safetensors")
}

/// A capture, ready to be fitted.
struct Loaded {
    fit: Fit,
    held_out: Vec<Photo>,
    origins: Vec<Origin>,
    matching: Option<Matching>,
    remarks: Vec<String>,
}

fn load(settings: &RunSettings, given: Option<&Gaussians>, rasterizer: AnyRasterizer<f32>) -> Result<Loaded, RunError> {
    let mut capture = posed::load(&settings.capture, &settings.posed_options())?;
    let (mut training, mut held_out) = (Vec::new(), Vec::new());
    let (mut origins, mut held_out_origins) = (Vec::new(), Vec::new());
    for photo in capture.photos {
        let PosedPhoto {
            name,
            path,
            camera,
            file_camera,
            distortion,
            mask_file,
            rgb,
            mask,
            time,
            number,
            held_out: out,
            ..
        } = photo;
        let photo = Photo { name, camera, rgb, mask };
        // The optimization leaves out photos without a pixel that counts.
        if photo.is_masked() {
            continue;
        }
        let (photos, places) = if out { (&mut held_out, &mut held_out_origins) } else { (&mut training, &mut origins) };
        photos.push(photo);
        places.push(Origin { path, file_camera, distortion, mask_file, time, number, given: camera });
    }
    if let Some(views) = settings.views {
        let chosen = weaver_data::uniform(training.len(), views.clamp(1, training.len().max(1)));
        training = chosen.iter().map(|i| training[*i].clone()).collect();
        origins = chosen.iter().map(|i| origins[*i].clone()).collect();
    }
    origins.append(&mut held_out_origins);
    if training.is_empty() {
        let expected = "at least one that is not held out, with pixels that count";
        let found = format!("{} held out, none other", held_out.len());
        return Err(RunError::Photos {
            capture: settings.capture.clone(),
            key: "photos",
            expected: expected.into(),
            found,
        });
    }
    // The file of a fisheye's photo with another focal length would have no distortion that can be written.
    let refocusable = |origin: &Origin| origin.distortion.is_none_or(|d| d.refocused(1.0).is_some());
    let refocus = settings.focal && origins.iter().all(refocusable);
    let matching =
        settings.fit.poses.refine.then(|| Matching::refine(&mut training, &mut held_out, &mut capture.points, refocus));
    if let Some(Matching { focal, .. }) = matching.filter(|_| refocus) {
        for origin in &mut origins {
            origin.file_camera.intrinsics.fx *= focal;
            origin.file_camera.intrinsics.fy *= focal;
            origin.distortion = origin.distortion.and_then(|distortion| distortion.refocused(focal));
        }
    }
    let initial = match (settings.init, capture.points.is_empty()) {
        (Initial::Given, _) => init::from_gaussians(given.unwrap_or(&Gaussians::default()), &settings.fit)?,
        (Initial::Random, _) | (Initial::Auto, true) => init::random(&training, &settings.fit)?,
        (Initial::Points | Initial::Auto, _) => init::from_points(&capture.points, &settings.fit)?,
    };
    let remarks = capture.remarks;
    let strategy = settings.fit.density.strategy();
    let fit = Fit::with(rasterizer, strategy, training, &initial, settings.fit.clone())?;
    Ok(Loaded { fit, held_out, origins, matching, remarks })
}
