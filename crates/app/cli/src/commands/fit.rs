//! `splatweaver fit`.

mod initial;
mod outcome;

pub use outcome::{conclude, print};

use super::convert::scene_format;
use crate::flags::{CameraChoice, CompleteFlag, MASKED, MatchingFlags, level, minutes};
use crate::processes::{network, together};
use clap::Args;
use initial::Start;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use weaver_command::{
    Console, ConsoleObserver, DeviceFlag, Failure, Interrupt, LiveFlag, MOST_THREADS, Output, Rgb, background, choice,
    device, in_pool, number,
};
use weaver_data::capture::HoldOut;
use weaver_data::posed::{Lenses, Masked};
use weaver_fit::{FitSettings, Judge, StrategyKind, Surfaces, bytes_per_step};
use weaver_io::SceneFormat;
use weaver_ranks::{Alone, Ranks};
use weaver_reconstruct::{ByPhotos, FitContext, FitRequest, Pace, Run, RunSettings, resume};
use weaver_run::settings::{Layers, source};
use weaver_trainer::evaluate::load_lpips;
use weaver_view_run::Listener;

/// Fits Gaussians to the photos of a capture: a scene in minutes.
///
/// The capture is a folder (COLMAP, transforms.json, NeRF-synthetic, RealEstate10K) or a transforms.json. Every eighth
/// photo, or those that the capture lists, are held out and say how good the scene is from elsewhere. Writes scene.ply,
/// cameras, summary.json and report.html. Ctrl-C ends early, with results; --resume goes on to the same bits as an
/// uninterrupted run.
#[derive(Args, Debug, Default)]
#[command(after_help = "Examples:
  splatweaver fit capture
  splatweaver fit capture --minutes 5 --gaussians 100000 -o scene
  splatweaver fit capture/transforms.json --long-side 640 --steps 3000 --seed 7
  splatweaver fit capture --refine-cameras --exposure --hold-out none
  splatweaver fit capture --init scene.ply --set density.until=0.6
  splatweaver fit --resume fits/capture-1
  splatweaver fit capture --dry-run")]
pub struct Fit {
    /// The capture
    #[arg(value_name = "CAPTURE", required_unless_present = "resume")]
    pub capture: Option<PathBuf>,
    /// Folder for the results [default: the first free fits/NAME-N]
    #[arg(short, long, value_name = "DIR", help_heading = RUN, value_parser = Output::folder())]
    pub out: Option<Output>,
    /// The most Gaussians there may be [default: 0.4 for each pixel of a photo, 5000 to 1000000; with a time, at most
    /// as many as it can put in place]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000_000), help_heading = RUN)]
    pub gaussians: Option<u32>,
    /// Time for all of it, matching included; the number of steps follows from the measured speed, and steps are left
    /// out where the machine turns out slower [default: 2]
    #[arg(long, value_name = "M", value_parser = minutes(), help_heading = RUN)]
    pub minutes: Option<f64>,
    /// At least so many steps, whatever the time: they may take longer
    #[arg(long, value_name = "N", default_value_t = RunSettings::LEAST_STEPS as u32, value_parser = clap::value_parser!(u32).range(1..), conflicts_with_all = ["steps", "resume"], help_heading = RUN)]
    pub least_steps: u32,
    /// Steps, instead of a time; each looks at one photo, or at views_per_step
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), conflicts_with = "minutes", help_heading = RUN)]
    pub steps: Option<u32>,
    /// Where the Gaussians begin: points (the capture's), dense (surfaces that photos agree about, and points), random,
    /// built-in (the prediction of the network that comes with the program), a run folder (the prediction of its
    /// network), or a file of Gaussians [default: dense where photos agree about most of their area, and that is found
    /// in time; else points if there are any, else random]
    #[arg(long, value_name = "points|dense|random|built-in|RUN|FILE", help_heading = RUN)]
    pub init: Option<String>,
    /// Seed of everything that is drawn at random [default: 0]
    #[arg(long, value_name = "S", help_heading = RUN)]
    pub seed: Option<u64>,
    /// Goes on with this run, with its own settings
    #[arg(long, value_name = "RUN", help_heading = RUN, conflicts_with_all = ["capture", "out", "gaussians", "minutes", "steps", "init", "seed", "long_side", "sh", "refine_cameras", "refine_focal", "cameras", "antialiased", "exposure", "masks", "invert_masks", "masked", "undistort", "background", "strategy", "hold_out", "max_photos", "formats", "compress", "settings", "config", "dry_run", "if_complete"])]
    pub resume: Option<PathBuf>,
    /// Prints the memory of the run, measures a few seconds of it, and writes nothing
    #[arg(long, help_heading = RUN, conflicts_with = "live")]
    pub dry_run: bool,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long, help_heading = RUN)]
    pub json: bool,
    /// Time between checkpoints, at least
    #[arg(long, value_name = "SECONDS", default_value_t = SAVE_EVERY, value_parser = number(0.0..=1e6, "expected seconds, from 0 to 1000000"), help_heading = RUN)]
    pub save_every: f64,
    #[command(flatten)]
    pub complete: CompleteFlag,
    #[command(flatten)]
    pub device: DeviceFlag,
    /// Threads. Does not change results [default: one per core]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u16).range(1..=MOST_THREADS), help_heading = RUN)]
    pub threads: Option<u16>,
    /// Longest side of the photos in pixels; larger ones are shrunk [default: as they are]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(16..=65_536), help_heading = PHOTOS)]
    pub long_side: Option<u32>,
    /// Which photos are held out: those that the capture lists, or every eighth where it lists none; no photo; or every
    /// so many [default: listed]
    #[arg(long, value_name = "listed|none|N", help_heading = PHOTOS)]
    pub hold_out: Option<HoldOut>,
    /// At most so many photos to fit to, evenly spread
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), help_heading = PHOTOS)]
    pub max_photos: Option<u32>,
    /// Leaves out pixels that are black in masks: mask_path of transforms.json, a file in masks/ named as the photo, or
    /// its alpha
    #[arg(long, help_heading = PHOTOS)]
    pub masks: bool,
    /// Leaves out pixels that are white in masks in place of black ones
    #[arg(long, requires = "masks", help_heading = PHOTOS)]
    pub invert_masks: bool,
    /// Meaning of masked pixels: unknown, or empty space [default: unknown]
    #[arg(long, value_parser = choice(&MASKED), requires = "masks", help_heading = PHOTOS)]
    pub masked: Option<Masked>,
    /// Undoes the distortion of lenses; =false draws the scene through them, and loses nothing of the photos [default:
    /// below 120 degrees]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", help_heading = PHOTOS)]
    pub undistort: Option<bool>,
    /// The color behind everything, and behind transparent pixels: white, black or R,G,B from 0 to 1 [default: the mean
    /// color of the photos; white where photos are transparent]
    #[arg(long, value_name = "COLOR", value_parser = background, help_heading = PHOTOS)]
    pub background: Option<Rgb>,
    /// Corrects the colors of each photo by an affine map; =false if not [default: where photos differ in exposure or
    /// white balance]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", help_heading = PHOTOS)]
    pub exposure: Option<bool>,
    /// The capture's cameras, or cameras estimated from its photos, as `splatweaver cameras` does; these go to
    /// OUT/cameras [default: given]
    #[arg(long, value_name = "given|estimated", help_heading = PHOTOS)]
    pub cameras: Option<CameraChoice>,
    /// Refines the cameras with the scene
    #[arg(long, help_heading = PHOTOS)]
    pub refine_cameras: bool,
    /// Refines the focal length too, one factor for all photos
    #[arg(long, help_heading = PHOTOS)]
    pub refine_focal: bool,
    /// Degree of the spherical harmonics [default: 3]
    #[arg(long, value_name = "0..3", value_parser = clap::value_parser!(u8).range(0..=3), help_heading = SCENE)]
    pub sh: Option<u8>,
    /// Draws antialiased: opacities are lowered where a Gaussian is widened to a pixel; =false if not [default: false]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", help_heading = SCENE)]
    pub antialiased: Option<bool>,
    /// Strategy by which Gaussians are added, removed and moved [default: split]
    #[arg(long, value_parser = choice(StrategyKind::ALL), help_heading = SCENE)]
    pub strategy: Option<StrategyKind>,
    /// Keeps Gaussians that no photo needs; else they are removed at the end
    #[arg(long, help_heading = SCENE, conflicts_with = "resume")]
    pub keep_all: bool,
    /// Fits depth as well, for meshes: by depth_file_path of a transforms.json, else as photos agree about it
    #[arg(long, help_heading = SCENE, conflicts_with = "resume")]
    pub surfaces: bool,
    /// Further files of the scene, in formats that `splatweaver convert --help` lists; may be repeated
    #[arg(long = "also", value_parser = scene_format(), value_name = "FORMAT", help_heading = SCENE)]
    pub formats: Vec<SceneFormat>,
    /// Also writes scene.wsz, at a level from 0, the finest, to 3, and fits the last fifth of the run with its rounding
    /// in place, without Gaussians that are not worth their bits
    #[arg(long, value_name = "LEVEL", num_args = 0..=1, require_equals = true, default_missing_value = "0.25", value_parser = level(), help_heading = SCENE)]
    pub compress: Option<f64>,
    /// Writes no view.html, the page to look at the scene
    #[arg(long, help_heading = SCENE, conflicts_with = "resume")]
    pub no_html: bool,
    #[command(flatten)]
    pub live: LiveFlag,
    /// Also LPIPS, with the weights in this safetensors file
    #[arg(long, value_name = "WEIGHTS", help_heading = SCENE)]
    pub lpips: Option<PathBuf>,
    /// Settings file (TOML) below the flags; `splatweaver config --fit` prints one to start from
    #[arg(long, value_name = "FILE", help_heading = CONFIGURATION)]
    pub config: Option<PathBuf>,
    /// Sets one setting by its path; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE", help_heading = CONFIGURATION)]
    pub settings: Vec<String>,
    #[command(flatten)]
    pub matching: MatchingFlags,
}

/// Seconds between checkpoints when nothing is said.
const SAVE_EVERY: f64 = 20.0;

const PHOTOS: &str = "Photos and cameras";
const SCENE: &str = "Scene";
const CONFIGURATION: &str = "Configuration";
const RUN: &str = "Run";

/// Time for a run when nothing is said about it, minutes.
const MINUTES: f64 = 2.0;

impl Fit {
    /// True if cameras are to be estimated.
    fn estimates(&self) -> Result<bool, Failure> {
        match &self.cameras {
            Some(CameraChoice::Estimated) => Ok(true),
            None | Some(CameraChoice::Given) => self.matching.check_unused("given ones").map(|()| false),
            Some(other) => Err(other.refused("given or estimated")),
        }
    }

    /// Files and folders that have a say in the results.
    pub fn read(&self) -> Vec<PathBuf> {
        let init = Start::of(self.init.as_deref()).ok().and_then(|start| start.file());
        let named = [&self.capture, &self.config, &self.lpips, &init].into_iter().flatten();
        named.cloned().collect()
    }
}

pub fn run(arguments: &Fit, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    together(console, |ranks, console| {
        in_pool(arguments.threads.map(usize::from), || fit(arguments, ranks, console, interrupt))
    })
}

fn fit(
    arguments: &Fit,
    ranks: Option<&Arc<dyn Ranks>>,
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    if let Some(ranks) = ranks.filter(|ranks| ranks.rank() > 0) {
        // The first process alone reads the arguments, has a folder and says how it goes.
        if !arguments.dry_run {
            Run::take_part(device::rasterizer(&arguments.device)?, ranks.clone())?;
        }
        return Ok(());
    }
    if let Some(folder) = &arguments.resume {
        let context = context(arguments, None, ranks)?;
        let outcome = resume(folder, context, &mut ConsoleObserver::interruptible(console, interrupt))?;
        conclude(&outcome, interrupt);
        return print(&outcome, folder, arguments.json, console);
    }
    if arguments.dry_run {
        if arguments.estimates()? {
            return Err(Failure::Usage(
                "--dry-run: expected cameras that are there; `splatweaver cameras` estimates them".into(),
            ));
        }
        return tell(arguments, console);
    }
    let initial = Start::of(arguments.init.as_deref())?;
    let request = request(arguments, &initial)?;
    let context = context(arguments, Some(initial), ranks)?;
    let folder = request.out.clone();
    let outcome = weaver_reconstruct::fit(request, context, &mut ConsoleObserver::interruptible(console, interrupt))?;
    conclude(&outcome, interrupt);
    print(&outcome, &folder, arguments.json, console)
}

/// Rasterizer, judge and start of a fit, opened before photos are matched: a missing file is then found at once.
fn context(arguments: &Fit, initial: Option<Start>, ranks: Option<&Arc<dyn Ranks>>) -> Result<FitContext, Failure> {
    Ok(FitContext {
        judge: Judge::new(arguments.lpips.as_deref().map(load_lpips).transpose()?),
        rasterizer: device::rasterizer(&arguments.device)?,
        live: Listener::of(arguments.live)?,
        given: initial.and_then(Start::given),
        ranks: ranks.cloned().unwrap_or_else(|| Arc::new(Alone)),
    })
}

/// The fit that the arguments ask for.
fn request(arguments: &Fit, initial: &Start) -> Result<FitRequest, Failure> {
    let capture = arguments.capture.clone().ok_or_else(|| Failure::Usage("expected a capture".into()))?;
    let estimates = arguments.estimates()?;
    let out = arguments.out.as_deref().map_or_else(|| FitRequest::free_folder(&capture), Path::to_path_buf);
    let init = arguments.init.as_deref().map(PathBuf::from).filter(|path| path.is_file());
    let (fit, by_photos, gaussians) = fit_settings(arguments)?;
    let settings = RunSettings {
        long_side: arguments.long_side.map(|side| side as usize),
        hold_out: arguments.hold_out.unwrap_or_default(),
        views: arguments.max_photos.map(|views| views as usize),
        masks: arguments.masks,
        invert_masks: arguments.invert_masks,
        masked: arguments.masked.unwrap_or_default(),
        lenses: arguments.undistort.map_or(Lenses::Auto, Lenses::from),
        focal: arguments.refine_focal,
        by_photos,
        init: initial.kind(),
        minutes: arguments.steps.is_none().then(|| arguments.minutes.unwrap_or(MINUTES)),
        least_steps: arguments.least_steps as usize,
        save_every: arguments.save_every,
        formats: arguments.formats.clone(),
        compress: arguments.compress,
        html: !arguments.no_html,
        ..RunSettings::new(capture, fit)
    };
    let estimate = estimates.then(|| arguments.matching.into());
    let read = init.into_iter().chain(arguments.lpips.clone()).collect();
    Ok(FitRequest { out, settings, gaussians, estimate, read })
}

/// Minutes of a fit, if its time is given or is to be measured, and bytes, if its cameras are there.
pub fn estimate(arguments: &Fit, measure: bool) -> Result<(Option<f64>, Option<u64>), Failure> {
    let minutes = arguments.steps.is_none().then(|| arguments.minutes.unwrap_or(MINUTES));
    let given = matches!(arguments.cameras, None | Some(CameraChoice::Given));
    if arguments.capture.is_none() || !given {
        return Ok((minutes, None));
    }
    let initial = Start::of(arguments.init.as_deref())?;
    let (settings, plan) = request(arguments, &initial)?.plan(None)?;
    let bytes = Some(plan.total());
    if minutes.is_some() || !measure {
        return Ok((minutes, bytes));
    }
    let pace = in_pool(arguments.threads.map(usize::from), || pace(&settings, initial, arguments))?;
    Ok((Some(pace.total(settings.fit.steps) / 60.0), bytes))
}

/// Rehearses a fit.
fn pace(settings: &RunSettings, initial: Start, arguments: &Fit) -> Result<Pace, Failure> {
    let given = initial.given().map(|given| given(settings)).transpose().map_err(Failure::Error)?;
    Ok(Pace::of(settings, given.as_ref(), device::rasterizer(&arguments.device)?)?)
}

/// The usual settings, then the file, then flags; which of them photos decide, and the most Gaussians where it is
/// given.
fn fit_settings(arguments: &Fit) -> Result<(FitSettings, BTreeSet<ByPhotos>, Option<usize>), Failure> {
    let (file, sets) = (arguments.config.as_deref(), arguments.settings.as_slice());
    let layers = Layers::of(&RunSettings::usual_fit(), file, sets)?;
    let given = [
        (ByPhotos::Exposure, arguments.exposure.is_some() || layers.gives("exposure")),
        (ByPhotos::Background, arguments.background.is_some() || layers.gives("background")),
        (ByPhotos::Dropout, layers.gives("dropout")),
        (ByPhotos::Start, arguments.init.is_some()),
        (ByPhotos::Means, layers.gives("rates.means")),
        (ByPhotos::Fade, layers.gives("density.opacity_weight")),
        (ByPhotos::Opacities, layers.gives("rates.opacities")),
        (ByPhotos::Coarse, layers.gives("halvings") || layers.gives("coarse_until")),
        (ByPhotos::Sky, false),
    ];
    let by_photos = given.into_iter().filter(|(_, given)| !given).map(|(setting, _)| setting).collect();
    let given = arguments.gaussians.is_some() || layers.gives("gaussians");
    let mut fit = layers.finish(&source(file, sets))?;
    let set = |to: &mut usize, value: Option<u32>| *to = value.map_or(*to, |value| value as usize);
    set(&mut fit.gaussians, arguments.gaussians);
    set(&mut fit.steps, arguments.steps);
    fit.seed = arguments.seed.unwrap_or(fit.seed);
    fit.sh_degree = arguments.sh.map_or(fit.sh_degree, usize::from);
    fit.antialiased = arguments.antialiased.unwrap_or(fit.antialiased);
    fit.exposure = arguments.exposure.unwrap_or(fit.exposure);
    fit.background = arguments.background.map_or(fit.background, |color| color.0);
    fit.clean &= !arguments.keep_all;
    if arguments.surfaces {
        fit.surfaces = Surfaces::FOR_MESHES;
    }
    fit.poses.refine |= arguments.refine_cameras;
    if arguments.refine_focal && !fit.poses.refine {
        return Err(Failure::Usage("--refine-focal: expected --refine-cameras with it".into()));
    }
    fit.density.strategy = arguments.strategy.unwrap_or(fit.density.strategy);
    fit.check()?;
    let gaussians = given.then_some(fit.gaussians);
    Ok((fit, by_photos, gaussians))
}

fn tell(arguments: &Fit, console: &mut Console) -> Result<(), Failure> {
    let initial = Start::of(arguments.init.as_deref())?;
    let (settings, plan) = request(arguments, &initial)?.plan(Some(device::rasterizer(&arguments.device)?))?;
    let time = settings.minutes.map_or(format!("{} steps", settings.fit.steps), |m| format!("{m} minutes"));
    let ([width, height], photos, held_out) = (plan.size, plan.training, plan.held_out);
    let gaussians = settings.fit.gaussians;
    console.print(&format!(
        "{photos} photos of at most {width}x{height}, {held_out} held out; at most {gaussians} Gaussians, {time}\n{plan}"
    ))?;
    let pace = pace(&settings, initial, arguments)?;
    if settings.minutes.is_none() {
        console.print(&format!("{:<28}{:>9.1} s, by a rehearsal", "time", pace.total(settings.fit.steps)))?;
    }
    let step = pace.steps.step;
    console.print(&format!("{:<28}{:>9.1} ms", "a step", 1e3 * step))?;
    let FitSettings { gaussians, sh_degree, views_per_step, .. } = settings.fit;
    console.print(&network(bytes_per_step(gaussians, sh_degree), views_per_step, step / views_per_step as f64))
}
