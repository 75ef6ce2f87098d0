//! The command lines of `splatweaver dynamic`.

use super::{MOST_SEED, Threads};
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;
use weaver_dynamic_run::{ExpertKind, KeepBy};

/// Scenes that move: several models of moving Gaussians, and a router that says which to believe, pixel by pixel (MoE-GS).
///
/// Films are folders as D-NeRF, Neural 3D Video or HyperNeRF have them. Without any, a film is generated.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver dynamic train --out runs/film
  splatweaver dynamic eval --run runs/film
  splatweaver dynamic render --run runs/film --times 0:1:60 --gate -o frames
  splatweaver dynamic prune --run runs/film --keep 0.45 --out runs/smaller
  splatweaver dynamic distil --run runs/film --expert keys --out runs/keys
  splatweaver dynamic train --data flame_steak --experts field,keys,poly --out runs/steak")]
pub struct Dynamic {
    #[command(subcommand)]
    pub command: DynamicCommand,
}

/// What is to be done.
#[derive(Debug, Subcommand)]
pub enum DynamicCommand {
    Train(DynamicTrain),
    Eval(DynamicEval),
    Render(DynamicRender),
    Prune(DynamicPrune),
    Distil(DynamicDistil),
}

/// Trains experts one after the other, then their router, and writes a run folder: model.safetensors, logs, report.html.
///
/// Ctrl-C saves a checkpoint and ends; --resume goes on to the same bits as an uninterrupted run.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver dynamic train --out runs/film
  splatweaver dynamic train --experts keys,poly --steps 500 --router-steps 300 --out runs/try
  splatweaver dynamic train --data lego --experts field,code --long-side 400 --out runs/lego
  splatweaver dynamic train --resume runs/film")]
pub struct DynamicTrain {
    /// Folder of a film: transforms_train.json (D-NeRF), poses_bounds.npy (Neural 3D Video) or scene.json (HyperNeRF)
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Longest side of the photos, pixels [default: 96 of generated films, else what the layout's benchmarks take]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(16..=8192))]
    pub long_side: Option<u32>,
    /// Cameras and frames of a generated film
    #[arg(long, value_name = "CxF", default_value = "9x32", value_parser = shots, conflicts_with = "data")]
    pub shots: [usize; 2],
    /// The experts: field (4DGaussians), code (E-D3DGS), keys (Ex4DGS), poly (Spacetime Gaussians); at least two
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "field,code,keys,poly")]
    pub experts: Vec<ExpertKind>,
    /// Sizes of the experts
    #[arg(long, value_enum, default_value = "tiny")]
    pub preset: PresetName,
    /// Gaussians of each expert
    #[arg(long, value_name = "N", default_value = "2500", value_parser = clap::value_parser!(u32).range(32..=10_000_000))]
    pub gaussians: u32,
    /// Steps of each expert
    #[arg(long, value_name = "N", default_value = "3000", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub steps: u32,
    /// Steps of the router
    #[arg(long, value_name = "N", default_value = "2000", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub router_steps: u32,
    /// With `none`, trains on the photos that are held out, too: nothing is left to judge by
    #[arg(long, value_name = "listed|none", default_value = "listed", value_parser = ["listed", "none"])]
    pub hold_out: String,
    /// What the gate's logits are divided by, in training and in use
    #[arg(long, value_name = "T", default_value = "1")]
    pub temperature: f64,
    /// What the router sees where an expert has nothing
    #[arg(long, value_name = "B", default_value = "1", allow_negative_numbers = true)]
    pub background_weight: f64,
    /// Seed of the generated film, of numbers and of order
    #[arg(long, value_name = "S", default_value = "0", value_parser = clap::value_parser!(u64).range(..=MOST_SEED))]
    pub seed: u64,
    /// Folder of the run [default: the first free one of runs/dynamic-1, runs/dynamic-2, ...]
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Goes on from the checkpoint of a run that was stopped, with what it was started with
    #[arg(long, value_name = "RUN", conflicts_with_all = [
        "data", "long_side", "shots", "experts", "preset", "gaussians", "steps", "router_steps", "hold_out",
        "temperature", "background_weight", "seed", "out",
    ])]
    pub resume: Option<PathBuf>,
    #[command(flatten)]
    pub threads: Threads,
}

/// Judges experts, mixture, their uniform mean and the best expert at each pixel on photos that were held out, and writes report.html anew.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver dynamic eval --run runs/film
  splatweaver dynamic eval --run runs/film --json")]
pub struct DynamicEval {
    /// Folder of the run
    #[arg(long, value_name = "RUN")]
    pub run: PathBuf,
    /// Prints one line of JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub threads: Threads,
}

/// Draws the mixture along time, from one of the film's cameras or along a path, as PNG files or as a video.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver dynamic render --run runs/film --times 0:1:60 -o frames
  splatweaver dynamic render --run runs/film --times 0.2:0.8:40 --camera 4 --gate -o frames
  splatweaver dynamic render --run runs/film --times 0:1:90 --cameras path.json --video film.mp4")]
pub struct DynamicRender {
    /// Folder of the run
    #[arg(long, value_name = "RUN")]
    pub run: PathBuf,
    /// First time, last time, number of pictures; a film runs from 0 to 1
    #[arg(long, value_name = "FROM:TO:N", default_value = "0:1:30", value_parser = times)]
    pub times: Times,
    /// Number of one of the film's cameras [default: one that was held out, else the first]
    #[arg(long, value_name = "N", conflicts_with = "cameras")]
    pub camera: Option<usize>,
    /// transforms.json, a folder with a COLMAP model, or a RealEstate10K camera file: a path that is followed as time passes
    #[arg(long, value_name = "FILE")]
    pub cameras: Option<PathBuf>,
    /// Shows one expert instead of the mixture
    #[arg(long, value_name = "NAME")]
    pub expert: Option<String>,
    /// Writes maps of the gate beside the pictures
    #[arg(long, requires = "out")]
    pub gate: bool,
    /// Folder for the pictures
    #[arg(short, long, value_name = "DIR", required_unless_present = "video")]
    pub out: Option<PathBuf>,
    /// Makes a video of the pictures, with an ffmpeg on the PATH
    #[arg(long, value_name = "FILE.mp4")]
    pub video: Option<PathBuf>,
    /// Pictures of the video per second
    #[arg(long, value_name = "F", default_value = "30", value_parser = super::render::rate, requires = "video")]
    pub fps: f64,
    #[command(flatten)]
    pub threads: Threads,
}

/// Leaves out the Gaussians that are worth least, trains the router on, and writes a new run folder.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver dynamic prune --run runs/film --keep 0.45 --out runs/smaller
  splatweaver dynamic prune --run runs/film --keep 0.25 --by sensitivity --out runs/as-published")]
pub struct DynamicPrune {
    /// Folder of the run
    #[arg(long, value_name = "RUN")]
    pub run: PathBuf,
    /// The share of Gaussians that stays, above 0, at most 1
    #[arg(long, value_name = "SHARE")]
    pub keep: f64,
    /// What Gaussians are judged by: contribution (to the pictures, times the gate), sensitivity (of the gate, as published), chance
    #[arg(long, value_name = "SCORE", default_value_t)]
    pub by: KeepBy,
    /// Steps of the router afterwards
    #[arg(long, value_name = "N", default_value = "500", value_parser = clap::value_parser!(u32).range(0..=10_000_000))]
    pub steps: u32,
    /// Folder of the new run
    #[arg(short, long, value_name = "DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    pub threads: Threads,
}

/// Trains one expert on: by photos where the gate believes it, by the mixture elsewhere; writes a new run folder.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver dynamic distil --run runs/film --expert keys --out runs/keys
  splatweaver dynamic distil --run runs/film --expert keys --photos-alone --out runs/keys-plain")]
pub struct DynamicDistil {
    /// Folder of the run
    #[arg(long, value_name = "RUN")]
    pub run: PathBuf,
    /// Name of the expert
    #[arg(long, value_name = "NAME")]
    pub expert: String,
    /// The share of photos in the loss, 0 to 1; the rest is the mixture's
    #[arg(long, value_name = "L", default_value = "0.5", conflicts_with = "photos_alone")]
    pub lambda: f64,
    /// Learns from photos alone: what distillation is compared with
    #[arg(long)]
    pub photos_alone: bool,
    /// Steps
    #[arg(long, value_name = "N", default_value = "1500", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub steps: u32,
    /// Folder of the new run
    #[arg(short, long, value_name = "DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    pub threads: Threads,
}

/// Sizes of the experts.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum PresetName {
    /// For minutes on a processor
    Tiny,
    /// As published
    Published,
}

/// Times from the first to the last, evenly spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Times {
    pub from: f64,
    pub to: f64,
    pub count: usize,
}

impl Times {
    /// All of them.
    pub fn all(self) -> impl Iterator<Item = f64> {
        let step = (self.to - self.from) / (self.count.max(2) - 1) as f64;
        (0..self.count).map(move |i| self.from + step * i as f64)
    }
}

fn times(text: &str) -> Result<Times, String> {
    let parts: Vec<&str> = text.split(':').collect();
    let [from, to, count] = parts[..] else { return Err("expected FROM:TO:N".into()) };
    let time = |text: &str| match text.parse() {
        Ok(time) if (0.0..=1.0).contains(&time) => Ok(time),
        _ => Err(format!("expected times from 0 to 1, found {text}")),
    };
    let count = match count.parse() {
        Ok(count @ 1..=100_000) => count,
        _ => return Err(format!("expected 1 to 100000 pictures, found {count}")),
    };
    Ok(Times { from: time(from)?, to: time(to)?, count })
}

/// Cameras and frames from `CxF`.
fn shots(text: &str) -> Result<[usize; 2], String> {
    let parts = text.split_once('x').map(|(cameras, frames)| (cameras.parse(), frames.parse()));
    match parts {
        Some((Ok(cameras @ 2..=64), Ok(frames @ 4..=1000))) => Ok([cameras, frames]),
        _ => Err("expected 2 to 64 cameras and 4 to 1000 frames, as in 9x32".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_evenly_spread() {
        let all = |text: &str| times(text).map(|times| times.all().collect::<Vec<_>>());
        assert_eq!(all("0:1:3"), Ok(vec![0.0, 0.5, 1.0]));
        assert_eq!(all("0.5:0.5:1"), Ok(vec![0.5]));
        assert!(all("0:2:3").unwrap_err().contains("0 to 1") && all("0:1").is_err() && all("0:1:0").is_err());
        assert!(times("0:nan:3").is_err());
    }

    #[test]
    fn shots_are_cameras_and_frames() {
        assert_eq!(shots("9x32"), Ok([9, 32]));
        assert!(shots("1x32").is_err() && shots("9").is_err() && shots("9x3").is_err());
    }
}
