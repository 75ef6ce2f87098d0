//! What can be asked on the command line, and the help texts.

use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;

/// The whole command line.
#[derive(Debug, Parser)]
#[command(
    name = "splatweaver",
    version,
    about = "A few photos in, camera poses and compact 3-D Gaussians out; trained and run on a CPU.",
    after_help = "Examples:
  splatweaver train --preset tiny                      train on the built-in scenes
  splatweaver train --data fox --data fern --out runs/mine
  splatweaver eval --run runs/mine --json
  splatweaver infer --run runs/mine a.jpg b.jpg c.jpg d.jpg -o result
  splatweaver render result/scene.ply --orbit 60 -o turn
  splatweaver info result/scene.ply

`splatweaver <command> --help` tells more."
)]
pub struct CommandLine {
    #[command(subcommand)]
    pub command: Command,
}

/// One command.
#[derive(Debug, Subcommand)]
pub enum Command {
    Render(Render),
    Info(Info),
    Completions(Completions),
}

/// Draws a PLY file of Gaussians from given cameras or along an orbit.
///
/// One PNG per camera, named after its photo where the names are distinct, else numbered.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver render scene.ply --cameras transforms.json -o renders
  splatweaver render scene.ply --cameras capture/sparse/0 --width 640 -o renders
  splatweaver render scene.ply --cameras clip.txt --width 640 --height 360 -o renders
  splatweaver render scene.ply --orbit 90 --background 0,0,0 -o turn")]
pub struct Render {
    /// The Gaussians, as 3DGS stores them
    #[arg(value_name = "SCENE.ply")]
    pub scene: PathBuf,
    /// transforms.json, a folder with a COLMAP model, or a RealEstate10K camera file
    #[arg(long, value_name = "FILE", required_unless_present = "orbit", conflicts_with = "orbit")]
    pub cameras: Option<PathBuf>,
    /// Cameras on a circle around the scene instead, this many
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub orbit: Option<u32>,
    /// Folder for the pictures
    #[arg(short, long, value_name = "DIR")]
    pub out: PathBuf,
    /// Width in pixels; intrinsics follow [default: the cameras', or 640 for an orbit]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub width: Option<u32>,
    /// Height in pixels; intrinsics follow [default: the cameras' aspect ratio, or 3/4 of the width]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub height: Option<u32>,
    /// Colour where nothing is, three numbers from 0 to 1
    #[arg(long, value_name = "R,G,B", default_value = "1,1,1", value_parser = colour)]
    pub background: [f32; 3],
    #[command(flatten)]
    pub threads: Threads,
}

/// Says what is in a file: images, PLY, splat, SPZ, safetensors, transforms.json, COLMAP, RealEstate10K.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver info scene.ply
  splatweaver info runs/mine/checkpoint.safetensors
  splatweaver info capture/sparse/0")]
pub struct Info {
    /// The file, or a folder with a COLMAP model
    pub file: PathBuf,
}

/// Prints a completion script for a shell.
#[derive(Args, Debug)]
#[command(after_help = "Example:
  splatweaver completions bash > ~/.local/share/bash-completion/completions/splatweaver")]
pub struct Completions {
    /// The shell
    pub shell: clap_complete::Shell,
}

/// How many threads work.
#[derive(Args, Clone, Copy, Debug)]
pub struct Threads {
    /// Threads; 0 takes one per core. Does not change results
    #[arg(long, value_name = "T", default_value_t = 0)]
    pub threads: usize,
}

fn colour(text: &str) -> Result<[f32; 3], String> {
    let numbers: Result<Vec<f32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    let colour = numbers.ok().and_then(|n| <[f32; 3]>::try_from(n).ok());
    colour
        .filter(|c| c.iter().all(|x| (0.0..=1.0).contains(x)))
        .ok_or_else(|| "expected three numbers from 0 to 1, as in 1,1,1".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        CommandLine::command().debug_assert();
    }

    #[test]
    fn colours_are_three_numbers_from_0_to_1() {
        assert_eq!(colour("0, 0.5,1"), Ok([0.0, 0.5, 1.0]));
        for wrong in ["1,1", "1,1,1,1", "a,b,c", "0,0,256", "NaN,0,0", ""] {
            assert!(colour(wrong).is_err(), "{wrong}");
        }
    }
}
