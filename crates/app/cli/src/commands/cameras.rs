//! `splatweaver cameras`.

use crate::flags::{CompleteFlag, EstimateFlags};
use clap::Args;
use std::path::PathBuf;
use weaver_command::{Console, ConsoleObserver, Failure, Output, Threads};
use weaver_reconstruct::{CameraComparison, CamerasRequest, cameras};

/// Estimates the cameras of photos by matching them.
///
/// Writes transforms.json, a COLMAP model with points and tracks in sparse/0, and points.png: the points of each photo
/// that were found in others, green where they are exact. The folder is a capture for fit, infer and train. No network
/// is involved but with --weak-pairs, and the same photos give the same cameras. Of a clip sharp frames become photos,
/// as many steps of the camera apart; they are written to the folder `frames`.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver cameras photos -o capture
  splatweaver cameras clip.mp4 -o capture --frames 60
  splatweaver cameras a.jpg b.jpg c.jpg -o capture --focal 1.2
  splatweaver cameras flight -o capture --positions gnss.csv   in meters, east, north and up, without the photos' GPS
  splatweaver cameras photos -o capture --masks masks          masks/a.png is of photos/a.jpg; black is left out
  splatweaver cameras capture/images -o mine --compare capture/transforms.json")]
pub struct Cameras {
    /// Photos (JPEG, PNG, TIFF, WebP, HEIC, AVIF), folders of photos, or clips
    #[arg(required = true)]
    pub photos: Vec<PathBuf>,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR", value_parser = Output::folder())]
    pub out: Output,
    /// Other cameras of the same photos: says how far the estimated ones are off, once moved, turned and scaled to fit
    /// best
    #[arg(long, value_name = "FILE", conflicts_with = "json")]
    pub compare: Option<PathBuf>,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub estimate: EstimateFlags,
    #[command(flatten)]
    pub complete: CompleteFlag,
    #[command(flatten)]
    pub threads: Threads,
}

pub fn run(arguments: &Cameras, console: &mut Console) -> Result<(), Failure> {
    let request = CamerasRequest {
        frames: arguments.estimate.clip.most(),
        matching: arguments.estimate.matching.into(),
        masks: arguments.estimate.masks.options(),
        placing: (&arguments.estimate.placing).into(),
        read: Vec::from_iter(arguments.compare.clone()),
        ..CamerasRequest::new(&*arguments.out)
    };
    let found = cameras(&arguments.photos, &request, &mut ConsoleObserver::new(console))?;
    if arguments.json {
        return console.print(&serde_json::to_string_pretty(&found.summary())?);
    }
    if let Some(file) = &arguments.compare {
        let compared = CameraComparison::of(&found, file)?;
        let (file, of, photos) = (file.display(), found.paths.len(), compared.photos);
        console.print(&format!("beside {file}: {photos} of {of} photos; {compared}"))?;
    }
    let out = |name: &str| arguments.out.join(name).display().to_string();
    console.print(&format!("cameras: {}\npoints: {}", out("transforms.json"), out("points.png")))
}
