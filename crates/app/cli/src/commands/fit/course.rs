//! The course of a fit, from what it begins with to what is printed at its end.

use super::Fit;
use super::initial::Start;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;
use weaver_command::{Console, DeviceFlag, Failure, Interrupt, Progress, ShellCommand, device, duration, memory};
use weaver_fit::{FitRasterizer, Judge, Quality, gaussians_of};
use weaver_fit_run::{CURVES, Folder, Initial, Outcome, Run, RunSettings, Views, plan};
use weaver_ranks::{Alone, Ranks};
use weaver_trainer::evaluate::load_lpips;
use weaver_view::Look;
use weaver_view_run::{Exhibit, Followed, Listener, Server, Showing, live};

/// The page to look at a scene.
pub const VIEW: &str = "view.html";
/// Excess of a time that is worth a word, seconds.
const SHOWN: f64 = 0.5;
/// Fewer points than this say little about cameras.
const FEW_POINTS: usize = 50;
/// Fewer Gaussians than this for each pixel of a photo cannot show much.
const FEW: f64 = 0.005;

/// Rasterizer, judge and start of a fit, opened before photos are matched: a missing file is then found at once.
pub struct Means {
    pub judge: Judge,
    pub rasterizer: Arc<dyn FitRasterizer>,
    pub initial: Start,
    /// The processes that share the steps.
    pub ranks: Arc<dyn Ranks>,
    /// Where a page in the browser follows the fit, if one does.
    pub live: Option<Listener>,
}

impl Means {
    pub fn of(arguments: &Fit, ranks: Option<&Arc<dyn Ranks>>) -> Result<Self, Failure> {
        let ranks = ranks.cloned().unwrap_or_else(|| Arc::new(Alone));
        let judge = Judge::new(arguments.lpips.as_deref().map(load_lpips).transpose()?);
        let rasterizer = device::rasterizer(&arguments.device)?;
        let live = Listener::of(arguments.live)?;
        Ok(Self { judge, rasterizer, initial: Start::of(arguments.init.as_deref())?, ranks, live })
    }

    /// Those of a fit about which nothing is said.
    pub fn usual(live: Option<Listener>) -> Result<Self, Failure> {
        let rasterizer = device::rasterizer(&DeviceFlag::default())?;
        let (judge, initial, ranks) = (Judge::default(), Start::default(), Arc::new(Alone));
        Ok(Self { judge, rasterizer, initial, ranks, live })
    }
}

/// Fits a capture, into a folder that was claimed.
pub fn begin(
    settings: RunSettings,
    Means { judge, rasterizer, initial, ranks, live }: Means,
    out: Folder,
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<Outcome, Failure> {
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
    let run = Run::begin_shared(out, settings, given.as_ref(), judge, rasterizer, ranks)?;
    run.remarks().iter().for_each(|remark| console.note(&format!("warning: {remark}")));
    if let Some(rounds) = run.settings().most_rounds.filter(|_| run.ends_early()) {
        console.note(&format!("each photo is used {rounds} times; the time that is left would only overfit"));
    }
    if run.colors().differ() {
        let percent = 100.0 * run.colors().spread();
        let corrected = if run.settings().fit.exposure { "their colors are corrected" } else { "nothing is corrected" };
        console
            .note(&format!("photos differ in exposure or white balance, by {percent:.0} % in the median; {corrected}"));
    }
    if !run.coverage().is_empty() {
        covered(&run, console);
    }
    if let Some(found) = run.matching() {
        let (points, pixels) = (found.points, found.pixels);
        console
            .note(&format!("cameras adjusted to {points} points, which are off by {pixels:.2} pixels in the median"));
        if points < FEW_POINTS {
            console.note("warning: photos agree about few points: cameras stay nearly as given");
        }
    }
    finish(run, (&folder, live), console, interrupt)
}

/// Tells what photos agree about, and which of them stand alone.
fn covered(run: &Run, console: &mut Console) {
    let percent = 100.0 * run.coverage().mean();
    let begin = match run.settings().init {
        Initial::Dense => "Gaussians begin there",
        _ => "too little to begin there; photos that are closer together would help",
    };
    console.note(&format!("two other photos agree about {percent:.0} % of a photo in the mean; {begin}"));
    let alone = run.coverage().alone();
    if !alone.is_empty() {
        console.note(&format!(
            "warning: what these photos show, hardly another one does, which leaves its depth open; photos from beside them would help: {}",
            alone.join(", ")
        ));
    }
}

/// Goes on to the end; a page follows if the fit is live.
pub fn finish(
    mut run: Run,
    (folder, listener): (&Path, Option<Listener>),
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<Outcome, Failure> {
    let settings = run.settings();
    let (steps, budget) = (settings.fit.steps, settings.fit.gaussians);
    console.note(&format!(
        "{} photos, {} held out; {steps} steps, at most {budget} Gaussians; results in {}",
        run.fit().photos(),
        run.held_out().len(),
        folder.display()
    ));
    let stop = interrupt.watch_after("this step");
    let exhibit = listener.is_some().then(|| exhibit(&run, folder)).transpose()?;
    if listener.is_some() {
        run.follow();
    }
    let followed = Followed { folder, steps, names: &CURVES, showing: Showing::Scene(&gaussians_of), stop };
    let shown = exhibit.as_ref().zip(listener);
    let server = shown.map(|(exhibit, listener)| Server::new(exhibit, Some(followed), listener)).transpose()?;
    let mut progress = Progress::new("fit", run.fit().steps_done(), steps, console);
    let (mut psnr, mut held_out, start) = (None, None, Instant::now());
    let advanced = live(server, console, |console| {
        run.advance(stop, |report| {
            // Smoothed over about fifty photos.
            let [last, gaussians] = ["psnr", "gaussians"].map(|name| report.scalar(name).unwrap_or(f64::NAN));
            let smooth = psnr.map_or(last, |p: f64| p + 0.02 * (last - p));
            psnr = Some(smooth);
            held_out = report.scalar("held_out").or(held_out);
            let met = held_out.map_or(String::new(), |psnr| format!(" ({psnr:.2} held out)"));
            progress.at(report.step, steps, || format!("{smooth:.2} dB{met}, {gaussians} Gaussians"), console);
        })
    });
    progress.finish();
    advanced?;
    console
        .note(&format!("{} for the steps; drawing and judging every photo", duration(start.elapsed().as_secs_f64())));
    Ok(run.finish()?)
}

/// The fit as it begins, to look at.
fn exhibit(run: &Run, folder: &Path) -> Result<Exhibit, Failure> {
    let look =
        Look { background: run.settings().fit.background, settings: run.fit().raster_settings(), ..Look::default() };
    let exhibit = Exhibit::new(folder.display().to_string(), run.fit().gaussians(), look);
    Ok(Exhibit { shots: run.shots()?, ..exhibit })
}

/// Says at the end of a command that it took longer than the minutes it was given.
pub fn note_excess(minutes: Option<f64>, start: Instant, console: &mut Console) {
    let (seconds, asked) = (start.elapsed().as_secs_f64(), minutes.map_or(f64::INFINITY, |minutes| 60.0 * minutes));
    if seconds > asked + SHOWN {
        let [all, more] = [seconds, seconds - asked].map(duration);
        console.note(&format!("{all} in all, {more} more than was asked for"));
    }
}

/// Prints the quality of a scene, for people or as JSON.
pub fn print(outcome: &Outcome, folder: &Path, json: bool, console: &mut Console) -> Result<(), Failure> {
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
    let left_out = match outcome.left_out {
        0 => String::new(),
        count => format!(", of which {count} were left out to end in time"),
    };
    console.note(&format!("{} steps{left_out}, {}{memory}", outcome.steps, duration(outcome.seconds)));
    outcome.missing.iter().for_each(|missing| console.note(&format!("warning: not written: {missing}")));
    for name in &outcome.outliers {
        console.note(&format!("warning: {name} is met far worse than the other photos; it may show something else"));
    }
    if !outcome.transients.is_empty() {
        let most = 100.0 * outcome.transients.values().fold(0.0, |a: f64, b| a.max(*b));
        let count = outcome.transients.len();
        console.note(&format!(
            "in {count} photos something was left out that no other photo shows, at most {most:.0} % of a photo: {}",
            path("transients")
        ));
    }
    if outcome.steps < outcome.planned {
        let (done, planned) = (outcome.steps, outcome.planned);
        let resume = ShellCommand::new("splatweaver fit --resume").path(folder);
        console.note(&format!("ended at step {done} of {planned}; to go on: {resume}"));
    }
    if json {
        return console.print(&serde_json::to_string_pretty(outcome)?);
    }
    console.print(&format!(
        "photos   views     PSNR  aligned    SSIM   LPIPS\n{test}{}{} Gaussians: {}\nreport: {}{}",
        views("fitted", &outcome.train),
        outcome.gaussians,
        path("scene.ply"),
        path("report.html"),
        if folder.join(VIEW).is_file() { format!("\nlook: {}", path(VIEW)) } else { String::new() }
    ))
}
