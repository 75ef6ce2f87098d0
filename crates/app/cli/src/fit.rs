//! `splatweaver fit`.

use crate::arguments::{CameraChoice, ClipFlags, Fit, StrategyName};
use crate::estimate::estimated_capture;
use crate::{Console, Interrupt, clip};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;
use weaver_command::{DeviceFlag, Failure, Progress, device, duration, memory};
use weaver_data::capture::{self, CaptureOptions, HoldOut};
use weaver_fit::{FitRasterizer, FitSettings, Judge, Quality, StrategyKind, init};
use weaver_fit_run::{Folder, Initial, Outcome, Plan, Run, RunSettings, Views, plan};
use weaver_inference::{RunFolder, predict_capture};
use weaver_scene::Gaussians;
use weaver_trainer::evaluate::load_lpips;

/// Time for a run when nothing is said about it, minutes.
const MINUTES: f64 = 2.0;
/// Fewer points than this say little about cameras.
const FEW_POINTS: usize = 50;
/// Fewer Gaussians than this for each pixel of a photo cannot show much.
const FEW: f64 = 0.005;

pub fn run(arguments: &Fit, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    if let Some(folder) = &arguments.resume {
        let Means { judge, rasterizer, .. } = Means::of(arguments)?;
        return finish(Run::resume(folder, judge, rasterizer)?, folder, console, interrupt);
    }
    let capture = arguments.capture.clone().ok_or_else(|| Failure::Usage("expected a capture".into()))?;
    let estimating = match &arguments.cameras {
        None | Some(CameraChoice::Given) => false,
        Some(CameraChoice::Estimated) => true,
        Some(other) => return Err(other.refused("given or estimated")),
    };
    if !estimating {
        arguments.matching.check_unused("given ones")?;
    }
    if arguments.dry_run {
        if estimating {
            return Err(Failure::Usage(
                "--dry-run: expected cameras that are there; `splatweaver cameras` estimates them".into(),
            ));
        }
        let initial = initial(arguments.init.as_deref())?;
        let settings = settings(arguments, (capture, arguments.hold_out.unwrap_or_default()), &initial)?;
        return tell(&plan(&settings)?, &settings, console);
    }
    let folder = arguments.out.clone().unwrap_or_else(|| free_folder(&capture));
    let init = arguments.init.as_deref().map(PathBuf::from).filter(|path| path.is_file());
    let means = Means::of(arguments)?;
    let out = Run::claim(&folder, std::iter::once(&capture).chain(&init).chain(&arguments.lpips))?;
    let hold_out = arguments.hold_out.unwrap_or_default();
    if !estimating {
        let settings = settings(arguments, (capture, hold_out), &means.initial)?;
        return begin(settings, means, out, console, interrupt);
    }
    let images = capture.join("images");
    let images = [if images.is_dir() { images } else { capture }];
    let photos = clip::photos(&images, ClipFlags::default(), out.out(), console)?;
    let capture = estimated_capture(&photos, hold_out, arguments.matching, out.out(), console)?;
    let settings = settings(arguments, (capture, listed(hold_out)), &means.initial)?;
    begin(settings, means, out, console, interrupt)
}

/// What is held out of a capture that was estimated: it lists its photos for testing.
pub fn listed(hold_out: HoldOut) -> HoldOut {
    match hold_out {
        HoldOut::Nothing => HoldOut::Nothing,
        HoldOut::Listed | HoldOut::Every(_) => HoldOut::Listed,
    }
}

/// What a fit works with, opened before photos are matched: what is not there is then found at once.
pub struct Means {
    judge: Judge,
    rasterizer: Arc<dyn FitRasterizer>,
    initial: Begin,
}

impl Means {
    fn of(arguments: &Fit) -> Result<Self, Failure> {
        let judge = Judge::new(arguments.lpips.as_deref().map(load_lpips).transpose()?);
        let rasterizer = device::rasterizer(&arguments.device)?;
        Ok(Self { judge, rasterizer, initial: initial(arguments.init.as_deref())? })
    }

    /// Those of a fit about which nothing is said.
    pub fn usual() -> Result<Self, Failure> {
        let rasterizer = device::rasterizer(&DeviceFlag::default())?;
        Ok(Self { judge: Judge::default(), rasterizer, initial: Begin::Here(Initial::Auto) })
    }
}

/// What is asked for.
fn settings(arguments: &Fit, (capture, hold_out): (PathBuf, HoldOut), initial: &Begin) -> Result<RunSettings, Failure> {
    let settings = RunSettings {
        long_side: arguments.long_side.map(|side| side as usize),
        hold_out,
        views: arguments.max_photos.map(|views| views as usize),
        masks: arguments.masks,
        focal: arguments.refine_focal,
        init: initial.kind(),
        minutes: arguments.steps.is_none().then(|| arguments.minutes.unwrap_or(MINUTES)),
        save_every: arguments.save_every,
        formats: arguments.formats.clone(),
        ..RunSettings::new(capture, FitSettings::default())
    };
    let fit = fit_settings(arguments, &plan(&settings)?.usual())?;
    Ok(RunSettings { measure_exposure: arguments.exposure.is_none(), fit, ..settings })
}

/// Fits a capture, into a folder that was claimed.
pub fn begin(
    settings: RunSettings,
    Means { judge, rasterizer, initial }: Means,
    out: Folder,
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let plan = plan(&settings)?;
    memory::check(plan.total(), "a smaller --long-side or fewer --gaussians reduce it")?;
    let pixels = (plan.size[0] * plan.size[1]) as f64;
    if (settings.fit.gaussians as f64) < FEW * pixels {
        console
            .note(&format!("warning: {} Gaussians for photos of {pixels} pixels: expect blur", settings.fit.gaussians));
    }
    if plan.training == 1 {
        console.note("warning: one photo only: nothing says how far anything is away");
    }
    let given = initial.gaussians(&settings)?;
    if settings.fit.poses.refine {
        console.note(&format!("matching {} photos", plan.training + plan.held_out));
    }
    let folder = out.path().to_path_buf();
    let run = Run::begin(out, settings, given.as_ref(), judge, rasterizer)?;
    run.remarks().iter().for_each(|remark| console.note(&format!("warning: {remark}")));
    if run.colors().differ() {
        let percent = 100.0 * run.colors().spread();
        let corrected = if run.settings().fit.exposure { "their colors are corrected" } else { "nothing is corrected" };
        console
            .note(&format!("photos differ in exposure or white balance, by {percent:.0} % in the median; {corrected}"));
    }
    if let Some(found) = run.matching() {
        let (points, pixels) = (found.points, found.pixels);
        console
            .note(&format!("cameras adjusted to {points} points, which are off by {pixels:.2} pixels in the median"));
        if points < FEW_POINTS {
            console.note("warning: photos agree about few points: cameras stay nearly as given");
        }
    }
    finish(run, &folder, console, interrupt)
}

/// The usual settings, then the file, then flags.
fn fit_settings(arguments: &Fit, usual: &FitSettings) -> Result<FitSettings, Failure> {
    let mut fit: FitSettings = weaver_run::settings::resolve(usual, arguments.config.as_deref(), &arguments.settings)?;
    let set = |to: &mut usize, value: Option<u32>| *to = value.map_or(*to, |value| value as usize);
    set(&mut fit.gaussians, arguments.gaussians);
    set(&mut fit.steps, arguments.steps);
    fit.seed = arguments.seed.unwrap_or(fit.seed);
    fit.sh_degree = arguments.sh.map_or(fit.sh_degree, usize::from);
    fit.antialiased = arguments.antialiased.unwrap_or(fit.antialiased);
    fit.exposure = arguments.exposure.unwrap_or(fit.exposure);
    fit.background = arguments.background.map_or(fit.background, |color| color.0);
    fit.poses.refine |= arguments.refine_cameras;
    if arguments.refine_focal && !fit.poses.refine {
        return Err(Failure::Usage("--refine-focal: expected --refine-cameras with it".into()));
    }
    fit.density.strategy = match arguments.strategy {
        None => fit.density.strategy,
        Some(StrategyName::Split) => StrategyKind::Split,
        Some(StrategyName::Mcmc) => StrategyKind::Mcmc,
        Some(StrategyName::Keep) => StrategyKind::Keep,
    };
    fit.check()?;
    Ok(fit)
}

/// Where Gaussians begin.
enum Begin {
    Here(Initial),
    File(PathBuf),
    /// What a run's network predicts, or that of the weights that come with the program.
    Network(Option<RunFolder>),
}

fn initial(text: Option<&str>) -> Result<Begin, Failure> {
    match text {
        None => Ok(Begin::Here(Initial::Auto)),
        Some("points") => Ok(Begin::Here(Initial::Points)),
        Some("random") => Ok(Begin::Here(Initial::Random)),
        Some("built-in") => Ok(Begin::Network(None)),
        Some(path) if Path::new(path).is_file() => Ok(Begin::File(path.into())),
        Some(path) if RunFolder::at(path).checkpoint_path().exists() => Ok(Begin::Network(Some(RunFolder::at(path)))),
        Some(path) => Err(Failure::message(format!(
            "--init {path}: expected points, random, built-in, a file of Gaussians or the folder of a trained network, found none of them"
        ))),
    }
}

impl Begin {
    fn kind(&self) -> Initial {
        match self {
            Self::Here(initial) => *initial,
            _ => Initial::Given,
        }
    }

    /// The Gaussians that are given.
    fn gaussians(&self, settings: &RunSettings) -> Result<Option<Gaussians>, Failure> {
        match self {
            Self::Here(_) => Ok(None),
            Self::File(path) => Ok(Some(weaver_io::read_gaussians(path)?)),
            Self::Network(folder) => predicted(folder.as_ref(), settings).map(Some),
        }
    }
}

/// What a network makes of the photos to fit to, thinned so that there is room to work in.
fn predicted(folder: Option<&RunFolder>, settings: &RunSettings) -> Result<Gaussians, Failure> {
    let mut run = match folder {
        Some(folder) => weaver_recipes::registry().of_run(folder)?.open(folder)?,
        None => weaver_recipes::built_in()?,
    };
    let [height, width] = run.predictor.image_size();
    let hold_out = settings.hold_out;
    let options = CaptureOptions { width, height, hold_out, masks: settings.masks, ..CaptureOptions::default() };
    let scene = capture::load(&settings.capture, &options)?;
    let mut views = scene.training_views();
    if let Some(most) = settings.views {
        views = weaver_data::uniform(views.len(), most.min(views.len())).into_iter().map(|i| views[i]).collect();
    }
    let gaussians = predict_capture(&mut *run.predictor, &scene, &views, NETWORK_VIEWS, settings.fit.seed)?;
    Ok(init::part_of(&gaussians, init::room(&settings.fit), settings.fit.seed))
}

/// Photos that a network sees at once.
const NETWORK_VIEWS: usize = 4;

/// The folder of a capture's fit that is given none.
fn free_folder(capture: &Path) -> PathBuf {
    let absolute = std::path::absolute(capture).unwrap_or(capture.into());
    let folder = if absolute.is_file() { absolute.parent().unwrap_or(&absolute).to_path_buf() } else { absolute };
    let name = folder.file_name().map_or("capture".into(), |name| name.to_string_lossy().into_owned());
    Folder::free(Path::new("fits"), &name)
}

fn tell(plan: &Plan, settings: &RunSettings, console: &mut Console) -> Result<(), Failure> {
    let mb = |bytes: u64| format!("{:>9.1} MB", bytes as f64 / 1e6);
    let time = settings.minutes.map_or(format!("{} steps", settings.fit.steps), |m| format!("{m} minutes"));
    let [width, height] = plan.size;
    console.print(&format!(
        "{} photos of at most {width}x{height}, {} held out; at most {} Gaussians, {time}\n\
         photos      {}\nGaussians   {}\nrasterizer  {}\ntogether    {}",
        plan.training,
        plan.held_out,
        settings.fit.gaussians,
        mb(plan.photos),
        mb(plan.gaussians),
        mb(plan.rasterizer),
        mb(plan.total())
    ))
}

fn finish(mut run: Run, folder: &Path, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let settings = run.settings();
    let (steps, budget) = (settings.fit.steps, settings.fit.gaussians);
    console.note(&format!(
        "{} photos, {} held out; {steps} steps, at most {budget} Gaussians; results in {}",
        run.fit().photos(),
        run.held_out().len(),
        folder.display()
    ));
    let mut progress = Progress::new("fit", run.fit().steps_done(), steps, console);
    let (mut psnr, start) = (None, Instant::now());
    let stop = interrupt.watch();
    let advanced = run.advance(stop, |report| {
        // Smoothed over about fifty photos.
        let [last, gaussians] = ["psnr", "gaussians"].map(|name| report.scalar(name).unwrap_or(f64::NAN));
        let smooth = psnr.map_or(last, |p: f64| p + 0.02 * (last - p));
        psnr = Some(smooth);
        progress.at(report.step, steps, || format!("{smooth:.2} dB, {gaussians} Gaussians"), console);
    });
    progress.finish();
    advanced?;
    console
        .note(&format!("{} for the steps; drawing and judging every photo", duration(start.elapsed().as_secs_f64())));
    let outcome = run.finish()?;
    print(&outcome, folder, console)
}

fn print(outcome: &Outcome, folder: &Path, console: &mut Console) -> Result<(), Failure> {
    let path = |name: &str| folder.join(name).display().to_string();
    let views = |name: &str, views: &Views| {
        let number = |x: Option<f64>, digits| x.map_or("-".into(), |x| format!("{x:.digits$}"));
        let Quality { psnr, psnr_aligned, ssim, lpips } = views.quality;
        let (aligned, ssim, lpips) = (number(psnr_aligned, 2), number(ssim, 4), number(lpips, 4));
        format!("{name:<10}{:>5}  {psnr:>7.2}  {aligned:>7}  {ssim:>6}  {lpips:>6}\n", views.views)
    };
    let test = match &outcome.test {
        Some(test) => views("held out", test),
        None => "held out   none\n".into(),
    };
    let memory = weaver_io::peak_mb().map_or(String::new(), |peak| format!(", at most {peak:.0} MB of memory"));
    console.note(&format!("{} steps, {}{memory}", outcome.steps, duration(outcome.seconds)));
    for name in &outcome.strangers {
        console.note(&format!("warning: {name} is met far worse than the other photos; it may show something else"));
    }
    console.print(&format!(
        "photos   views     PSNR  aligned    SSIM   LPIPS\n{test}{}{} Gaussians: {}\nreport: {}",
        views("fitted", &outcome.train),
        outcome.gaussians,
        path("scene.ply"),
        path("report.html")
    ))?;
    if outcome.steps < outcome.planned {
        let (done, planned) = (outcome.steps, outcome.planned);
        let folder = folder.display();
        console.note(&format!("ended at step {done} of {planned}; to go on: splatweaver fit --resume {folder}"));
    }
    Ok(())
}
