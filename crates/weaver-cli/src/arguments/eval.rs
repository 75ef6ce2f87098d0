//! The command line of `splatweaver eval`.

use super::{DensityFlags, LossName, MethodName, RefineFlags, Threads};
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use weaver_command::{Rgb, background, distance, fraction};
use weaver_trainer::LookOf;

/// What is judged, by which views, and the figures.
const WHAT: &str = "What is judged";
const VIEWS: &str = "Views";
const FIGURES: &str = "Figures";

/// Where held-out photos are drawn from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Targets {
    /// The data's cameras
    Data,
    /// The model's own, which it predicts together with the context's
    Joint,
    /// The data's, carried over by the similarity between the context's centers, the data's and the predicted, of three views or more
    Centers,
    /// The context photos themselves judge, from their own cameras: how well what was made of them shows them
    Context,
}

impl From<Targets> for weaver_trainer::Targets {
    fn from(targets: Targets) -> Self {
        match targets {
            Targets::Data => Self::Data,
            Targets::Joint => Self::Joint,
            Targets::Centers => Self::Centers,
            Targets::Context => Self::Context,
        }
    }
}

/// Renders held-out views and compares them with the photos.
///
/// From the Gaussians that a network makes of their nearest training views or, with --scene, from one file of Gaussians, at the
/// photos' own size.
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
  splatweaver eval --run runs/wild --look half
  splatweaver eval --run runs/mine --unseen --json > unseen.json
  splatweaver eval --scene fits/garden-1/scene.ply --data garden --lpips alex.safetensors
  splatweaver eval --scene scene.spz --data garden --size 1600 --background black")]
pub struct Eval {
    /// The run folder; several are told apart in one table, on the same --data [default: the weights that come with the program]
    #[arg(long, conflicts_with = "scene", help_heading = WHAT)]
    pub run: Vec<PathBuf>,
    /// A file of weights instead: a run's checkpoint.safetensors, small weights made of one, or a published checkpoint
    #[arg(long, value_name = "FILE", conflicts_with_all = ["run", "scene"], help_heading = WHAT)]
    pub weights: Option<PathBuf>,
    /// A file of Gaussians, whose world is that of one --data
    #[arg(long, value_name = "SCENE", requires = "data", conflicts_with_all = ["unseen", "views", "cameras", "targets", "unknown_focal", "match_size", "points", "allocation", "budget", "refine", "refine_steps", "refine_size", "refine_in_place"], help_heading = WHAT)]
    pub scene: Option<PathBuf>,
    /// Folder of a capture; may be repeated without --scene [default: the data of the run]
    #[arg(long, value_name = "DIR", help_heading = VIEWS)]
    pub data: Vec<PathBuf>,
    /// The four built-in procedural scenes that are never trained on
    #[arg(long, conflicts_with = "data", help_heading = VIEWS)]
    pub unseen: bool,
    /// Context views for each held-out view [default: the run's]
    #[arg(long, value_name = "V", value_parser = clap::value_parser!(u32).range(1..=1024), help_heading = VIEWS)]
    pub views: Option<u32>,
    /// Cameras of the context views; `estimated` by matching these photos, the held-out view aside [default: the run's]
    #[arg(long, value_enum, help_heading = VIEWS)]
    pub cameras: Option<ContextCameras>,
    /// Where held-out photos are drawn from: from the data's cameras in the frame of the first, or in that which fits all of the context's
    /// centers; from where the model says that they were taken, having seen them beside the context photos, as 2Xplat is published,
    /// with predicted cameras; or `context`, whose photos then judge instead
    #[arg(long, value_enum, default_value_t = Targets::Data, help_heading = VIEWS)]
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
    /// Does not count what is black in masks: mask_path of transforms.json, a file in masks/ named as the photo, or its alpha; without
    /// it, what the run leaves out is left out
    #[arg(long, conflicts_with = "unseen", help_heading = VIEWS)]
    pub masks: bool,
    /// In whose light held-out views are drawn, for runs of --model wild: told by the left `half` of the photo, by all of it (`own`), by
    /// nobody (`none`), or by another photo (`wrong`); all figures are then of the right halves [default: the first context photo's, and
    /// all of each view]
    #[arg(long, value_name = "half|own|none|wrong", conflicts_with_all = ["scene", "refine", "refine_steps", "align"], help_heading = VIEWS)]
    pub look: Option<LookOf>,
    /// Leaves photos as they were taken, where the run was trained with data.looks; a table of runs not all of which were does so, too
    #[arg(long, conflicts_with = "scene", help_heading = VIEWS)]
    pub plain: bool,
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
    pub drawing: Drawing,
    #[command(flatten)]
    pub threads: Threads,
}

/// Cameras of held-out views aligned with their photos.
#[derive(Args, Clone, Copy, Debug)]
#[command(next_help_heading = "Alignment")]
pub struct AlignFlags {
    /// Moves the camera of each held-out view until the render is most like its photo, for figures beside the others: they have looked at
    /// what they are judged by. What that gains with given cameras, where there is nothing to move, is printed with them
    #[arg(long, conflicts_with_all = ["scene", "refine", "refine_steps"])]
    pub align: bool,
    /// Which numbers of the camera move, and at what rate
    #[arg(long, value_enum, default_value = "own", requires = "align")]
    pub align_as: MethodName,
    /// What photo and render are compared by [default: photometric, or mse as published]
    #[arg(long, value_enum, requires = "align")]
    pub align_loss: Option<LossName>,
    /// Steps at most [default: 200, or 100 as published]
    #[arg(long, value_name = "N", requires = "align", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub align_steps: Option<u32>,
}

/// Whose cameras the context views have.
#[derive(Clone, Copy, Debug, Eq, PartialEq, ValueEnum)]
pub enum ContextCameras {
    /// The network's own
    Predicted,
    /// The data's
    Given,
    /// By matching
    Estimated,
}

/// How a scene is drawn. A fit says that in summary.json beside its scene.
#[derive(Args, Debug)]
#[command(next_help_heading = "Drawing a scene")]
pub struct Drawing {
    /// Longest side of the photos in pixels; larger ones are shrunk [default: as they are]
    #[arg(long, value_name = "PIXELS", requires = "scene", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub size: Option<u32>,
    /// The color behind the scene and behind transparent pixels: white, black or R,G,B from 0 to 1 [default: what summary.json
    /// beside the scene says, or white]
    #[arg(long, value_name = "COLOR", requires = "scene", value_parser = background)]
    pub background: Option<Rgb>,
    /// Opacities are lowered where a Gaussian is widened to a pixel; =false if not [default: what summary.json says, or false]
    #[arg(long, value_name = "BOOL", requires = "scene", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    pub antialiased: Option<bool>,
    /// Gaussians nearer to a camera than this are not drawn, world units [default: what summary.json says, or 0.01]
    #[arg(long, value_name = "DISTANCE", requires = "scene", value_parser = distance)]
    pub near: Option<f64>,
    /// Largest opacity of a single Gaussian at a pixel, above 0 and below 1 [default: what summary.json says, or 0.99]
    #[arg(long, value_name = "ALPHA", requires = "scene", value_parser = fraction)]
    pub alpha_max: Option<f64>,
}
