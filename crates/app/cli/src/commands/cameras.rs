//! `splatweaver cameras`.

use crate::clip;
use crate::estimate::{COMMAND, Estimated, compared, estimated};
use crate::flags::{ClipFlags, CompleteFlag, MatchingFlags};
use clap::Args;
use std::path::PathBuf;
use weaver_command::{Console, Failure, Output, Threads, in_pool};
use weaver_data::OutputFolder;

/// Estimates the cameras of photos by matching them.
///
/// Writes transforms.json, a COLMAP model with points and tracks in sparse/0, and points.png: what of each photo was found in others, green
/// where it is exact. The folder is a capture for fit, infer and train. No network is involved, and the same photos give the same cameras. Of a clip sharp
/// frames become photos, as many steps of the camera apart; they are written to the folder `frames`.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver cameras photos -o capture
  splatweaver cameras clip.mp4 -o capture --frames 60
  splatweaver cameras a.jpg b.jpg c.jpg -o capture --focal 1.2
  splatweaver cameras capture/images -o mine --compare capture/transforms.json")]
pub struct Cameras {
    /// Photos (JPEG, PNG, TIFF, WebP), folders of photos, or clips
    #[arg(required = true)]
    pub photos: Vec<PathBuf>,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", value_parser = Output::folder())]
    pub out: Output,
    /// Other cameras of the same photos: says how far the estimated ones are off, once moved, turned and scaled to fit best
    #[arg(long, value_name = "FILE", conflicts_with = "json")]
    pub compare: Option<PathBuf>,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub clip: ClipFlags,
    #[command(flatten)]
    pub matching: MatchingFlags,
    #[command(flatten)]
    pub complete: CompleteFlag,
    #[command(flatten)]
    pub threads: Threads,
}

pub fn run(arguments: &Cameras, console: &mut Console) -> Result<(), Failure> {
    in_pool(arguments.threads.count(), || cameras(arguments, console))
}

fn cameras(arguments: &Cameras, console: &mut Console) -> Result<(), Failure> {
    let compare = arguments.compare.as_slice();
    let claimed = OutputFolder::claim(&arguments.out, COMMAND, arguments.photos.iter().chain(compare))?;
    let photos = clip::photos(&arguments.photos, arguments.clip, &claimed, console)?;
    let located = vec![false; photos.paths.len()];
    let Estimated { found, .. } = estimated(&photos, &located, arguments.matching, &claimed, console)?;
    photos.settle(&claimed)?;
    let out = |name: &str| arguments.out.join(name).display().to_string();
    if arguments.json {
        return console.print(&serde_json::to_string_pretty(&found.summary())?);
    }
    if let Some(file) = &arguments.compare {
        console.print(&compared(&found, file)?)?;
    }
    console.print(&format!("cameras: {}\npoints: {}", out("transforms.json"), out("points.png")))
}
