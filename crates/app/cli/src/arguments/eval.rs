//! The command line of `splatweaver eval`.

use super::{CameraChoice, DensityFlags, LossName, MethodName, RefineFlags, Threads};
use clap::{Args, ValueEnum};
use std::path::PathBuf;
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
/// From the Gaussians that a network makes of their nearest training views. `splatweaver compare` judges one file of Gaussians.
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
    /// The run folder; several are told apart in one table, on the same --data [default: the weights that come with the program]
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
    #[arg(long, value_name = "half|own|none|wrong", conflicts_with_all = ["refine", "refine_steps", "align"], help_heading = VIEWS)]
    pub light_of: Option<LookOf>,
    /// Leaves photos as they were taken, where the run was trained with data.looks; a table of runs not all of which were does so, too
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
    pub threads: Threads,
}

/// Cameras of held-out views aligned with their photos.
#[derive(Args, Clone, Copy, Debug)]
#[command(next_help_heading = "Alignment")]
pub struct AlignFlags {
    /// Moves the camera of each held-out view until the render is most like its photo, for figures beside the others: they have looked at
    /// what they are judged by. What that gains with given cameras, where there is nothing to move, is printed with them
    #[arg(long, conflicts_with_all = ["refine", "refine_steps"])]
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
