//! The command line of `splatweaver render`.

use super::{DeviceFlag, Threads};
use clap::{ArgGroup, Args};
use std::path::PathBuf;
use weaver_command::DrawingFlags;

/// Draws a file of Gaussians from given cameras or along an orbit.
///
/// One PNG per camera, named after its photo where the names are distinct, else numbered; or a video, with an ffmpeg on
/// the PATH; or both.
#[derive(Args, Debug)]
#[command(group(ArgGroup::new("viewpoints").required(true).args(["cameras", "orbit"])))]
#[command(after_help = "Examples:
  splatweaver render scene.ply --cameras transforms.json -o renders
  splatweaver render scene.ply --cameras capture/sparse/0 --width 640 -o renders
  splatweaver render scene.ply --cameras clip.txt --width 640 --height 360 -o renders
  splatweaver render scene.ply --orbit 90 --background 0,0,0 -o turn
  splatweaver render scene.ply --orbit 120 --width 1280 --height 720 --video turn.mp4")]
pub struct Render {
    /// The Gaussians: PLY as 3DGS stores them, or another format of `splatweaver convert`
    #[arg(value_name = "SCENE.ply")]
    pub scene: PathBuf,
    /// transforms.json, a folder with a COLMAP model, or a RealEstate10K camera file
    #[arg(long, value_name = "FILE")]
    pub cameras: Option<PathBuf>,
    /// Cameras on a circle around the scene instead, this many
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub orbit: Option<u32>,
    /// Folder for the pictures
    #[arg(short, long, value_name = "DIR", required_unless_present = "video")]
    pub out: Option<PathBuf>,
    /// Makes a video of the pictures, in the cameras' order
    #[arg(long, value_name = "FILE.mp4")]
    pub video: Option<PathBuf>,
    /// Pictures of the video per second
    #[arg(long, value_name = "F", default_value = "30", value_parser = rate, requires = "video")]
    pub fps: f64,
    /// Width in pixels; intrinsics follow [default: the cameras', or 640 for an orbit]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub width: Option<u32>,
    /// Height in pixels; intrinsics follow [default: the cameras' aspect ratio, or 3/4 of the width]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub height: Option<u32>,
    #[command(flatten)]
    pub device: DeviceFlag,
    #[command(flatten)]
    pub threads: Threads,
    // Last: its heading would be that of what follows.
    #[command(flatten)]
    pub drawing: DrawingFlags,
}

/// Pictures per second.
pub fn rate(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(rate) if (0.1..=1000.0).contains(&rate) => Ok(rate),
        _ => Err("expected a number from 0.1 to 1000".into()),
    }
}
