//! The command line of `splatweaver align`.

use super::Threads;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use weaver_command::DrawingFlags;

const DESCENT: &str = "Descent";

/// Finds where photos of a finished scene were taken: their cameras move until what the scene shows is the photo.
///
/// Writes transforms.json, a COLMAP model in sparse/0, the folder renders and align.json. A photo's first guess should be within a few
/// degrees; a photo for which nothing better is found keeps its guess, and the table says why.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver align scene.ply --photos new --cameras guess.json -o aligned
  splatweaver align fits/garden-1/scene.ply --photos later.jpg -o aligned
  splatweaver align scene.spz --photos new --cameras sparse/0 --long-side 800 --refine-focal -o aligned")]
pub struct Align {
    /// The Gaussians: PLY as 3DGS stores them, or another format of `splatweaver convert`
    #[arg(value_name = "SCENE.ply")]
    pub scene: PathBuf,
    /// Photos, or folders of photos
    #[arg(long, value_name = "DIR|FILE", required = true, num_args = 1..)]
    pub photos: Vec<PathBuf>,
    /// First guesses, matched with photos by name: transforms.json, a folder with a COLMAP model, or a RealEstate10K file
    /// [default: for each photo that camera of the transforms.json beside the scene from which the scene looks most like it]
    #[arg(long, value_name = "FILE")]
    pub cameras: Option<PathBuf>,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR")]
    pub out: PathBuf,
    /// Which numbers descend, and at what rate
    #[arg(long = "as", value_enum, default_value = "own", help_heading = DESCENT)]
    pub method: MethodName,
    /// Steps at most [default: 200, or 100 as published]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000), help_heading = DESCENT)]
    pub steps: Option<u32>,
    /// Whether photo and render are blurred in the first half of the steps
    #[arg(long, value_enum, value_name = "on|off", default_value = "on", help_heading = DESCENT)]
    pub blur: Switch,
    /// What photo and render are compared by [default: photometric, or mse as published]
    #[arg(long, value_enum, help_heading = DESCENT)]
    pub loss: Option<LossName>,
    /// Focal lengths descend as well
    #[arg(long, help_heading = DESCENT)]
    pub refine_focal: bool,
    /// Does not count what is black in masks: mask_path of the cameras, a file in masks/ named as the photo, or its alpha
    #[arg(long, help_heading = DESCENT)]
    pub masks: bool,
    /// Longest side of the photos in pixels; larger ones are shrunk [default: as they are]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..=65_536), help_heading = DESCENT)]
    pub long_side: Option<u32>,
    #[command(flatten)]
    pub threads: Threads,
    // Last: its heading would be that of what follows.
    #[command(flatten)]
    pub drawing: DrawingFlags,
}

/// How a camera descends.
#[derive(Clone, Copy, Debug, Eq, PartialEq, ValueEnum)]
pub enum MethodName {
    /// Small and blurred photos first, steps in units of the depth, the best camera seen
    Own,
    /// As in 2Xplat: quaternion and center
    #[value(name = "2xplat")]
    TwoXplat,
    /// As in NoPoSplat: rigid increments
    #[value(name = "noposplat")]
    NoPoSplat,
}

/// What photo and render are compared by.
#[derive(Clone, Copy, Debug, Eq, PartialEq, ValueEnum)]
pub enum LossName {
    /// The mean square of differences
    Mse,
    /// Absolute differences and structure, as scenes are fitted
    Photometric,
    /// Structural similarity alone
    Ssim,
}

/// On or off.
#[derive(Clone, Copy, Debug, Eq, PartialEq, ValueEnum)]
pub enum Switch {
    On,
    Off,
}
