//! Flags of everything that estimates cameras from photos or clips.

use clap::{Args, ValueEnum};
use std::path::PathBuf;
use weaver_command::{Failure, choice, number};
use weaver_data::capture::MaskOptions;
use weaver_data::posed::Masked;
use weaver_data::{EstimatePhotosOptions, Find, Placing, Projection, SphereOptions};

/// Heading of these flags.
const MATCHING: &str = "Estimated cameras";

/// Radial distortions that may be found.
const DISTORTIONS: [(&str, Find, &str); 3] = [
    ("off", Find::Off, "None: lines stay straight"),
    ("k1", Find::K1, "The first coefficient"),
    ("k1k2", Find::K1K2, "Two"),
];

/// Lenses of photos.
const LENSES: [(&str, bool, &str); 2] = [
    ("usual", false, "Straight lines stay straight, but for a radial distortion"),
    (
        "fisheye",
        true,
        "One fisheye, to 180 degrees and beyond: its focal length, principal point and k1 to k4 are found",
    ),
];

/// Projections of photos.
const PROJECTIONS: [(&str, Projection, &str); 2] = [
    ("equirectangular", Projection::Equirectangular, "Panoramas of the whole sphere: each becomes six photos"),
    ("pinhole", Projection::Pinhole, "Photos of a usual lens, whatever their files say"),
];

/// Flags of clips.
#[derive(Args, Clone, Copy, Debug, Default, PartialEq)]
pub struct ClipFlags {
    /// At most so many frames of each clip, spread over the way of its camera [default: as many as show something new,
    /// at most 120]
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
    /// The focal length of all photos, over their longer side: 0.75 for most phones [default: the files', else
    /// estimated]
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
    /// The lens of all photos [default: usual]
    #[arg(long, value_parser = choice(&LENSES), conflicts_with_all = ["distortion", "own_focal"], help_heading = MATCHING)]
    pub lens: Option<bool>,
    /// Projection of photos and clips that are twice as wide as high [default: what the files tell: Photo Sphere XMP,
    /// spherical clips, Insta360, Ricoh]
    #[arg(long, value_parser = choice(&PROJECTIONS), help_heading = MATCHING)]
    pub projection: Option<Projection>,
    /// Leaves out what is so near to straight down in panoramas, degrees; 0 keeps all [default: what is the same in
    /// all of them, as a tripod or a logo is]
    #[arg(long, value_name = "DEGREES", value_parser = number(0.0..=80.0, "expected degrees from 0 to 80, as in 20"), help_heading = MATCHING)]
    pub nadir: Option<f64>,
    /// Takes a second look, with learned features and a learned matcher, at photos that are left out and at cameras
    /// that are doubtful [default: false]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", help_heading = MATCHING)]
    pub weak_pairs: Option<bool>,
}

impl Default for MatchingFlags {
    fn default() -> Self {
        let EstimatePhotosOptions { long_side, focal, exif, shared, .. } = EstimatePhotosOptions::default();
        Self {
            focal,
            no_exif: !exif,
            own_focal: !shared,
            distortion: None,
            match_size: long_side as u32,
            lens: None,
            projection: None,
            nadir: None,
            weak_pairs: None,
        }
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
            spheres: SphereOptions { projection: flags.projection, nadir: flags.nadir },
            fisheye: flags.lens.unwrap_or(false),
            weak_pairs: flags.weak_pairs.unwrap_or(Self::default().weak_pairs),
        }
    }
}

impl MatchingFlags {
    /// Checks that no flag is given, for cameras that are not estimated.
    ///
    /// # Errors
    /// When a flag is given; `found` names the source of cameras.
    pub fn check_unused(&self, found: &str) -> Result<(), Failure> {
        let flags =
            "--focal, --no-exif, --own-focal, --distortion, --match-size, --lens, --projection, --nadir, --weak-pairs";
        unused(self, flags, "estimated cameras", found)
    }
}

/// Meanings of masked pixels.
pub const MASKED: [(&str, Masked, &str); 2] = [
    ("unknown", Masked::Unknown, "Anything may stand there: these pixels do not count"),
    ("empty", Masked::Empty, "Nothing stands there: these pixels show the background"),
];

/// Masks of photos.
#[derive(Args, Clone, Debug, Default, PartialEq)]
pub struct MaskFlags {
    /// Leaves out pixels that are black in masks: files in FOLDER named as the photos; without FOLDER, those in a
    /// folder masks beside the photo or beside its folder, else the photo's alpha
    #[arg(long, value_name = "FOLDER", num_args = 0..=1, help_heading = MATCHING)]
    masks: Option<Option<PathBuf>>,
    /// Leaves out pixels that are white in masks in place of black ones
    #[arg(long, requires = "masks", help_heading = MATCHING)]
    invert_masks: bool,
}

impl MaskFlags {
    /// The masks, if any were asked for.
    pub fn options(&self) -> Option<MaskOptions> {
        let folder = self.masks.clone()?;
        Some(MaskOptions { folder, inverted: self.invert_masks })
    }
}

/// The meaning of masked pixels.
#[derive(Args, Clone, Copy, Debug, Default, PartialEq)]
pub struct MaskedFlag {
    /// Meaning of masked pixels: unknown, or empty space [default: unknown]
    #[arg(long, value_parser = choice(&MASKED), requires = "masks", help_heading = MATCHING)]
    pub masked: Option<Masked>,
}

/// Sources of meters and of the vertical.
#[derive(Args, Clone, Debug, Default, PartialEq)]
pub struct PlacingFlags {
    /// Positions of the cameras, in place of the photos' GPS: a table (CSV) that begins with name,x,y,z in meters, or
    /// with name,latitude,longitude,altitude
    #[arg(long, value_name = "FILE", help_heading = MATCHING)]
    pub positions: Option<PathBuf>,
    /// A bar of known length: a table (CSV) that begins with name,ax,ay,bx,by,length, and has the pixels of its ends in
    /// two photos or more, and its length in meters
    #[arg(long, value_name = "FILE", help_heading = MATCHING)]
    pub scale_bar: Option<PathBuf>,
    /// Ignores the GPS of photos
    #[arg(long, help_heading = MATCHING)]
    pub no_gps: bool,
    /// Which way the scene stands [default: level, upright by the photos]
    #[arg(long, value_enum, value_name = "level|keep", help_heading = MATCHING, conflicts_with_all = ["positions", "scale_bar"])]
    pub up: Option<UpChoice>,
}

/// Which way a scene stands.
#[derive(Clone, Copy, Debug, Eq, PartialEq, ValueEnum)]
pub enum UpChoice {
    /// Upright, on a level ground: y down, or with positions in meters, east, north and up
    Level,
    /// As it was estimated: the first camera is the origin
    Keep,
}

impl From<&PlacingFlags> for Placing {
    fn from(flags: &PlacingFlags) -> Self {
        Self {
            positions: flags.positions.clone(),
            gps: !flags.no_gps,
            scale_bar: flags.scale_bar.clone(),
            up: flags.up != Some(UpChoice::Keep),
        }
    }
}

impl PlacingFlags {
    /// The files that are read.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        self.positions.clone().into_iter().chain(self.scale_bar.clone())
    }
}

/// Clips, matching, placing and masks.
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
        self.masks.masks.clone().flatten().into_iter().chain(self.placing.files())
    }
}

/// Checks that flags have their defaults.
fn unused<T: Default + PartialEq>(given: &T, flags: &str, expected: &str, found: &str) -> Result<(), Failure> {
    match *given == T::default() {
        true => Ok(()),
        false => Err(Failure::Usage(format!("{flags}: expected {expected}, found {found}"))),
    }
}
