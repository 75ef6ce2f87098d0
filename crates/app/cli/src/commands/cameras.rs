//! `splatweaver cameras`.

use crate::flags::{ClipFlags, CompleteFlag, MaskFlags, MatchingFlags, PlacingFlags};
use clap::Args;
use std::path::{Path, PathBuf};
use weaver_command::{Console, ConsoleObserver, Failure, Output, Threads, in_pool};
use weaver_data::{EstimatedPhotos, some_of};
use weaver_reconstruct::{CameraComparison, CamerasRequest, cameras};

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
    pub placing: PlacingFlags,
    #[command(flatten)]
    pub masks: MaskFlags,
    #[command(flatten)]
    pub complete: CompleteFlag,
    #[command(flatten)]
    pub threads: Threads,
}

pub fn run(arguments: &Cameras, console: &mut Console) -> Result<(), Failure> {
    in_pool(arguments.threads.count(), || estimate(arguments, console))
}

fn estimate(arguments: &Cameras, console: &mut Console) -> Result<(), Failure> {
    let request = CamerasRequest {
        frames: arguments.clip.most(),
        matching: arguments.matching.into(),
        masks: arguments.masks.options(),
        placing: (&arguments.placing).into(),
        read: Vec::from_iter(arguments.compare.clone()),
        ..CamerasRequest::new(&*arguments.out)
    };
    let found = cameras(&arguments.photos, &request, &mut ConsoleObserver::new(console))?;
    if arguments.json {
        return console.print(&serde_json::to_string_pretty(&found.summary())?);
    }
    if let Some(file) = &arguments.compare {
        console.print(&compared(&found, file)?)?;
    }
    let out = |name: &str| arguments.out.join(name).display().to_string();
    console.print(&format!("cameras: {}\npoints: {}", out("transforms.json"), out("points.png")))
}

/// Estimated cameras beside others, in a line.
fn compared(found: &EstimatedPhotos, file: &Path) -> Result<String, Failure> {
    let CameraComparison { photos, rotation, center, focal, elsewhere } = CameraComparison::of(found, file)?;
    let names: Vec<String> = elsewhere.iter().map(|path| path.display().to_string()).collect();
    let named = match names.as_slice() {
        [] => String::new(),
        names => format!("; more than {} degrees apart: {}", CameraComparison::ELSEWHERE, some_of(names)),
    };
    Ok(format!(
        "beside {}: {photos} of {} photos; rotation {:.3} degrees in the median, {:.2} at most; center {:.2} % of the cameras' spread, {:.1} at most; focal length {focal:+.2} %{named}",
        file.display(),
        found.paths.len(),
        rotation[0],
        rotation[1],
        center[0],
        center[1]
    ))
}
