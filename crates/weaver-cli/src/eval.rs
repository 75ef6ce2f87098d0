//! `splatweaver eval`.

mod scene;

use crate::Console;
use crate::align::options;
use crate::arguments::{ContextCameras, Eval};
use crate::failure::Failure;
use crate::progress::Progress;
use crate::refine::refined;
use weaver_inference::RunFolder;
use weaver_trainer::{CameraMode, MatchingOverride, Overrides, Source};

/// Longest side of photos while they are matched, when nothing is said.
const MATCHED: usize = 384;

pub fn run(arguments: &Eval, console: &mut Console) -> Result<(), Failure> {
    match &arguments.scene {
        Some(scene) => scene::run(arguments, scene, console),
        None => of_network(arguments, console),
    }
}

/// Evaluates the network of a run, or the one that comes with the program.
fn of_network(arguments: &Eval, console: &mut Console) -> Result<(), Failure> {
    if arguments.run.is_none() && arguments.data.is_empty() && !arguments.unseen {
        return Err(Failure::Usage("expected --run, --scene, or what to evaluate on: --data or --unseen".into()));
    }
    let source = match (arguments.unseen, arguments.data.is_empty()) {
        (true, _) => Source::Unseen,
        (false, true) => Source::Run,
        (false, false) => Source::Folders(arguments.data.clone()),
    };
    let estimated = arguments.cameras == Some(ContextCameras::Estimated);
    if !estimated && (arguments.unknown_focal || arguments.match_size.is_some()) {
        return Err(Failure::Usage("--unknown-focal, --match-size: expected --cameras estimated with them".into()));
    }
    let cameras = arguments.cameras.and_then(|cameras| match cameras {
        ContextCameras::Predicted => Some(CameraMode::Predicted),
        ContextCameras::Given => Some(CameraMode::Given),
        ContextCameras::Estimated => None,
    });
    let long_side = arguments.match_size.map_or(MATCHED, |side| side as usize);
    let overrides = Overrides {
        context_views: arguments.views.map(|views| views as usize),
        cameras,
        points: arguments.points,
        matching: estimated.then_some(MatchingOverride { long_side, focal_known: !arguments.unknown_focal }),
        density: arguments.density.into(),
        align: arguments.align.align.then(|| options(arguments.align.align_as, arguments.align.align_steps)),
        masks: arguments.masks,
        lpips: arguments.lpips.clone(),
    };
    let mut run = match (arguments.run.as_ref().map(RunFolder::at), &arguments.weights) {
        (Some(folder), _) => weaver_recipes::registry().of_run(&folder)?.open(&folder)?,
        (None, Some(weights)) => weaver_recipes::open_weights(weights)?,
        (None, None) => weaver_recipes::built_in()?,
    };
    run.predictor = refined(run.predictor, &arguments.refine, &[])?;
    if arguments.points && (estimated || cameras.unwrap_or(run.cameras) != CameraMode::Given) {
        return Err(Failure::Usage("--points: expected --cameras given, found other ones".into()));
    }
    if let Some(remark) = run.predictor.remark(overrides.density) {
        console.note(&format!("warning: {remark}"));
    }
    let mut progress = Progress::new("eval", 0, 0, console);
    let mut show = |done, total| progress.at(done, total, String::new, console);
    let evaluation = run.evaluate(&source, &overrides, &mut show);
    progress.finish();
    let evaluation = evaluation?;
    if arguments.json {
        console.print(&serde_json::to_string_pretty(&evaluation)?)
    } else {
        console.print(&evaluation.table())
    }
}
