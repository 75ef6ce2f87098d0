//! The command line of `splatweaver compare`.

use super::Threads;
use clap::Args;
use std::path::PathBuf;
use weaver_command::DrawingFlags;

/// Compares what a file of Gaussians shows with the photos of a capture.
///
/// At the photos' own size, by those that the capture holds out, or by all where it holds none out.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver compare fits/garden-1/scene.ply --data garden --lpips alex.safetensors
  splatweaver compare scene.spz --data garden --long-side 1600 --background black
  splatweaver compare scene.ply --data garden --json")]
pub struct Compare {
    /// The Gaussians, whose world is the capture's
    #[arg(value_name = "SCENE")]
    pub scene: PathBuf,
    /// Folder of the capture
    #[arg(long, value_name = "DIR")]
    pub data: PathBuf,
    /// Longest side of the photos in pixels; larger ones are shrunk [default: as they are]
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub long_side: Option<u32>,
    /// Does not count what is black in masks: mask_path of transforms.json, a file in masks/ named as the photo, or its alpha
    #[arg(long)]
    pub masks: bool,
    /// Also LPIPS, with the weights in this safetensors file
    #[arg(long, value_name = "WEIGHTS")]
    pub lpips: Option<PathBuf>,
    /// Prints the figures as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub threads: Threads,
    // Last: its heading would be that of what follows.
    #[command(flatten)]
    pub drawing: DrawingFlags,
}
