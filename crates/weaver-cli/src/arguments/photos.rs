//! The command lines of `splatweaver cameras` and `splatweaver reconstruct`.

use super::Threads;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use weaver_command::Failure;
use weaver_data::{EstimateOptions, Find};

/// How cameras are estimated, and how Gaussians are fitted.
const MATCHING: &str = "Estimated cameras";
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
  splatweaver reconstruct photos -o scene --hold-out           how good it is from elsewhere")]
pub struct Reconstruct {
    /// Photos (JPEG, PNG, TIFF, WebP), folders of photos, clips, or one capture
    #[arg(required = true)]
    pub photos: Vec<PathBuf>,
    /// Folder for the results
    #[arg(short, long, value_name = "OUT")]
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
    /// Every eighth photo is not shown to the fit, which is judged by them
    #[arg(long, help_heading = FIT)]
    pub hold_out: bool,
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
    #[arg(short, long, value_name = "OUT")]
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

/// What becomes of clips.
#[derive(Args, Clone, Copy, Debug, Default, PartialEq)]
pub struct ClipFlags {
    /// At most so many frames of each clip, spread over the way of its camera [default: as many as show something new, at most 120]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=2000), help_heading = MATCHING)]
    pub frames: Option<u32>,
}

impl ClipFlags {
    /// That these say nothing, where there is no clip.
    ///
    /// # Errors
    /// When they do; `found` says what there is.
    pub fn check_unused(&self, found: &str) -> Result<(), Failure> {
        match self.frames {
            None => Ok(()),
            Some(_) => Err(Failure::Usage(format!("--frames: expected a clip, found {found}"))),
        }
    }
}

/// Coefficients of a radial distortion.
#[derive(Clone, Copy, Debug, Eq, PartialEq, ValueEnum)]
pub enum Coefficients {
    /// None: lines stay straight
    Off,
    /// The first
    K1,
    /// Two
    K1k2,
}

/// How cameras are estimated.
#[derive(Args, Clone, Copy, Debug, PartialEq)]
pub struct MatchingFlags {
    /// The focal length of all photos, over their longer side: 0.75 for most phones [default: what the files tell, else estimated]
    #[arg(long, value_name = "F", value_parser = focal, help_heading = MATCHING)]
    pub focal: Option<f64>,
    /// Ignores the focal lengths that files tell
    #[arg(long, help_heading = MATCHING)]
    pub no_exif: bool,
    /// Each photo has a focal length of its own [default: photos of the same proportions share one]
    #[arg(long, help_heading = MATCHING)]
    pub own_focal: bool,
    /// The radial distortion that is found [default: k1, and of many photos k2, where photos tell them]
    #[arg(long, value_name = "WHICH", value_enum, help_heading = MATCHING)]
    pub distortion: Option<Coefficients>,
    /// Longest side of the photos while they are matched
    #[arg(long, value_name = "PIXELS", default_value_t = 640, value_parser = clap::value_parser!(u32).range(64..=8192), help_heading = MATCHING)]
    pub match_size: u32,
}

impl Default for MatchingFlags {
    fn default() -> Self {
        let EstimateOptions { long_side, focal, exif, shared, .. } = EstimateOptions::default();
        Self { focal, no_exif: !exif, own_focal: !shared, distortion: None, match_size: long_side as u32 }
    }
}

impl From<MatchingFlags> for EstimateOptions {
    fn from(flags: MatchingFlags) -> Self {
        Self {
            long_side: flags.match_size as usize,
            focal: flags.focal,
            exif: !flags.no_exif,
            shared: !flags.own_focal,
            sequence: false,
            distortion: match flags.distortion {
                None => Find::Told,
                Some(Coefficients::Off) => Find::Off,
                Some(Coefficients::K1) => Find::K1,
                Some(Coefficients::K1k2) => Find::K1K2,
            },
        }
    }
}

impl MatchingFlags {
    /// That these say nothing, where cameras are not estimated.
    ///
    /// # Errors
    /// When they do; `found` says where cameras come from.
    pub fn check_unused(&self, found: &str) -> Result<(), Failure> {
        if *self == Self::default() {
            return Ok(());
        }
        let flags = "--focal, --no-exif, --own-focal, --distortion, --match-size";
        Err(Failure::Usage(format!("{flags}: expected estimated cameras, found {found}")))
    }
}

fn focal(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(focal) if (0.2..=20.0).contains(&focal) => Ok(focal),
        _ => Err("expected a number from 0.2 to 20, as in 1.2".into()),
    }
}
