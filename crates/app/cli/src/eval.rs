//! `splatweaver eval`.

use crate::align;
use crate::arguments::{CameraChoice, Eval, Targets};
use crate::refine::refined;
use clap::ValueEnum;
use serde_json::json;
use std::path::PathBuf;
use std::sync::Arc;
use weaver_command::{Console, Failure, Progress};
use weaver_inference::RunFolder;
use weaver_splat::CpuRasterizer;
use weaver_trainer::{Alignment, CameraMode, MatchingOverride, OpenRun, Overrides, Source, comparison};

/// Longest side of photos while they are matched, when nothing is said.
const MATCHED: usize = 384;

pub fn run(arguments: &Eval, console: &mut Console) -> Result<(), Failure> {
    let several = arguments.run.len() > 1;
    if arguments.data.is_empty() && !arguments.unseen && (several || arguments.run.is_empty()) {
        let runs = if several { "one --run" } else { "--run" };
        return Err(Failure::Usage(format!("expected {runs}, or what to evaluate on: --data or --unseen")));
    }
    let source = match (arguments.unseen, arguments.data.is_empty()) {
        (true, _) => Source::Unseen,
        (false, true) => Source::Run,
        (false, false) => Source::Folders(arguments.data.clone()),
    };
    let estimated = arguments.cameras == Some(CameraChoice::Estimated);
    if !estimated && (arguments.unknown_focal || arguments.match_size.is_some()) {
        return Err(Failure::Usage("--unknown-focal, --match-size: expected --cameras estimated with them".into()));
    }
    let cameras = match &arguments.cameras {
        None | Some(CameraChoice::Estimated) => None,
        Some(CameraChoice::Predicted) => Some(CameraMode::Predicted),
        Some(CameraChoice::Given) => Some(CameraMode::Given),
        Some(other) => return Err(other.refused("predicted, given or estimated")),
    };
    let long_side = arguments.match_size.map_or(MATCHED, |side| side as usize);
    let flags = &arguments.align;
    let runs = opened(arguments)?;
    // One table is of the same photos: in drawn light only if all runs draw it alike.
    let alike = runs.iter().all(|(_, run)| run.data.looks == runs[0].1.data.looks);
    if !alike && !arguments.as_taken {
        console.note("photos as they were taken: these runs do not know the same light");
    }
    let overrides = Overrides {
        context_views: arguments.views.map(|views| views as usize),
        cameras,
        targets: arguments.targets.into(),
        points: arguments.points,
        matching: estimated.then_some(MatchingOverride { long_side, focal_known: !arguments.unknown_focal }),
        density: arguments.density.into(),
        align: flags.align.then(|| Alignment {
            options: align::options(flags.align_as, flags.align_steps),
            loss: align::loss(flags.align_loss, flags.align_as),
        }),
        look: arguments.light_of,
        plain: arguments.as_taken || !alike,
        masks: arguments.masks,
        lpips: arguments.lpips.clone(),
    };
    let mut found = Vec::new();
    for (name, mut run) in runs {
        if run.step < run.planned {
            let (done, planned) = (run.step, run.planned);
            console.note(&format!(
                "warning: {name} is at step {done} of {planned}; to go on: splatweaver train --resume {name}"
            ));
        }
        run.predictor = refined(run.predictor, &arguments.refine, &[], Arc::new(CpuRasterizer))?;
        if arguments.points && (estimated || cameras.unwrap_or(run.cameras) != CameraMode::Given) {
            return Err(Failure::Usage("--points: expected --cameras given, found other ones".into()));
        }
        let of_own_frame = matches!(arguments.targets, Targets::Joint | Targets::Centers);
        if of_own_frame && (estimated || cameras.unwrap_or(run.cameras) != CameraMode::Predicted) {
            let named = arguments.targets.to_possible_value().map_or(String::new(), |value| value.get_name().into());
            return Err(Failure::Usage(format!("--targets {named}: expected --cameras predicted, found other ones")));
        }
        if let Some(remark) = run.predictor.remark(overrides.density) {
            console.note(&format!("warning: {remark}"));
        }
        let mut progress = Progress::new("eval", 0, 0, console);
        let mut show = |done, total| progress.at(done, total, String::new, console);
        let evaluation = run.evaluate(&source, &overrides, &mut show);
        progress.finish();
        found.push((name, evaluation?));
    }
    match (&found[..], arguments.json) {
        ([(_, evaluation)], true) => console.print(&serde_json::to_string_pretty(evaluation)?),
        ([(_, evaluation)], false) => console.print(&evaluation.table()),
        (all, true) => {
            let rows: Vec<_> =
                all.iter().map(|(run, evaluation)| json!({"run": run, "evaluation": evaluation})).collect();
            console.print(&serde_json::to_string_pretty(&rows)?)
        }
        (all, false) => console.print(&comparison(all)),
    }
}

/// What is judged, with its name.
fn opened(arguments: &Eval) -> Result<Vec<(String, OpenRun)>, Failure> {
    if let Some(weights) = &arguments.weights {
        return Ok(vec![(weights.display().to_string(), weaver_recipes::open_weights(weights)?)]);
    }
    if arguments.run.is_empty() {
        return Ok(vec![("built-in".into(), weaver_recipes::built_in()?)]);
    }
    let registry = weaver_recipes::registry();
    let open = |path: &PathBuf| {
        let folder = RunFolder::at(path);
        Ok((path.display().to_string(), registry.of_run(&folder)?.open(&folder)?))
    };
    arguments.run.iter().map(open).collect()
}
