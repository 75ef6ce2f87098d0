//! The steps of a fit, and a page that follows them.

use crate::{CURVES, Error, Run};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use weaver_fit::gaussians_of;
use weaver_io::{Observe, Part, Stage};
use weaver_view::Look;
use weaver_view_run::{Listener, LiveRun, LiveView, ScenePage, Server};

/// Name of the stage.
const LABEL: &str = "fit";
/// Weight of a photo in the PSNR that is shown: about fifty photos count.
const SMOOTHED: f64 = 0.02;

/// Makes the remaining steps, until the observer or a visitor of the page requests a stop.
pub(crate) fn advance(
    run: &mut Run,
    folder: &Path,
    live: Option<Listener>,
    observe: &mut dyn Observe,
) -> Result<(), Error> {
    let Some(listener) = live else { return steps(run, &AtomicBool::new(false), observe) };
    let scene = scene_page(run, folder)?;
    run.follow();
    let stop = AtomicBool::new(false);
    let of = run.settings().fit.steps;
    let followed = LiveRun { folder, steps: of, names: &CURVES, showing: LiveView::Scene(&gaussians_of), stop: &stop };
    let server = Server::new(&scene, Some(followed), listener)?;
    observe.note(&format!("live: {}", server.address()));
    server.during(|| steps(run, &stop, observe))
}

/// Makes steps to the end that the run has, and to the next one for as long as it goes on.
fn steps(run: &mut Run, stop: &AtomicBool, observe: &mut dyn Observe) -> Result<(), Error> {
    loop {
        steps_to_end(run, stop, observe)?;
        if stop.load(Ordering::Relaxed) || !run.go_on(observe)? {
            return Ok(());
        }
    }
}

fn steps_to_end(run: &mut Run, stop: &AtomicBool, observe: &mut dyn Observe) -> Result<(), Error> {
    let total = run.settings().fit.steps;
    observe.begin(&Stage { label: LABEL, done: run.fit().steps_done(), total, stops_after: Some("this step") });
    let (mut psnr, mut held_out) = (None, None);
    run.advance(stop, |report| {
        let [last, gaussians] = ["psnr", "gaussians"].map(|name| report.scalar(name).unwrap_or(f64::NAN));
        let smooth = psnr.map_or(last, |p: f64| p + SMOOTHED * (last - p));
        psnr = Some(smooth);
        held_out = report.scalar("held_out").or(held_out);
        let met = held_out.map_or(String::new(), |psnr| format!(" ({psnr:.2} held out)"));
        let note = format!("{smooth:.2} dB{met}, {gaussians} Gaussians");
        if let ControlFlow::Break(()) = observe.progress(&Part { label: LABEL, done: report.step, total, note }) {
            stop.store(true, Ordering::Relaxed);
        }
    })
}

/// The fit as it begins, to look at.
fn scene_page(run: &Run, folder: &Path) -> Result<ScenePage, Error> {
    let look =
        Look { background: run.settings().fit.background, settings: run.fit().raster_settings(), ..Look::default() };
    let scene_page = ScenePage::new(folder.display().to_string(), run.fit().gaussians(), look);
    Ok(ScenePage { shots: run.shots()?, ..scene_page })
}
