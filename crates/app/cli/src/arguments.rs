//! The command line and its help texts.

mod align;
mod cameras;
mod compare;
mod convert;
mod dynamic;
mod eval;
mod fit;
mod hold_out;
mod image;
mod light;
mod matching;
mod photos;
mod refine;
mod render;

pub use align::{Align, LossName, MethodName, Switch};
pub use cameras::CameraChoice;
pub use compare::Compare;
pub use convert::{Convert, Keep, Score, Triple};
pub use dynamic::{
    Dynamic, DynamicCommand, DynamicDistil, DynamicEval, DynamicPrune, DynamicRender, DynamicTrain, PresetName,
};
pub use eval::{Eval, Targets};
pub use fit::{Fit, StrategyName};
pub use image::{ImageBench, ImageCommand, ImageDraw, ImageFit, Pictures};
pub use light::LightFlags;
pub use matching::{ClipFlags, MatchingFlags};
pub use photos::{Cameras, Reconstruct};
pub use refine::RefineFlags;
pub use render::Render;
pub use weaver_vad_run::Vad;

use clap::{ArgGroup, Args, CommandFactory, FromArgMatches, Parser, Subcommand};
use std::ffi::OsString;
use std::path::PathBuf;
use weaver_bench::Bench;
use weaver_command::{DeviceFlag, MOST_SEED, MOST_THREADS, Threads};
use weaver_inference::Density;
use weaver_lidar_run::{EvalMesh, EvalTrajectory, Lidar, Meshing};
use weaver_lift_run::{Lift, Query};
use weaver_router::AllocationKind;

/// The whole command line.
#[derive(Debug, Parser)]
#[command(
    name = "splatweaver",
    version,
    about = "A few photos in, camera poses and compact 3-D Gaussians out; trained and run on a CPU.",
    after_help = "Examples:
  splatweaver reconstruct photos -o scene              a scene from photos and nothing else
  splatweaver reconstruct clip.mp4 -o scene            the same from a video
  splatweaver train --preset tiny                      train on the built-in scenes
  splatweaver train --data fox --data fern --out runs/mine
  splatweaver eval --run runs/mine --json
  splatweaver infer --run runs/mine a.jpg b.jpg c.jpg d.jpg -o result
  splatweaver fit capture --minutes 2 -o scene
  splatweaver render result/scene.ply --orbit 60 -o turn
  splatweaver align scene.ply --photos later --cameras guess.json -o aligned
  splatweaver lift scene.ply --cameras transforms.json --features dino -o lifted.safetensors
  splatweaver compare scene/scene.ply --data photos
  splatweaver info result/scene.ply
  splatweaver bench raster --synthetic 100000,640,480

`splatweaver <command> --help` tells more."
)]
pub struct CommandLine {
    #[command(subcommand)]
    pub command: Command,
}

/// The commands, as the help lists them.
const GROUPS: [(&str, &[&str]); 4] = [
    ("Reconstruct", &["reconstruct", "cameras", "fit", "infer"]),
    ("Look", &["render", "compare", "info", "convert"]),
    ("Learn", &["train", "eval", "config", "convert-weights"]),
    (
        "More",
        &[
            "align",
            "lift",
            "query",
            "dynamic",
            "vad",
            "lidar",
            "mesh",
            "eval-trajectory",
            "eval-mesh",
            "image",
            "bench",
            "completions",
        ],
    ),
];

impl CommandLine {
    /// Parses the words of a command line, whose first is the program's name.
    pub fn of(words: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> Result<Self, clap::Error> {
        Self::from_arg_matches(&Self::grouped().try_get_matches_from(words)?)
    }

    /// The program, whose help lists the commands in groups.
    fn grouped() -> clap::Command {
        let program = Self::command();
        let about = |name: &str| {
            let about = program.find_subcommand(name).and_then(clap::Command::get_about);
            about.map_or(String::new(), ToString::to_string)
        };
        let width = GROUPS.iter().flat_map(|(_, names)| *names).map(|name| name.len()).max().unwrap_or(0);
        let group = |(title, names): &(&str, &[&str])| {
            let lines = names.iter().map(|name| format!("  {name:<width$}  {}\n", about(name)));
            format!("{title}:\n{}\n", lines.collect::<String>())
        };
        let groups: String = GROUPS.iter().map(group).collect();
        let template = format!(
            "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{groups}Options:\n{{options}}{{after-help}}"
        );
        program.help_template(template)
    }
}

/// A flag of a command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Flag {
    /// The command, with a space before a second word.
    pub command: String,
    /// The long name, without dashes.
    pub name: String,
    /// What stands for its value, alternatives with `|` between; `None` for a switch.
    pub value: Option<String>,
}

/// The flags of all commands, from the definition that the program parses by.
pub fn flags() -> Vec<Flag> {
    let mut found = Vec::new();
    for command in CommandLine::command().get_subcommands() {
        let inner: Vec<_> = command.get_subcommands().collect();
        if inner.is_empty() {
            add_flags(command.get_name().to_string(), command, &mut found);
        }
        for second in inner {
            add_flags(format!("{} {}", command.get_name(), second.get_name()), second, &mut found);
        }
    }
    found
}

fn add_flags(name: String, command: &clap::Command, found: &mut Vec<Flag>) {
    for argument in command.get_arguments() {
        let Some(long) = argument.get_long() else { continue };
        let values = argument.get_possible_values();
        let named = argument.get_value_names().map(|names| names.join(" "));
        let listed = values.iter().map(|value| value.get_name()).collect::<Vec<_>>().join("|");
        let value = match (argument.get_action().takes_values(), named) {
            (false, _) => None,
            (true, Some(named)) if values.is_empty() => Some(named),
            (true, None) if values.is_empty() => Some("N".into()),
            (true, _) => Some(listed),
        };
        found.push(Flag { command: name.clone(), name: long.to_string(), value });
    }
}

/// One command.
#[derive(Debug, Subcommand)]
pub enum Command {
    Reconstruct(Reconstruct),
    Cameras(Cameras),
    Train(Train),
    Eval(Eval),
    Infer(Infer),
    Fit(Fit),
    Render(Render),
    Compare(Compare),
    Align(Align),
    Lift(Lift),
    Query(Query),
    Dynamic(Dynamic),
    Vad(Vad),
    Lidar(Lidar),
    Mesh(Meshing),
    EvalTrajectory(EvalTrajectory),
    EvalMesh(EvalMesh),
    Image(Pictures),
    Info(Info),
    Convert(Convert),
    ConvertWeights(ConvertWeights),
    Bench(Bench),
    Config(Config),
    Completions(Completions),
}

/// Trains a model and writes a run folder: checkpoint, logs, sample pictures, report.html.
///
/// Without --data it trains on built-in procedural scenes. Ctrl-C saves a checkpoint and ends; --resume goes on to the
/// same bits as an uninterrupted run.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver train
  splatweaver train --preset micro --steps 20 --out /tmp/try
  splatweaver train --data fox --data fern --set stages.1.rate=5e-4 --set data.pool=8
  splatweaver train --resume runs/tiny-1
  splatweaver train --resume runs/tiny-1 --steps 8000
  splatweaver train --init runs/tiny-1 --data fox --steps 1000
  splatweaver train --preset tiny-endless --set data.endless=none --init built-in --data fox --steps 1500
  splatweaver train --data photos --teacher model.safetensors --preset tiny-published
  splatweaver train --preset small --dry-run
  splatweaver train --steps 20 --trace step.json")]
pub struct Train {
    /// Folder of a capture (COLMAP, transforms.json, NeRF-synthetic, RealEstate10K); may be repeated
    #[arg(long, value_name = "DIR", help_heading = "Data")]
    pub data: Vec<PathBuf>,
    /// For --data of photos without cameras: a published checkpoint, VGGT's or SplatWeaver's, from which they get cameras and depth;
    /// what it says is kept beside the photos, in teacher.safetensors
    #[arg(long, value_name = "FILE", requires = "data", help_heading = "Data")]
    pub teacher: Option<PathBuf>,
    /// The model to train [default: splatweaver]
    #[arg(long, value_name = "NAME", help_heading = CONFIGURATION)]
    pub model: Option<String>,
    /// Where the configuration starts from: micro, tiny, tiny-endless, tiny-published, tiny-dagger, small or medium [default: the file's, or tiny]
    #[arg(long, help_heading = CONFIGURATION)]
    pub preset: Option<String>,
    /// Configuration file (TOML) between the preset and the flags; `splatweaver config` prints one to start from
    #[arg(long, value_name = "FILE", help_heading = CONFIGURATION)]
    pub config: Option<PathBuf>,
    /// Sets a configuration value by its path, list entries by number; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE", help_heading = CONFIGURATION)]
    pub settings: Vec<String>,
    /// Steps in all; the stages are rescaled in proportion. With --resume: the last stage becomes longer, and its rate follows the
    /// longer cosine from then on
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), help_heading = CONFIGURATION)]
    pub steps: Option<u32>,
    /// Seed of weights, data order and noise
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u64).range(..=MOST_SEED), help_heading = CONFIGURATION)]
    pub seed: Option<u64>,
    /// Folder of the run [default: the first free runs/PRESET-N]
    #[arg(short, long, value_name = "DIR", help_heading = RUN)]
    pub out: Option<PathBuf>,
    /// Starts from the averaged weights of this run or checkpoint, of whichever model, from a published checkpoint, or with `built-in` from
    /// those that come with the program, as far as they fit; what was taken is said
    #[arg(long, value_name = "built-in|RUN|FILE", help_heading = RUN)]
    pub init: Option<PathBuf>,
    /// Goes on with this run, with its own configuration
    #[arg(long, value_name = "RUN", help_heading = RUN, conflicts_with_all = ["model", "preset", "data", "teacher", "out", "init", "seed", "settings", "config"])]
    pub resume: Option<PathBuf>,
    /// Threads. Does not change results [default: the configuration's, or one per core]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u16).range(1..=MOST_THREADS), help_heading = RUN)]
    pub threads: Option<u16>,
    /// Measures what the run would take (parameters, activations, optimizer, peak) on a few steps of each stage, and writes
    /// nothing
    #[arg(long, conflicts_with_all = ["out", "trace"], help_heading = MEASURING)]
    pub dry_run: bool,
    /// Writes every op of one step of each stage into this file, in Chrome's trace format (chrome://tracing, Perfetto)
    #[arg(long, value_name = "FILE", help_heading = MEASURING)]
    pub trace: Option<PathBuf>,
    #[command(flatten)]
    pub device: DeviceFlag,
}

/// Headings of groups of flags.
const CONFIGURATION: &str = "Configuration";
const RUN: &str = "Run";
const MEASURING: &str = "Measuring";
const PUBLISHED: &str = "With --weights";
const DENSITY: &str = "How many Gaussians, and where";

/// Prints a preset's configuration as TOML, every key with its documentation.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver config > mine.toml
  splatweaver config --preset tiny-published
  splatweaver config --fit > fit.toml")]
pub struct Config {
    /// The preset [default: tiny]
    #[arg(long)]
    pub preset: Option<String>,
    /// The model [default: splatweaver]
    #[arg(long, value_name = "NAME")]
    pub model: Option<String>,
    /// The settings of `fit` instead
    #[arg(long, conflicts_with_all = ["preset", "model"])]
    pub fit: bool,
}

/// Turns photos into Gaussians, cameras, renders, depth and expert maps.
///
/// Writes scene.ply, transforms.json, a COLMAP model in sparse/0, the folders input, render, depth and experts, and
/// overview.png. From a checkpoint without a Gaussian head (VGGT), or with --geometry: points.ply, depth.safetensors and the
/// cameras.
#[derive(Args, Debug)]
#[command(group(ArgGroup::new("network").args(["run", "weights"])))]
#[command(after_help = "Examples:
  splatweaver infer a.jpg b.jpg c.jpg d.jpg -o result
  splatweaver infer --run runs/mine a.jpg b.jpg c.jpg d.jpg -o result
  splatweaver infer --run runs/mine photos --budget 0.2 -o compact
  splatweaver infer --run runs/mine photos --refine 30 -o better
  splatweaver infer --run runs/mine photos/*.jpg --cameras transforms.json -o posed
  splatweaver infer --run runs/wild photos --light sunset.jpg --to noon.jpg -o lights
  splatweaver infer --weights model.safetensors photos -o scene
  splatweaver infer --weights model.safetensors photos --cameras transforms.json -o posed
  splatweaver infer --weights model.safetensors photos --keep-aspect --size 448 -o wide")]
pub struct Infer {
    /// The run folder [default: the weights that come with the program, and estimated cameras]
    #[arg(long)]
    pub run: Option<PathBuf>,
    /// A published checkpoint: safetensors file, index of several, or the folder; SplatWeaver's names or VGGT's. Or the
    /// checkpoint.safetensors of a run, or small weights made of one
    #[arg(long, value_name = "FILE")]
    pub weights: Option<PathBuf>,
    /// Side of the square that photos are cut to, or WxH; multiples of the patch [default: the model's, 448]
    #[arg(long, value_name = "N|WxH", requires = "weights", help_heading = PUBLISHED, value_parser = size)]
    pub size: Option<[usize; 2]>,
    /// Photos keep their proportions; the long side takes the size, the other whole patches
    #[arg(long, requires = "weights", help_heading = PUBLISHED)]
    pub keep_aspect: bool,
    /// Cameras, depth and points only
    #[arg(long, requires = "weights", help_heading = PUBLISHED, conflicts_with_all = ["allocation", "budget"])]
    pub geometry: bool,
    /// Seed of the router's noise [default: 0]
    #[arg(long, value_name = "S", requires = "weights", help_heading = PUBLISHED)]
    pub seed: Option<u64>,
    /// Round to bf16 (8 bits) what bf16 matrices are multiplied with; faster on processors with AVX-512 BF16,
    /// the same on others
    #[arg(long, requires = "weights", help_heading = PUBLISHED)]
    pub bf16_products: bool,
    /// Photos (JPEG, PNG, TIFF, WebP), folders of photos, or clips; the first one's camera becomes the origin
    #[arg(required = true)]
    pub images: Vec<PathBuf>,
    /// Cameras of the photos, matched by the ends of their paths: transforms.json or a folder with a COLMAP model, whose points
    /// repair depth; or `estimated`: by matching, as `splatweaver cameras` does, whose results go to the folder `cameras`
    /// [default: with --run and --weights predicted, else estimated]
    #[arg(long, value_name = "estimated|predicted|FILE")]
    pub cameras: Option<CameraChoice>,
    /// Gives no Gaussians to what is black in masks: mask_path of --cameras, a file in a folder masks beside the photo, or beside its
    /// folder, named as the photo, or its alpha
    #[arg(long)]
    pub masks: bool,
    #[command(flatten)]
    pub matching: MatchingFlags,
    #[command(flatten)]
    pub density: DensityFlags,
    #[command(flatten)]
    pub refine: RefineFlags,
    #[command(flatten)]
    pub light: LightFlags,
    #[command(flatten)]
    pub device: DeviceFlag,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    pub threads: Threads,
}

/// Which pixels get Gaussians, and how many.
#[derive(Args, Clone, Copy, Debug)]
pub struct DensityFlags {
    /// Gaussians per pixel, 0 to 1, for dithered, quadtree (0 to 3), quadtree-grid, grid and random [default: the run's]
    #[arg(long, value_name = "G", help_heading = DENSITY)]
    pub budget: Option<f64>,
    /// sampled, argmax, dithered, quadtree, quadtree-grid, grid, random or fixed:K [default: the run's]
    #[arg(long, value_name = "A", help_heading = DENSITY)]
    pub allocation: Option<AllocationKind>,
}

impl From<DensityFlags> for Density {
    fn from(flags: DensityFlags) -> Self {
        Self { allocation: flags.allocation, budget: flags.budget }
    }
}

/// Describes a file: images, files of Gaussians, safetensors, PyTorch checkpoints, transforms.json, COLMAP, RealEstate10K, TOML,
/// summary.json, and folders of runs.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver info scene.ply
  splatweaver info runs/mine
  splatweaver info runs/mine/checkpoint.safetensors
  splatweaver info model.safetensors
  splatweaver info capture/sparse/0
  splatweaver info --devices")]
pub struct Info {
    /// The file, a run's folder, or a folder with a COLMAP model
    #[arg(required_unless_present = "devices")]
    pub file: Option<PathBuf>,
    /// Lists what Gaussians can be drawn on, for --device of other commands
    #[arg(long, conflicts_with = "file")]
    pub devices: bool,
    /// Lists it as JSON
    #[arg(long, requires = "devices")]
    pub json: bool,
}

/// Turns a PyTorch checkpoint (.pt, .pth, .ckpt, .bin) into safetensors, or a run's checkpoint into small weights.
///
/// Of a PyTorch checkpoint only the tensors are read; code in the file is never executed. Of a run's checkpoint.safetensors the
/// averaged weights are kept, with 16 bits.
#[derive(Args, Debug)]
#[command(after_help = "Example:
  splatweaver convert-weights model.ckpt -o model.safetensors
  splatweaver convert-weights runs/mine/checkpoint.safetensors -o mine.safetensors")]
pub struct ConvertWeights {
    /// The checkpoint
    pub file: PathBuf,
    /// The safetensors file to write
    #[arg(short, long, value_name = "FILE")]
    pub out: PathBuf,
}

/// Prints a completion script for a shell.
#[derive(Args, Debug)]
#[command(after_help = "Example:
  splatweaver completions bash > ~/.local/share/bash-completion/completions/splatweaver")]
pub struct Completions {
    /// The shell
    pub shell: clap_complete::Shell,
}

/// Height and width from `N` or `WxH`.
fn size(text: &str) -> Result<[usize; 2], String> {
    let (width, height) = text.split_once('x').unwrap_or((text, text));
    let side = |text: &str| text.parse().ok().filter(|n| (1..=16_384).contains(n));
    match (side(height), side(width)) {
        (Some(height), Some(width)) => Ok([height, width]),
        _ => Err("expected a number of pixels or WxH, as in 448 or 448x252".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        CommandLine::command().debug_assert();
    }

    #[test]
    fn every_command_is_in_one_group() {
        let program = CommandLine::command();
        let mut all: Vec<&str> = program.get_subcommands().map(clap::Command::get_name).collect();
        let mut grouped: Vec<&str> = GROUPS.iter().flat_map(|(_, names)| *names).copied().collect();
        all.sort_unstable();
        grouped.sort_unstable();
        assert_eq!(all, grouped);
    }

    #[test]
    fn sizes_are_one_number_or_two() {
        assert_eq!((size("448"), size("448x252")), (Ok([448, 448]), Ok([252, 448])));
        for wrong in ["", "x", "448x", "0", "-1", "4.5", "448x252x3", "99999"] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }
}
