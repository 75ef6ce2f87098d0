//! Flags of everything that estimates cameras from photos or clips.

use super::masks::MaskFlags;
use super::placing::PlacingFlags;
use clap::Args;
use std::path::PathBuf;
use weaver_command::{Failure, choice, number};
use weaver_data::{EstimatePhotosOptions, Find};

/// Heading of these flags.
pub(super) const MATCHING: &str = "Estimated cameras";

/// Radial distortions that may be found.
const DISTORTIONS: [(&str, Find, &str); 3] = [
    ("off", Find::Off, "None: lines stay straight"),
    ("k1", Find::K1, "The first coefficient"),
    ("k1k2", Find::K1K2, "Two"),
];

/// Flags of clips.
#[derive(Args, Clone, Copy, Debug, Default, PartialEq)]
pub struct ClipFlags {
    /// At most so many frames of each clip, spread over the way of its camera [default: as many as show something new, at most 120]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=2000), help_heading = MATCHING)]
    pub frames: Option<u32>,
}

impl ClipFlags {
    /// The most frames of each clip.
    pub fn most(self) -> Option<usize> {
        self.frames.map(|most| most as usize)
    }
}

/// Options of estimated cameras.
#[derive(Args, Clone, Copy, Debug, PartialEq)]
pub struct MatchingFlags {
    /// The focal length of all photos, over their longer side: 0.75 for most phones [default: what the files tell, else estimated]
    #[arg(long, value_name = "F", value_parser = number(0.2..=20.0, "expected a number from 0.2 to 20, as in 1.2"), help_heading = MATCHING)]
    pub focal: Option<f64>,
    /// Ignores the focal lengths that files tell
    #[arg(long, help_heading = MATCHING)]
    pub no_exif: bool,
    /// Each photo has a focal length of its own [default: photos of the same proportions share one]
    #[arg(long, help_heading = MATCHING)]
    pub own_focal: bool,
    /// The radial distortion that is found [default: k1, and of many photos k2, where photos tell them]
    #[arg(long, value_parser = choice(&DISTORTIONS), help_heading = MATCHING)]
    pub distortion: Option<Find>,
    /// Longest side of the photos while they are matched
    #[arg(long, value_name = "PIXELS", default_value_t = 640, value_parser = clap::value_parser!(u32).range(64..=8192), help_heading = MATCHING)]
    pub match_size: u32,
}

impl Default for MatchingFlags {
    fn default() -> Self {
        let EstimatePhotosOptions { long_side, focal, exif, shared, .. } = EstimatePhotosOptions::default();
        Self { focal, no_exif: !exif, own_focal: !shared, distortion: None, match_size: long_side as u32 }
    }
}

impl From<MatchingFlags> for EstimatePhotosOptions {
    fn from(flags: MatchingFlags) -> Self {
        Self {
            long_side: flags.match_size as usize,
            focal: flags.focal,
            exif: !flags.no_exif,
            shared: !flags.own_focal,
            sequence: false,
            distortion: flags.distortion.unwrap_or_default(),
        }
    }
}

impl MatchingFlags {
    /// Checks that no flag is given, for cameras that are not estimated.
    ///
    /// # Errors
    /// When a flag is given; `found` names the source of cameras.
    pub fn check_unused(&self, found: &str) -> Result<(), Failure> {
        let flags = "--focal, --no-exif, --own-focal, --distortion, --match-size";
        unused(self, flags, "estimated cameras", found)
    }
}

/// Everything that decides about cameras which are estimated from photos and clips alone.
#[derive(Args, Clone, Debug)]
pub struct EstimateFlags {
    #[command(flatten)]
    pub clip: ClipFlags,
    #[command(flatten)]
    pub matching: MatchingFlags,
    #[command(flatten)]
    pub placing: PlacingFlags,
    #[command(flatten)]
    pub masks: MaskFlags,
}

impl EstimateFlags {
    /// Checks that no flag is given but masks, for a capture with cameras of its own.
    ///
    /// # Errors
    /// When a flag is given; `found` names the source of cameras.
    pub fn check_unused(&self, found: &str) -> Result<(), Failure> {
        self.matching.check_unused(found)?;
        unused(&self.clip, "--frames", "a clip", found)?;
        unused(&self.placing, "--positions, --scale-bar, --no-gps, --up", "estimated cameras", found)
    }

    /// The files and folders that are read beside the photos.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        self.masks.folder().into_iter().chain(self.placing.files())
    }
}

/// Checks that flags have their defaults.
fn unused<T: Default + PartialEq>(given: &T, flags: &str, expected: &str, found: &str) -> Result<(), Failure> {
    match *given == T::default() {
        true => Ok(()),
        false => Err(Failure::Usage(format!("{flags}: expected {expected}, found {found}"))),
    }
}
