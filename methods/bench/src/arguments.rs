//! The command lines of `splatweaver bench`.

use clap::{ArgGroup, Args, Subcommand, ValueEnum};
use std::path::PathBuf;
use weaver_command::{DeviceFlag, Output, Threads};

/// Measures how fast parts of this program are on this machine, beside the machine's own peak.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver bench raster --synthetic 100000,640,480
  splatweaver bench raster --workload scene.safetensors --threads 2 --json
  splatweaver bench fit
  splatweaver bench mixture
  splatweaver bench surfels
  splatweaver bench compress scene.ply
  splatweaver bench engine")]
pub struct Bench {
    #[command(subcommand)]
    pub(crate) subject: Subject,
}

/// Subject of a benchmark.
#[derive(Debug, Subcommand)]
pub enum Subject {
    #[cfg(feature = "compression")]
    Compress(weaver_compression::command::BenchCompress),
    Raster(BenchRaster),
    Fit(BenchFit),
    Mixture(BenchMixture),
    #[cfg(feature = "lidar")]
    Surfels(BenchSurfels),
    Engine(BenchEngine),
}

/// Draws a scene of Gaussians again and again, forward and backward: medians per stage.
///
/// The first time is not counted. Outputs and gradients go to memory that is used again. A workload file is
/// safetensors, all F32: means [N,3], quats [N,4] (wxyz), scales [N,3], opacities [N], colors [N,3] or sh [N,K,3],
/// viewmat [4,4] (world to camera), K [3,3], background [3]; the gradients that arrive: v_image [H,W,3], v_alpha [H,W]
/// and, if wanted, v_depth [H,W]; metadata: width, height and, if wanted, mode (classic or antialiased).
#[derive(Args, Debug)]
#[command(group(ArgGroup::new("scene").required(true).args(["workload", "synthetic"])))]
#[command(after_help = "Examples:
  splatweaver bench raster --synthetic 1000000,1280,720 --threads 2
  splatweaver bench raster --workload scene.safetensors --runs 20 --json
  splatweaver bench raster --workload scene.safetensors --runs 1 --dump gradients.safetensors
  splatweaver bench raster --synthetic 100000,640,480 --device gpu")]
pub struct BenchRaster {
    /// The scene, a safetensors file
    #[arg(long, value_name = "F")]
    pub workload: Option<PathBuf>,
    /// A synthetic scene instead: N Gaussians with SH of degree 3 in W x H pixels, the same every time
    #[arg(long, value_name = "N,W,H", value_parser = synthetic)]
    pub synthetic: Option<Synthetic>,
    /// Drawings; medians are over these
    #[arg(long, value_name = "R", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub runs: u32,
    /// Writes image, alpha, depth and the gradient of every input to this safetensors file
    #[arg(long, value_name = "OUT.safetensors", value_parser = Output::file(&["safetensors"]))]
    pub dump: Option<Output>,
    /// Leaves the backward pass out
    #[arg(long)]
    pub forward_only: bool,
    #[command(flatten)]
    pub device: DeviceFlag,
    /// Prints the figures as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub threads: Threads,
}

/// Fits a scene for some steps: medians of the parts of a step, beside what the machine needs for them at least.
///
/// Photos are seen at their full size, with harmonics of degree 3. A synthetic scene is fitted to its own picture with
/// noise and keeps its number of Gaussians. A capture's begins on its points and grows to 30,000 over three times as
/// many steps as are counted, which come last.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver bench fit --synthetic 1000000,1280,720 --threads 2
  splatweaver bench fit --capture capture --runs 200 --json")]
pub struct BenchFit {
    /// A synthetic scene: N Gaussians with SH of degree 3 in W x H pixels, the same every time
    #[arg(long, value_name = "N,W,H", default_value = "40000,384,256", conflicts_with = "capture", value_parser = synthetic)]
    pub synthetic: Synthetic,
    /// A capture instead: a folder with photos and their cameras, or a transforms.json
    #[arg(long, value_name = "DIR")]
    pub capture: Option<PathBuf>,
    /// Steps that count
    #[arg(long, value_name = "R", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub runs: u32,
    /// Prints the figures as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub device: DeviceFlag,
    #[command(flatten)]
    pub threads: Threads,
}

/// Draws a mixture of experts in one pass, in one for each expert, and in two for each (colors and router's numbers
/// apart): frames a second.
///
/// All ways draw the same pictures, to the bit, which is checked.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver bench mixture --synthetic 400000,1280,720 --threads 2
  splatweaver bench mixture --parts 4 --keep 0.45 --json")]
pub struct BenchMixture {
    /// A synthetic scene: N Gaussians in all, in W x H pixels, the same every time
    #[arg(long, value_name = "N,W,H", default_value = "100000,640,480", value_parser = synthetic)]
    pub synthetic: Synthetic,
    /// Experts, of equally many Gaussians
    #[arg(long, value_name = "K", default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=64))]
    pub parts: u16,
    /// Draws only so large a share of the Gaussians, those that the picture has most of
    #[arg(long, value_name = "SHARE", default_value_t = 1.0)]
    pub keep: f64,
    /// Draws in one of the ways only, to see what memory it takes
    #[arg(long, value_enum)]
    pub only: Option<Passes>,
    /// Adds the backward pass, with the gradients of everything that the Gaussians have
    #[arg(long)]
    pub backward: bool,
    /// Drawings in each way; medians are over these
    #[arg(long, value_name = "R", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub runs: u32,
    /// Prints the figures as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub threads: Threads,
}

/// Draws a map of surfels into range images, forward and backward: medians of the stages, beside the ellipsoids'.
///
/// The map is of one scan of a hall, fitted for the 200 steps of a keyframe, which are timed; so is the registration of
/// the scans that follow, 11 cm apart. The ellipsoids are as in `bench raster --synthetic 100000,640,480`.
#[cfg(feature = "lidar")]
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver bench surfels
  splatweaver bench surfels --size 128x1024 --threads 1 --json")]
pub struct BenchSurfels {
    /// Rows and columns of the range image
    #[arg(long, value_name = "HxW", default_value = "64x1024", value_parser = weaver_command::rows_and_columns)]
    pub size: [usize; 2],
    /// Surfels for each pixel
    #[arg(long, value_name = "SHARE", default_value_t = 0.3)]
    pub density: f64,
    /// Drawings, and scans that are registered; medians are over these
    #[arg(long, value_name = "R", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub runs: u32,
    /// Prints the figures as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub threads: Threads,
}

/// Ways to draw a mixture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Passes {
    /// All experts in one pass
    One,
    /// A pass for each expert
    Each,
    /// Two passes for each expert, one of colors and one of the router's numbers
    Apart,
}

/// Times the engine's work: matrix products, attention, a transformer block, a training step, convolution, and more.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver bench engine
  splatweaver bench engine --threads 2 --json")]
pub struct BenchEngine {
    /// Timings of each piece of work; medians are over these
    #[arg(long, value_name = "R", default_value_t = 7, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub runs: u32,
    /// Prints the figures as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub threads: Threads,
}

/// The size of a synthetic scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Synthetic {
    pub gaussians: usize,
    pub width: usize,
    pub height: usize,
}

fn synthetic(text: &str) -> Result<Synthetic, String> {
    let numbers: Result<Vec<usize>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[gaussians @ 0..=100_000_000, width @ 1..=16_384, height @ 1..=16_384]) => {
            Ok(Synthetic { gaussians, width, height })
        }
        _ => {
            Err("expected up to 100000000 Gaussians, and width and height from 1 to 16384, as in 100000,640,480".into())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn made_up_scenes_are_three_counts() {
        assert_eq!(synthetic("10, 3,2"), Ok(Synthetic { gaussians: 10, width: 3, height: 2 }));
        for wrong in
            ["", "10", "10,3", "10,0,2", "10,3,0", "-1,3,2", "1e3,3,2", "10,3,2,1", "200000000,3,2", "1,99999,2"]
        {
            assert!(synthetic(wrong).is_err(), "{wrong}");
        }
    }
}
