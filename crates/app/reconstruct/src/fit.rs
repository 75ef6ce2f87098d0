//! The course of a fit, from its request to its results.

use crate::budget::{Budget, Work};
use crate::cameras::{estimated_capture, held_out_of_estimated};
use crate::live::advance;
use crate::plan::planned;
use crate::run::TRANSIENTS;
use crate::time_budget::TimeBudget;
use crate::{Error, Initial, Outcome, Plan, Run, RunSettings};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;
use weaver_clip::PhotoFiles;
use weaver_data::capture::MaskOptions;
use weaver_data::posed::CaptureCameras;
use weaver_data::{EstimatePhotosOptions, Placing};
use weaver_fit::{FitRasterizer, Judge};
use weaver_io::{Observe, ShellCommand, check_memory, duration, peak_mb};
use weaver_ranks::{Alone, Ranks};
use weaver_run::Folder;
use weaver_scene::Gaussians;
use weaver_splat::CpuRasterizer;
use weaver_view_run::Listener;

/// Fewer points than this say little about cameras.
const FEW_POINTS: usize = 50;
/// Fewer Gaussians than this for each pixel of a photo cannot show much.
const FEW: f64 = 0.005;

/// A request for a fit.
#[derive(Clone, Debug)]
pub struct FitRequest {
    /// Folder for the results.
    pub out: PathBuf,
    /// The run, with the capture.
    pub settings: RunSettings,
    /// The most Gaussians, in place of the number in [`settings`](Self::settings); `None` follows the size of the
    /// photos, and the time where there is one.
    pub gaussians: Option<usize>,
    /// Estimates the cameras of the capture's photos, with these options.
    pub estimate: Option<EstimatePhotosOptions>,
    /// Further files that are read, and that no result may replace.
    pub read: Vec<PathBuf>,
}

impl FitRequest {
    /// The first free folder for a fit of a capture, named after it, in the folder `fits`.
    pub fn free_folder(capture: &Path) -> PathBuf {
        let absolute = std::path::absolute(capture).unwrap_or(capture.into());
        let folder = if absolute.is_file() { absolute.parent().unwrap_or(&absolute).to_path_buf() } else { absolute };
        let name = folder.file_name().map_or("capture".into(), |name| name.to_string_lossy().into_owned());
        Folder::free(Path::new("fits"), &name)
    }

    /// The settings of the run with its number of Gaussians, and its plan, by the capture's own cameras. Where the
    /// number follows from a time, steps are timed with this rasterizer; without one it is the most that there may be.
    ///
    /// # Errors
    /// When the camera files cannot be read, or a setting is out of range.
    pub fn plan(&self, rasterizer: Option<Arc<dyn FitRasterizer>>) -> Result<(RunSettings, Plan), Error> {
        let mut settings = self.settings.clone();
        let cameras = CaptureCameras::read(&settings.capture, settings.hold_out)?;
        self.take_budget(&mut settings, &cameras, rasterizer)?;
        let plan = planned(&settings, &cameras)?;
        Ok((settings, plan))
    }

    /// Writes the number of Gaussians to the settings.
    fn take_budget(
        &self,
        settings: &mut RunSettings,
        cameras: &CaptureCameras,
        rasterizer: Option<Arc<dyn FitRasterizer>>,
    ) -> Result<(), Error> {
        settings.gaussians_in_time = self.gaussians.is_none() && settings.init != Initial::Given;
        settings.fit.gaussians = match (self.gaussians, settings.minutes, rasterizer) {
            (Some(gaussians), ..) => gaussians,
            // Given Gaussians are in place: none is left out for lack of time.
            (None, Some(minutes), Some(rasterizer)) if settings.init != Initial::Given => {
                let [width, height] = planned(settings, cameras)?.size;
                let side = width.max(height);
                Budget::of(settings, cameras, &Work { sides: side..=side, minutes, rounds: 0 }, rasterizer)?.gaussians
            }
            _ => planned(settings, cameras)?.usual().gaussians,
        };
        Ok(settings.fit.check()?)
    }
}

/// Makes the Gaussians of [`Initial::Given`] once the capture is there.
pub type GivenGaussians = dyn Fn(&RunSettings) -> Result<Gaussians, Box<dyn std::error::Error + Send + Sync>>;

/// Parts that a fit works with.
pub struct FitContext {
    /// Draws.
    pub rasterizer: Arc<dyn FitRasterizer>,
    /// Judges photos at the end.
    pub judge: Judge,
    /// The Gaussians to begin with.
    pub given: Option<Box<GivenGaussians>>,
    /// The processes that share the steps.
    pub ranks: Arc<dyn Ranks>,
    /// Port of a page that follows the fit.
    pub live: Option<Listener>,
}

impl Default for FitContext {
    fn default() -> Self {
        Self {
            rasterizer: Arc::new(CpuRasterizer),
            judge: Judge::default(),
            given: None,
            ranks: Arc::new(Alone),
            live: None,
        }
    }
}

impl fmt::Debug for FitContext {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FitContext")
            .field("rasterizer", &self.rasterizer)
            .field("live", &self.live)
            .finish_non_exhaustive()
    }
}

/// Fits Gaussians to the photos of a capture, and writes scene, cameras, summary and report into a folder.
///
/// An observer that returns a break to a part of the stage `fit` ends the fit, with results.
///
/// # Errors
/// As [`reconstruct`](crate::reconstruct()).
pub fn fit(request: FitRequest, context: FitContext, observe: &mut dyn Observe) -> Result<Outcome, Error> {
    let start = Instant::now();
    let mut settings = request.settings.clone();
    let out = Run::claim(&request.out, std::iter::once(&settings.capture).chain(&request.read))?;
    let time = settings.minutes.map(|minutes| TimeBudget::new(start, minutes));
    if let Some(matching) = &request.estimate {
        let images = settings.capture.join("images");
        let images = [if images.is_dir() { images } else { settings.capture.clone() }];
        let photos = PhotoFiles::collect(&images, None, out.out(), observe)?;
        let inverted = std::mem::take(&mut settings.invert_masks);
        let masks = settings.masks.then_some(MaskOptions { folder: None, inverted });
        let chosen = (settings.hold_out, masks.as_ref());
        (settings.capture, settings.masks) =
            estimated_capture(&photos, chosen, (matching, &Placing::KEEP), out.out(), observe)?;
        settings.hold_out = held_out_of_estimated(settings.hold_out);
        if let Some(time) = time {
            time.note_share(observe);
            settings.minutes = Some(time.of_fit());
        }
    }
    let cameras = CaptureCameras::read(&settings.capture, settings.hold_out)?;
    request.take_budget(&mut settings, &cameras, Some(context.rasterizer.clone()))?;
    let outcome = begin(settings, &cameras, context, out, observe)?;
    if let Some(time) = time {
        time.note_excess(observe);
    }
    remark_outcome(&outcome, &request.out, observe);
    Ok(outcome)
}

/// Goes on with the fit in a folder, to the bits of one that was not interrupted.
///
/// # Errors
/// As [`Run::resume`]; as [`fit`](fit()) then.
pub fn resume(folder: &Path, context: FitContext, observe: &mut dyn Observe) -> Result<Outcome, Error> {
    let FitContext { rasterizer, judge, ranks, live, .. } = context;
    let run = Run::resume_shared(folder, judge, rasterizer, ranks)?;
    let outcome = finish(run, folder, live, observe)?;
    remark_outcome(&outcome, folder, observe);
    Ok(outcome)
}

/// Remarks about the outcome of a fit in a folder, for an observer who is not shown its figures.
pub(crate) fn remark_outcome(outcome: &Outcome, folder: &Path, observe: &mut dyn Observe) {
    let memory = peak_mb().map_or(String::new(), |peak| format!(", at most {peak:.0} MB of memory"));
    let made = outcome.steps - outcome.left_out;
    observe.note(&format!("{made} steps, {}{memory}", duration(outcome.seconds)));
    outcome.missing.iter().for_each(|missing| observe.warning(&format!("not written: {missing}")));
    for name in &outcome.outliers {
        observe.warning(&format!("{name} is met far worse than the other photos; it may show something else"));
    }
    if !outcome.transients.is_empty() {
        let most = 100.0 * outcome.transients.values().fold(0.0, |a: f64, b| a.max(*b));
        let count = outcome.transients.len();
        observe.note(&format!(
            "in {count} photos something was left out that no other photo shows, at most {most:.0} % of a photo: {}",
            folder.join(TRANSIENTS).display()
        ));
    }
    if let Some(cleaning) = &outcome.cleaning {
        observe.note(&cleaning.to_string());
    }
    if outcome.steps < outcome.planned {
        let (done, planned) = (outcome.steps, outcome.planned);
        let resume = ShellCommand::new("splatweaver fit --resume").path(folder);
        observe.note(&format!("ended at step {done} of {planned}; to go on: {resume}"));
    }
}

/// Fits a capture with these cameras, into a folder that was claimed.
pub(crate) fn begin(
    settings: RunSettings,
    cameras: &CaptureCameras,
    context: FitContext,
    out: Folder,
    observe: &mut dyn Observe,
) -> Result<Outcome, Error> {
    let FitContext { rasterizer, judge, given, ranks, live } = context;
    let plan = planned(&settings, cameras)?;
    check_memory(plan.total(), "a smaller --long-side or fewer --gaussians reduce it")?;
    let pixels = (plan.size[0] * plan.size[1]) as f64;
    if (settings.fit.gaussians as f64) < FEW * pixels {
        let gaussians = settings.fit.gaussians;
        observe.warning(&format!("{gaussians} Gaussians for photos of {pixels} pixels: expect blur"));
    }
    if plan.training == 1 {
        observe.warning("one photo only: nothing says how far anything is away");
    }
    let given = given.map(|given| given(&settings)).transpose().map_err(Error::Given)?;
    if settings.fit.poses.refine {
        observe.note(&format!("matching {} photos", plan.training + plan.held_out));
    }
    let folder = out.path().to_path_buf();
    let run = Run::begin_shared(out, settings, given.as_ref(), judge, rasterizer, ranks)?;
    remark(&run, observe);
    finish(run, &folder, live, observe)
}

/// Remarks about the photos, and the start that they give.
fn remark(run: &Run, observe: &mut dyn Observe) {
    run.remarks().iter().for_each(|remark| observe.warning(remark));
    if let Some(rounds) = run.settings().most_rounds.filter(|_| run.ends_early()) {
        observe.note(&format!("each photo is used {rounds} times; the time that is left would only overfit"));
    }
    if run.colors().differ() {
        let percent = 100.0 * run.colors().spread();
        let corrected = if run.settings().fit.exposure { "their colors are corrected" } else { "nothing is corrected" };
        observe
            .note(&format!("photos differ in exposure or white balance, by {percent:.0} % in the median; {corrected}"));
    }
    if !run.coverage().is_empty() {
        remark_coverage(run, observe);
    }
    if let Some(depths) = run.depths() {
        observe.note(depths);
    }
    if let Some(found) = run.matching() {
        let (points, pixels) = (found.points, found.pixels);
        observe
            .note(&format!("cameras adjusted to {points} points, which are off by {pixels:.2} pixels in the median"));
        if points < FEW_POINTS {
            observe.warning("photos agree about few points: cameras stay nearly as given");
        }
    }
}

/// Remarks about the depth that photos agree about, and the photos that stand alone.
fn remark_coverage(run: &Run, observe: &mut dyn Observe) {
    let percent = 100.0 * run.coverage().mean();
    let begin = match run.settings().init {
        Initial::Dense => "Gaussians begin there",
        _ => "too little to begin there; photos that are closer together would help",
    };
    observe.note(&format!("two other photos agree about {percent:.0} % of a photo in the mean; {begin}"));
    let alone = run.coverage().alone();
    if !alone.is_empty() {
        observe.warning(&format!(
            "what these photos show, hardly another one does, which leaves its depth open; photos from beside them would help: {}",
            alone.join(", ")
        ));
    }
}

/// Goes on to the end; a page follows if the fit is live.
fn finish(mut run: Run, folder: &Path, live: Option<Listener>, observe: &mut dyn Observe) -> Result<Outcome, Error> {
    let settings = run.settings();
    let budget = settings.fit.gaussians;
    let made = settings.fit.taken();
    observe.note(&format!(
        "{} photos, {} held out; {made} steps, at most {budget} Gaussians; results in {}",
        run.fit().photos(),
        run.held_out().len(),
        folder.display()
    ));
    let start = Instant::now();
    advance(&mut run, folder, live, observe)?;
    let steps = duration(start.elapsed().as_secs_f64());
    observe.note(&format!("{steps} for the steps; drawing and judging every photo"));
    run.finish()
}
