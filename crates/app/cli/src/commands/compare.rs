//! `splatweaver compare`: one file of Gaussians against the photos of a capture.

use clap::Args;
use std::path::PathBuf;
use weaver_command::{Console, ConsoleObserver, DeviceFlag, DrawingFlags, DrawingOptions, Failure, Threads, device};
use weaver_data::capture::posed::{Lenses, PosedOptions};
use weaver_fit::Judge;
use weaver_reconstruct::{ComparedScene, SceneComparison};
use weaver_splat::Renderer;
use weaver_trainer::evaluate::load_lpips;

/// Compares a file of Gaussians with the photos of a capture.
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
    /// Does not count pixels that are black in masks: mask_path of transforms.json, a file in masks/ named as the
    /// photo, or its alpha
    #[arg(long)]
    pub masks: bool,
    /// Undoes the distortion of lenses; =false draws the scene through them, and loses nothing of the photos [default:
    /// below 120 degrees]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    pub undistort: Option<bool>,
    /// Also LPIPS, with the weights in this safetensors file
    #[arg(long, value_name = "WEIGHTS")]
    pub lpips: Option<PathBuf>,
    /// Prints the figures as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub device: DeviceFlag,
    #[command(flatten)]
    pub threads: Threads,
    // Last: its heading would be that of what follows.
    #[command(flatten)]
    pub drawing: DrawingFlags,
}

pub fn run(arguments: &Compare, console: &mut Console) -> Result<(), Failure> {
    let Compare { scene, data, .. } = arguments;
    let mut renderer = Renderer::new(device::rasterizer(&arguments.device)?);
    let judge = Judge::new(arguments.lpips.as_deref().map(load_lpips).transpose()?);
    let (gaussians, background, settings) = DrawingOptions::from(arguments.drawing).read(scene)?;
    let long_side = arguments.long_side.map(|side| side as usize);
    let masks = arguments.masks;
    // Devices draw pinholes.
    let chosen = device::name(&arguments.device).map_or(Lenses::Auto, |_| Lenses::Undistort);
    let lenses = arguments.undistort.map_or(chosen, Lenses::from);
    let options = PosedOptions { long_side, background, masks, lenses, held_out_only: true, ..PosedOptions::default() };
    let compared = ComparedScene { file: scene, gaussians: &gaussians, settings };
    let by = (&judge, &mut renderer);
    let found = SceneComparison::of(&compared, data, &options, by, &mut ConsoleObserver::new(console))?;
    if arguments.json {
        return console.print(&serde_json::to_string_pretty(&found.json(scene, gaussians.len()))?);
    }
    let kind = if found.held_out { "held out" } else { "all, none held out" };
    console.print(&format!("{found}views: {} ({kind}), Gaussians: {}", found.views.len(), gaussians.len()))
}
