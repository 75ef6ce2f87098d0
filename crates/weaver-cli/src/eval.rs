//! `splatweaver eval`.

mod scene;

use crate::Console;
use crate::arguments::Eval;
use crate::failure::Failure;
use crate::progress::Progress;
use crate::refine::refined;
use std::path::Path;
use weaver_inference::RunFolder;
use weaver_trainer::{CameraMode, Overrides, Source};

pub fn run(arguments: &Eval, console: &mut Console) -> Result<(), Failure> {
    match (&arguments.run, &arguments.scene) {
        (_, Some(scene)) => scene::run(arguments, scene, console),
        (Some(run), None) => of_run(arguments, run, console),
        (None, None) => Err(Failure::Usage("expected --run or --scene".into())),
    }
}

fn of_run(arguments: &Eval, run: &Path, console: &mut Console) -> Result<(), Failure> {
    let source = match (arguments.unseen, arguments.data.is_empty()) {
        (true, _) => Source::Unseen,
        (false, true) => Source::Run,
        (false, false) => Source::Folders(arguments.data.clone()),
    };
    let overrides = Overrides {
        context_views: arguments.views.map(|views| views as usize),
        cameras: arguments.cameras,
        points: arguments.points,
        density: arguments.density.into(),
        lpips: arguments.lpips.clone(),
    };
    let folder = RunFolder::at(run);
    let mut run = weaver_recipes::registry().of_run(&folder)?.open(&folder)?;
    run.predictor = refined(run.predictor, &arguments.refine, &[])?;
    if arguments.points && arguments.cameras.unwrap_or(run.evaluation.cameras) != CameraMode::Given {
        return Err(Failure::Usage("--points: expected --cameras given, found predicted ones".into()));
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
