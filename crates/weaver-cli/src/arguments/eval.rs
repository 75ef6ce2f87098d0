//! The command line of `splatweaver eval`.

use super::fit::{Rgb, background};
use super::{DensityFlags, RefineFlags, Threads, cameras};
use clap::{ArgGroup, Args};
use std::path::PathBuf;
use weaver_trainer::CameraMode;

/// Renders held-out views and compares them with the photos.
///
/// With --run from the Gaussians that the model makes of their nearest training views, with --scene from one file of Gaussians,
/// at the photos' own size.
#[derive(Args, Debug)]
#[command(group(ArgGroup::new("what").required(true).args(["run", "scene"])))]
#[command(after_help = "Examples:
  splatweaver eval --run runs/mine
  splatweaver eval --run runs/mine --data ramen --cameras given --allocation grid --budget 0.25
  splatweaver eval --run runs/mine --data ramen --cameras given --points
  splatweaver eval --run runs/mine --unseen --json > unseen.json
  splatweaver eval --scene fits/garden-1/scene.ply --data garden --lpips alex.safetensors
  splatweaver eval --scene scene.spz --data garden --size 1600 --background black")]
pub struct Eval {
    /// The run folder
    #[arg(long)]
    pub run: Option<PathBuf>,
    /// A file of Gaussians (PLY, splat, SPZ), whose world is that of one --data
    #[arg(long, value_name = "SCENE", requires = "data", conflicts_with_all = ["unseen", "views", "cameras", "points", "allocation", "budget", "refine", "refine_steps", "refine_size"])]
    pub scene: Option<PathBuf>,
    /// Folder of a capture; may be repeated with --run [default: the data of the run]
    #[arg(long, value_name = "DIR")]
    pub data: Vec<PathBuf>,
    /// The four built-in procedural scenes that are never trained on
    #[arg(long, conflicts_with = "data")]
    pub unseen: bool,
    /// Context views for each held-out view [default: the run's]
    #[arg(long, value_name = "V", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub views: Option<u32>,
    /// Cameras of the context views [default: the run's]
    #[arg(long, value_parser = cameras())]
    pub cameras: Option<CameraMode>,
    /// Given cameras come with the points that the context photos see: depth is brought to these
    #[arg(long)]
    pub points: bool,
    #[command(flatten)]
    pub density: DensityFlags,
    #[command(flatten)]
    pub refine: RefineFlags,
    /// Also LPIPS, with the weights in this safetensors file
    #[arg(long, value_name = "WEIGHTS")]
    pub lpips: Option<PathBuf>,
    /// Prints the figures as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub drawing: Drawing,
    #[command(flatten)]
    pub threads: Threads,
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
}

/// A distance before a camera.
fn distance(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(distance) if distance > 0.0 && f64::is_finite(distance) => Ok(distance),
        _ => Err("expected a positive number".into()),
    }
}
