//! From photos to a scene.

use crate::budget::{Budget, ENOUGH_ROUNDS, Work};
use crate::cameras::{estimated_capture, held_out_of_estimated};
use crate::fit::{FitContext, begin, remark_outcome};
use crate::plan::planned;
use crate::time_budget::TimeBudget;
use crate::{ByPhotos, Error, Gaining, Outcome, Photos, Run, RunSettings, demo};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;
use weaver_clip::PhotoFiles;
use weaver_data::capture::{HoldOut, MaskOptions};
use weaver_data::posed::{CaptureCameras, Masked};
use weaver_data::{EstimatePhotosOptions, Placing};
use weaver_fit::{FitRasterizer, FitSettings, Surfaces};
use weaver_io::{Advice, Observe, OutputFolder, ShellCommand};
use weaver_splat::CpuRasterizer;
use weaver_view_run::Listener;

/// The most passes through the photos in the time of a quality, by docs/results/photos.md: held-out photos gain
/// nothing from more.
const MOST_ROUNDS: usize = 200;
/// Numbers of photos from which every eighth, and every sixteenth, is held out where that decides how long a scene is
/// improved.
const FEW: usize = 16;
const MANY: usize = 64;
const JUDGES: usize = 8;
const JUDGES_OF_MANY: usize = 16;

/// The purpose of a reconstruction, which decides about time and the size of photos.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum Quality {
    /// A look: half a minute, photos of at most 384 pixels.
    Draft,
    /// Five minutes, 800 to 1600 pixels, as time allows.
    #[default]
    Normal,
    /// Twenty minutes, 800 to 1600 pixels, as time allows.
    Fine,
    /// As long as held-out photos gain, hours if need be; photos of up to 4096 pixels, 12 megapixels.
    Best,
}

impl Quality {
    /// Minutes for all of it; `None` for no bound.
    pub fn minutes(self) -> Option<f64> {
        match self {
            Self::Draft => Some(0.5),
            Self::Normal => Some(5.0),
            Self::Fine => Some(20.0),
            Self::Best => None,
        }
    }

    /// The longest side of photos at least and at most, if they are as large, pixels.
    pub fn sides(self) -> RangeInclusive<usize> {
        match self {
            Self::Draft => 384..=384,
            Self::Normal | Self::Fine => 800..=1600,
            Self::Best => 800..=4096,
        }
    }
}

/// A request for a scene.
#[derive(Debug)]
pub struct Request {
    /// Folder for the results.
    pub out: PathBuf,
    /// Time and size of the photos.
    pub quality: Quality,
    /// Time for all of it, minutes, which is used up; `None` is the time of the quality, but then a fit ends early once
    /// it has used each photo often enough.
    pub minutes: Option<f64>,
    /// The most Gaussians; `None` follows the size of the photos.
    pub gaussians: Option<usize>,
    /// Photos that are not shown to the fit, which is judged by them.
    pub hold_out: HoldOut,
    /// Seed of everything that is drawn at random.
    pub seed: u64,
    /// Level of a compressed file of the scene, 0 to 3; `None` writes none.
    pub compress: Option<f64>,
    /// True if a page to look at the scene is written.
    pub html: bool,
    /// True if Gaussians that no photo needs are removed.
    pub clean: bool,
    /// True if the depth of surfaces counts as well, for meshes.
    pub surfaces: bool,
    /// The most frames of each clip; `None` takes as many as show something new.
    pub frames: Option<usize>,
    /// Options of estimated cameras.
    pub matching: EstimatePhotosOptions,
    /// The world that estimated cameras are brought to.
    pub placing: Placing,
    /// Masks of the photos: their black pixels are neither matched nor fitted; `None` uses all of each photo. A
    /// capture has its masks beside it, and no folder is given.
    pub masks: Option<MaskOptions>,
    /// Meaning of masked pixels for the scene.
    pub masked: Masked,
    /// Draws.
    pub rasterizer: Arc<dyn FitRasterizer>,
    /// Port of a page that follows the fit.
    pub live: Option<Listener>,
}

impl Request {
    /// A scene into this folder, with everything else as usual.
    pub fn new(out: impl Into<PathBuf>) -> Self {
        Self {
            out: out.into(),
            quality: Quality::default(),
            minutes: None,
            gaussians: None,
            hold_out: HoldOut::Nothing,
            seed: 0,
            compress: None,
            html: true,
            clean: true,
            surfaces: false,
            frames: None,
            matching: EstimatePhotosOptions::default(),
            placing: Placing::default(),
            masks: None,
            masked: Masked::default(),
            rasterizer: Arc::new(CpuRasterizer),
            live: None,
        }
    }

    /// Minutes for all of it; `None` for no bound.
    fn time(&self) -> Option<f64> {
        self.minutes.or(self.quality.minutes())
    }

    /// The photos that are held out, of so many whose cameras are estimated: where the scene's gain decides about the
    /// end, some are in any case, but for so few that each is needed.
    fn held_out_of(&self, photos: usize) -> HoldOut {
        match (self.hold_out, self.time()) {
            (HoldOut::Nothing, None) if photos >= MANY => HoldOut::Every(JUDGES_OF_MANY),
            (HoldOut::Nothing, None) if photos >= FEW => HoldOut::Every(JUDGES),
            (chosen, _) => chosen,
        }
    }

    /// The run that ends in its time: size of photos, number of Gaussians, and steps are what it is enough for.
    fn in_time(
        &self,
        settings: RunSettings,
        cameras: &CaptureCameras,
        time: &TimeBudget,
        observe: &mut dyn Observe,
    ) -> Result<RunSettings, Error> {
        time.note_share(observe);
        let work = Work { sides: self.quality.sides(), minutes: time.of_fit(), rounds: ENOUGH_ROUNDS };
        let budget = Budget::of(&settings, cameras, &work, self.rasterizer.clone())?;
        let rounds = if budget.long_side > *work.sides.start() { ENOUGH_ROUNDS } else { MOST_ROUNDS };
        let most_rounds = self.minutes.is_none().then_some(rounds);
        let minutes = Some(time.of_fit());
        let gaussians_in_time = self.gaussians.is_none();
        let settings = RunSettings { most_rounds, minutes, gaussians_in_time, ..settings };
        let (settings, photos) = self.sized(settings, cameras, budget.long_side, Some(budget.gaussians))?;
        let steps = most_rounds.map_or(budget.steps, |rounds| budget.steps.min(rounds * photos));
        let gaussians = settings.fit.gaussians;
        time.note_plan(&Budget { steps, gaussians, ..budget }, photos, self.longer(), observe);
        Ok(settings)
    }

    /// The run that goes on for as long as held-out photos gain.
    fn while_it_gains(
        &self,
        settings: RunSettings,
        cameras: &CaptureCameras,
        observe: &mut dyn Observe,
    ) -> Result<RunSettings, Error> {
        let gaining = Gaining { most_gaussians: self.gaussians, ..Gaining::default() };
        let long_side = Budget::largest_side(&settings, cameras, self.quality.sides())?;
        let (mut settings, photos) =
            self.sized(RunSettings { gaining: Some(gaining), ..settings }, cameras, long_side, None)?;
        settings.fit.steps = Gaining::first_steps(photos);
        let FitSettings { steps, gaussians, .. } = settings.fit;
        let plan = planned(&settings, cameras)?;
        let [held_out, side] = [plan.held_out, plan.size[0].max(plan.size[1])];
        let end = match held_out {
            0 => "no photo is held out, by which more steps could be judged".to_string(),
            _ => format!("then twice as many, for as long as {held_out} held-out photos gain"),
        };
        observe.note(&format!(
            "plan: {steps} steps with {gaussians} Gaussians for {photos} photos of at most {side} pixels; {end}"
        ));
        Ok(settings)
    }

    /// The run with photos of this size and at most so many Gaussians, or as many as are asked for, and the number of
    /// photos that it fits.
    fn sized(
        &self,
        settings: RunSettings,
        cameras: &CaptureCameras,
        long_side: usize,
        gaussians: Option<usize>,
    ) -> Result<(RunSettings, usize), Error> {
        let mut settings = RunSettings { long_side: Some(long_side), ..settings };
        let usual = planned(&settings, cameras)?.usual();
        let gaussians = match (self.gaussians, gaussians) {
            (Some(asked), None) => asked.min(usual.gaussians),
            (asked, planned) => asked.or(planned).unwrap_or(usual.gaussians),
        };
        settings.fit = FitSettings { gaussians, seed: settings.fit.seed, clean: self.clean, ..usual };
        if self.surfaces {
            settings.fit.surfaces = Surfaces::FOR_MESHES;
        }
        settings.fit.check()?;
        let photos = planned(&settings, cameras)?.training;
        Ok((settings, photos))
    }

    /// The flag of a request that takes longer.
    fn longer(&self) -> &'static str {
        match (self.minutes, self.quality) {
            (None, Quality::Draft) => "--quality normal",
            (None, Quality::Normal) => "--quality fine",
            (None, Quality::Fine) => "--quality best",
            (None, Quality::Best) | (Some(_), _) => "--minutes",
        }
    }

    /// Checks what needs no photos.
    fn check(&self) -> Result<(), Error> {
        let fit = FitSettings::default();
        let gaussians = self.gaussians.unwrap_or(fit.gaussians);
        let settings = RunSettings::new(PathBuf::new(), FitSettings { gaussians, seed: self.seed, ..fit });
        RunSettings { minutes: self.minutes, compress: self.compress, ..settings }.check()?;
        Ok(())
    }
}

/// Makes a scene from photos: takes a capture's cameras or estimates them, fits Gaussians, and writes scene, cameras,
/// summary and report into a folder.
///
/// An observer that returns a break to a part of the stage `fit` ends the fit, with results.
///
/// # Errors
/// When photos cannot be read or give no cameras, a setting is out of range, memory does not suffice, or a file cannot
/// be written; when the folder has a fit already.
pub fn reconstruct(photos: &Photos, request: &Request, observe: &mut dyn Observe) -> Result<Outcome, Error> {
    let start = Instant::now();
    request.check()?;
    let masks = request.masks.as_ref();
    let read = photos.paths().iter().chain(masks.and_then(|masks| masks.folder.as_ref()));
    let out = match Run::claim(&request.out, read) {
        Err(Error::Run(weaver_run::Error::RunExists { folder, .. })) => return Err(already_there(&folder)),
        claimed => claimed?,
    };
    let ChosenCapture { capture, hold_out, masks: masked } = capture_of(photos, request, out.out(), observe)?;
    let cameras = CaptureCameras::read(&capture, hold_out)?;
    let settings = RunSettings {
        hold_out,
        masks: masked,
        // Cameras that were estimated come with masks whose white counts.
        invert_masks: matches!(photos, Photos::Capture(_)) && masks.is_some_and(|masks| masks.inverted),
        masked: request.masked,
        by_photos: ByPhotos::ALL.into(),
        compress: request.compress,
        html: request.html,
        ..RunSettings::new(capture, FitSettings { seed: request.seed, ..FitSettings::default() })
    };
    observe.note(&format!("fit: {}", settings.capture.display()));
    let time = request.time().map(|minutes| TimeBudget::new(start, minutes));
    let settings = match &time {
        Some(time) => request.in_time(settings, &cameras, time, observe)?,
        None => request.while_it_gains(settings, &cameras, observe)?,
    };
    let live = request.live.as_ref().map(Listener::try_clone).transpose()?;
    let context = FitContext { rasterizer: request.rasterizer.clone(), live, ..FitContext::default() };
    let outcome = begin(settings, &cameras, context, out, observe)?;
    if let Some(time) = time {
        time.note_excess(observe);
    }
    remark_outcome(&outcome, &request.out, observe);
    Ok(outcome)
}

/// A capture to fit.
struct ChosenCapture {
    capture: PathBuf,
    /// The photos of it that are held out.
    hold_out: HoldOut,
    /// True if masks leave out parts of its photos.
    masks: bool,
}

/// The capture of photos, whose cameras may have to be estimated into the folder of the results.
fn capture_of(
    photos: &Photos,
    request: &Request,
    out: &OutputFolder,
    observe: &mut dyn Observe,
) -> Result<ChosenCapture, Error> {
    let demo;
    let paths = match photos {
        Photos::Capture(capture) => {
            if let Some(folder) = request.masks.as_ref().and_then(|masks| masks.folder.as_ref()) {
                let found = format!("those in {}", folder.display());
                let expected = "masks that the capture names, or in a folder masks in it";
                return Err(Error::Photos { capture: capture.clone(), key: "masks", expected: expected.into(), found });
            }
            observe.note(&format!("cameras: those of {}", capture.display()));
            let hold_out = match (request.hold_out, request.time()) {
                (HoldOut::Nothing, None) => HoldOut::Listed,
                (chosen, _) => chosen,
            };
            return Ok(ChosenCapture { capture: capture.clone(), hold_out, masks: request.masks.is_some() });
        }
        Photos::Demo => {
            demo = [demo::write(out)?];
            &demo
        }
        Photos::Files(paths) => paths.as_slice(),
    };
    let photos = PhotoFiles::collect(paths, request.frames, out, observe)?;
    let hold_out = request.held_out_of(photos.paths.len());
    let chosen = (hold_out, request.masks.as_ref());
    let (capture, masks) = estimated_capture(&photos, chosen, (&request.matching, &request.placing), out, observe)?;
    Ok(ChosenCapture { capture, hold_out: held_out_of_estimated(hold_out), masks })
}

/// Why nothing is made in a folder with a run, and how to go on with one that did not come to its end.
fn already_there(folder: &Path) -> Error {
    let outcome = weaver_io::read_text(folder.join("summary.json")).ok();
    let outcome = outcome.and_then(|text| serde_json::from_str::<Outcome>(&text).ok());
    let message = if outcome.is_some_and(|outcome| outcome.steps >= outcome.planned) {
        "a finished scene is there already; give another --out".into()
    } else {
        let resume = ShellCommand::new("splatweaver fit --resume").path(folder);
        format!("a fit was begun there and did not come to its end; to go on: {resume}")
    };
    Error::AlreadyThere { folder: folder.into(), message, source: Advice::Complete }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A run without a bound of time needs photos to be judged by, unless there are so few that each counts.
    #[test]
    fn photos_are_held_out_where_they_decide() {
        let held_out = |photos: usize, change: fn(&mut Request)| {
            let mut request = Request { quality: Quality::Best, ..Request::new("scene") };
            change(&mut request);
            request.held_out_of(photos)
        };
        assert_eq!(held_out(10, |_| {}), HoldOut::Nothing);
        assert_eq!(held_out(20, |_| {}), HoldOut::Every(8));
        assert_eq!(held_out(100, |_| {}), HoldOut::Every(16));
        assert_eq!(held_out(100, |request| request.hold_out = HoldOut::Every(5)), HoldOut::Every(5));
        assert_eq!(held_out(100, |request| request.minutes = Some(3.0)), HoldOut::Nothing);
        assert_eq!(held_out(100, |request| request.quality = Quality::Normal), HoldOut::Nothing);
    }
}
