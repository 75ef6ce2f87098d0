//! `splatweaver eval`.

use super::align::{LOSSES, METHODS};
use crate::flags::{CameraChoice, DensityFlags, RefineFlags};
use crate::methods;
use clap::Args;
use serde_json::json;
use std::path::PathBuf;
use weaver_command::{Console, DeviceFlag, Failure, Progress, ShellCommand, Threads, choice, device};
use weaver_fit::align::{AlignLoss, Method, Options as AlignOptions};
use weaver_splat::Renderer;
use weaver_trainer::{Alignment, CameraMode, EvalOptions, LookOf, MatchingOverride, Source, Targets, comparison};

/// Heading of the flags that choose views and figures.
const WHAT: &str = "What is judged";
const VIEWS: &str = "Views";
const FIGURES: &str = "Figures";

/// Where held-out photos are drawn from.
const TARGETS: [(&str, Targets, &str); 4] = [
    ("data", Targets::Data, "The data's cameras"),
    ("joint", Targets::Joint, "The model's own, which it predicts together with the context's"),
    (
        "centers",
        Targets::Centers,
        "The data's, carried over by the similarity between the context's centers, the data's and the predicted, of three views or more",
    ),
    (
        "context",
        Targets::Context,
        "The context photos themselves judge, from their own cameras: how well what was made of them shows them",
    ),
];

/// Renders held-out views and compares them with the photos.
///
/// From the Gaussians that a network makes of their nearest training views. `splatweaver compare` judges one file of
/// Gaussians.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver eval --run runs/mine
  splatweaver eval --run runs/mine --data ramen --cameras given --allocation grid --budget 0.25
  splatweaver eval --run runs/mine --data ramen --cameras given --points
  splatweaver eval --run runs/mine --data ramen --cameras estimated --refine-steps 60
  splatweaver eval --data ramen --points
  splatweaver eval --weights mine.safetensors --data ramen --cameras given
  splatweaver eval --run runs/mine --data ramen --align
  splatweaver eval --run runs/mine --run runs/two-experts --data ramen --targets joint
  splatweaver eval --run runs/wild --light-of half
  splatweaver eval --run runs/mine --unseen --json > unseen.json")]
pub struct Eval {
    /// The run folder; several are told apart in one table, on the same --data [default: the weights that come with the
    /// program]
    #[arg(long, help_heading = WHAT)]
    pub run: Vec<PathBuf>,
    /// A file of weights instead: a run's checkpoint.safetensors, small weights made of one, or a published checkpoint
    #[arg(long, value_name = "FILE", conflicts_with = "run", help_heading = WHAT)]
    pub weights: Option<PathBuf>,
    /// Folder of a capture; may be repeated [default: the data of the run]
    #[arg(long, value_name = "DIR", help_heading = VIEWS)]
    pub data: Vec<PathBuf>,
    /// The four built-in procedural scenes that are never trained on
    #[arg(long, conflicts_with = "data", help_heading = VIEWS)]
    pub unseen: bool,
    /// Context views for each held-out view [default: the run's]
    #[arg(long, value_name = "V", value_parser = clap::value_parser!(u32).range(1..=1024), help_heading = VIEWS)]
    pub views: Option<u32>,
    /// Cameras of the context views; `estimated` by matching these photos, the held-out view aside [default: the run's]
    #[arg(long, value_name = "predicted|given|estimated", help_heading = VIEWS)]
    pub cameras: Option<CameraChoice>,
    /// Where held-out photos are drawn from: from the data's cameras in the frame of the first, or in that which fits
    /// all of the context's centers; from where the model says that they were taken, having seen them beside the
    /// context photos, as 2Xplat is published, with predicted cameras; or `context`, whose photos then judge instead
    #[arg(long, value_parser = choice(&TARGETS), default_value = "data", help_heading = VIEWS)]
    pub targets: Targets,
    /// With estimated cameras: focal lengths are not told, as by photos without EXIF
    #[arg(long, help_heading = VIEWS)]
    pub unknown_focal: bool,
    /// With estimated cameras: longest side of the photos while they are matched [default: 384]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(64..=8192), help_heading = VIEWS)]
    pub match_size: Option<u32>,
    /// Given cameras come with the points that the context photos see: depth is brought to these
    #[arg(long, help_heading = VIEWS)]
    pub points: bool,
    /// Does not count pixels that are black in masks: mask_path of transforms.json, a file in masks/ named as the
    /// photo, or its alpha; without it, masks count as in the run
    #[arg(long, conflicts_with = "unseen", help_heading = VIEWS)]
    pub masks: bool,
    /// In whose light held-out views are drawn, for runs of --model wild: told by the left `half` of the photo, by all
    /// of it (`own`), by nobody (`none`), or by another photo (`wrong`); all figures are then of the right halves
    /// [default: the first context photo's, and all of each view]
    #[arg(long, value_name = "half|own|none|wrong", conflicts_with_all = ["refine", "refine_steps", "align"], help_heading = VIEWS)]
    pub light_of: Option<LookOf>,
    /// Leaves photos as they were taken, where the run was trained with data.looks; a table of runs not all of which
    /// were does so, too
    #[arg(long, help_heading = VIEWS)]
    pub as_taken: bool,
    #[command(flatten)]
    pub density: DensityFlags,
    #[command(flatten)]
    pub refine: RefineFlags,
    #[command(flatten)]
    pub align: AlignFlags,
    /// Also LPIPS, with the weights in this safetensors file
    #[arg(long, value_name = "WEIGHTS", help_heading = FIGURES)]
    pub lpips: Option<PathBuf>,
    /// Prints the figures as JSON, and nothing else on standard output
    #[arg(long, help_heading = FIGURES)]
    pub json: bool,
    #[command(flatten)]
    pub device: DeviceFlag,
    #[command(flatten)]
    pub threads: Threads,
}

/// Cameras of held-out views aligned with their photos.
#[derive(Args, Clone, Copy, Debug)]
#[command(next_help_heading = "Alignment")]
pub struct AlignFlags {
    /// Moves the camera of each held-out view until the render is most like its photo, for figures beside the others:
    /// they have looked at their own judges. The gain with given cameras, where there is nothing to move,
    /// is printed with them
    #[arg(long, conflicts_with_all = ["refine", "refine_steps"])]
    pub align: bool,
    /// Which numbers of the camera move, and at what rate
    #[arg(long, value_parser = choice(&METHODS), default_value = "own", requires = "align")]
    pub align_as: Method,
    /// Loss between photo and render [default: photometric, or mse as published]
    #[arg(long, value_parser = choice(&LOSSES), requires = "align")]
    pub align_loss: Option<AlignLoss>,
    /// Steps at most [default: 200, or 100 as published]
    #[arg(long, value_name = "N", requires = "align", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub align_steps: Option<u32>,
}

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
    let rasterizer = device::rasterizer(&arguments.device)?;
    let runs = methods::models().open_all(arguments.weights.as_deref(), &arguments.run)?;
    // One table is of the same photos: in drawn light only if all runs draw it alike.
    let alike = runs.iter().all(|(_, run)| run.data.looks == runs[0].1.data.looks);
    if !alike && !arguments.as_taken {
        console.note("photos as they were taken: these runs do not know the same light");
    }
    let options = EvalOptions {
        context_views: arguments.views.map(|views| views as usize),
        cameras,
        targets: arguments.targets,
        points: arguments.points,
        matching: estimated.then_some(MatchingOverride { long_side, focal_known: !arguments.unknown_focal }),
        density: arguments.density.into(),
        align: flags.align.then(|| Alignment {
            options: AlignOptions::of(flags.align_as).in_steps(flags.align_steps.map(|steps| steps as usize)),
            loss: flags.align_loss.unwrap_or(AlignLoss::of(flags.align_as)),
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
            let resume = match arguments.weights {
                None => format!("; to go on: {}", ShellCommand::new("splatweaver train --resume").path(&name)),
                Some(_) => String::new(),
            };
            console.warning(&format!("{name} is at step {done} of {planned}{resume}"));
        }
        *run.predictor.renderer() = Renderer::new(rasterizer.clone());
        run.predictor = arguments.refine.refined(run.predictor, &[], rasterizer.clone())?;
        if arguments.points && (estimated || cameras.unwrap_or(run.cameras) != CameraMode::Given) {
            return Err(Failure::Usage("--points: expected --cameras given, found other ones".into()));
        }
        let of_own_frame = matches!(arguments.targets, Targets::Joint | Targets::Centers);
        if of_own_frame && (estimated || cameras.unwrap_or(run.cameras) != CameraMode::Predicted) {
            let named =
                TARGETS.iter().find(|(_, targets, _)| *targets == arguments.targets).map_or("", |(name, ..)| name);
            return Err(Failure::Usage(format!("--targets {named}: expected --cameras predicted, found other ones")));
        }
        if let Some(remark) = run.predictor.remark(options.density) {
            console.warning(&remark);
        }
        let mut progress = Progress::new("eval", 0, 0, console);
        let mut show = |done, total| progress.at(done, total, String::new, console);
        let evaluation = run.evaluate(&source, &options, &mut show);
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
