//! The command line and its help texts.

use crate::commands::Command;
use crate::flags::CameraChoice;
use crate::methods::Method;
use clap::{CommandFactory, FromArgMatches, Parser};
use std::ffi::OsString;
use weaver_command::{Paths, ProgressForm, asked_threads, given_words, grouped};

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
  splatweaver view scene --open                        look at it in the browser
  splatweaver render result/scene.ply --orbit 60 -o turn
  splatweaver align scene.ply --photos later --cameras guess.json -o aligned
  splatweaver lift scene.ply --cameras transforms.json --features dino -o lifted.safetensors
  splatweaver compare scene/scene.ply --data photos
  splatweaver info result/scene.ply
  splatweaver bench raster --synthetic 100000,640,480

`splatweaver <command> --help` tells more."
)]
pub struct CommandLine {
    /// Form of progress on standard error: `json` makes each line an object [default: a bar on a terminal, else lines]
    #[arg(long, global = true, value_name = "FORM", hide_possible_values = true)]
    pub progress: Option<ProgressForm>,
    #[command(subcommand)]
    pub command: Command,
    /// The command's words that have a say in its results.
    #[arg(skip)]
    pub settings: String,
    /// The command's paths.
    #[arg(skip)]
    pub paths: Paths,
    /// Threads that were asked for.
    #[arg(skip)]
    pub threads: Option<usize>,
}

/// Arguments that do not affect results: output folder, threads, live page, reuse of complete results, pace of
/// checkpoints, and form of the output.
const SILENT: [&str; 8] = ["progress", "out", "threads", "json", "live", "port", "if_complete", "save_every"];

impl CommandLine {
    /// Parses the words of a command line, whose first is the program's name.
    pub fn of(words: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> Result<Self, clap::Error> {
        let matches = Self::grouped().try_get_matches_from(words)?;
        let (settings, paths, threads) =
            (given_words(&matches, &SILENT), Paths::of::<CameraChoice>(&matches), asked_threads(&matches));
        Ok(Self { settings, paths, threads, ..Self::from_arg_matches(&matches)? })
    }

    /// The program, whose help lists the commands in groups.
    fn grouped() -> clap::Command {
        grouped(Self::command(), Command::GROUPS.iter().chain(Method::GROUPS))
    }
}
