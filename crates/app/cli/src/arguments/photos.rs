//! The command lines of `splatweaver cameras` and `splatweaver reconstruct`.

use super::hold_out::hold_out;
use super::matching::{ClipFlags, MatchingFlags};
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use weaver_command::Threads;
use weaver_data::capture::HoldOut;

/// Heading of the flags of a fit.
const FIT: &str = "Fit";

/// A scene from a folder of photos, or a video, and nothing else.
///
/// A capture's own cameras are taken where there are any; else they are estimated. Then Gaussians are fitted to the photos. Writes
/// scene.ply, cameras, summary.json and report.html, and with estimated cameras the folder `cameras` as `splatweaver cameras` does.
/// Photos overlap best when each place is seen in three of them or more, from places that are apart. Of a clip (MP4, MOV, MKV, WebM, AVI
/// and what else ffmpeg reads) sharp frames become photos, as many steps of the camera apart; they are written to the folder `frames`.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver reconstruct photos -o scene
  splatweaver reconstruct photos -o sketch --quality draft
  splatweaver reconstruct clip.mp4 -o scene
  splatweaver reconstruct a.jpg b.jpg c.jpg d.jpg -o scene --minutes 1
  splatweaver reconstruct photos -o scene --hold-out 8         how good it is from elsewhere")]
pub struct Reconstruct {
    /// Photos (JPEG, PNG, TIFF, WebP), folders of photos, clips, or one capture
    #[arg(required = true)]
    pub photos: Vec<PathBuf>,
    /// Folder for the results
    #[arg(short, long, value_name = "DIR")]
    pub out: PathBuf,
    /// How long it takes and how large photos are
    #[arg(long, value_enum, default_value_t = Quality::Normal, help_heading = FIT)]
    pub quality: Quality,
    /// Time for all of it, matching included; the fit gets at least half of it, whatever matching took [default: the quality's]
    #[arg(long, value_name = "M", value_parser = super::fit::minutes, help_heading = FIT)]
    pub minutes: Option<f64>,
    /// The most Gaussians there may be [default: 0.4 for each pixel of a photo, 5000 to 1000000]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000_000), help_heading = FIT)]
    pub gaussians: Option<u32>,
    /// Which photos are not shown to the fit, which is judged by them: none; those that a capture lists, or every eighth where none are
    /// listed; or every so many
    #[arg(long, value_name = "listed|none|N", value_parser = hold_out, default_value = "none", help_heading = FIT)]
    pub hold_out: HoldOut,
    /// Seed of everything that is drawn at random
    #[arg(long, value_name = "S", default_value_t = 0, help_heading = FIT)]
    pub seed: u64,
    #[command(flatten)]
    pub clip: ClipFlags,
    #[command(flatten)]
    pub matching: MatchingFlags,
    #[command(flatten)]
    pub threads: Threads,
}

/// What a reconstruction is for.
#[derive(Clone, Copy, Debug, Eq, PartialEq, ValueEnum)]
pub enum Quality {
    /// A look: half a minute, at most 384 pixels
    Draft,
    /// Five minutes, at most 800 pixels
    Normal,
    /// Twenty minutes, at most 1600 pixels
    Fine,
}

impl Quality {
    /// Minutes, and the longest side of a photo.
    pub fn effort(self) -> (f64, u32) {
        match self {
            Self::Draft => (0.5, 384),
            Self::Normal => (5.0, 800),
            Self::Fine => (20.0, 1600),
        }
    }
}

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
    #[arg(short, long, value_name = "DIR")]
    pub out: PathBuf,
    /// Other cameras of the same photos: says how far the estimated ones are off, once moved, turned and scaled to fit best
    #[arg(long, value_name = "FILE")]
    pub compare: Option<PathBuf>,
    #[command(flatten)]
    pub clip: ClipFlags,
    #[command(flatten)]
    pub matching: MatchingFlags,
    #[command(flatten)]
    pub threads: Threads,
}
