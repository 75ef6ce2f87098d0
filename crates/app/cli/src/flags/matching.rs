//! Flags of everything that estimates cameras from photos or clips.

use clap::Args;
use weaver_command::{Failure, choice};
use weaver_data::{EstimatePhotosOptions, Find, Projection, SphereOptions};

/// Heading of these flags.
pub(super) const MATCHING: &str = "Estimated cameras";

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
    /// At most so many frames of each clip, spread over the way of its camera [default: as many as show something new, at most 120]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=2000), help_heading = MATCHING)]
    pub frames: Option<u32>,
}

impl ClipFlags {
    /// The most frames of each clip.
    pub fn most(self) -> Option<usize> {
        self.frames.map(|most| most as usize)
    }

    /// Checks that no flag is given, for input without a clip.
    ///
    /// # Errors
    /// When a flag is given; `found` names the input in place of a clip.
    pub fn check_unused(&self, found: &str) -> Result<(), Failure> {
        match self.frames {
            None => Ok(()),
            Some(_) => Err(Failure::Usage(format!("--frames: expected a clip, found {found}"))),
        }
    }
}

/// Options of estimated cameras.
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
    #[arg(long, value_parser = choice(&DISTORTIONS), help_heading = MATCHING)]
    pub distortion: Option<Find>,
    /// Longest side of the photos while they are matched
    #[arg(long, value_name = "PIXELS", default_value_t = 640, value_parser = clap::value_parser!(u32).range(64..=8192), help_heading = MATCHING)]
    pub match_size: u32,
    /// The lens of all photos [default: usual]
    #[arg(long, value_parser = choice(&LENSES), conflicts_with_all = ["distortion", "own_focal"], help_heading = MATCHING)]
    pub lens: Option<bool>,
    /// Projection of photos and clips that are twice as wide as high [default: what the files tell: Photo Sphere XMP, spherical clips,
    /// Insta360, Ricoh]
    #[arg(long, value_parser = choice(&PROJECTIONS), help_heading = MATCHING)]
    pub projection: Option<Projection>,
    /// Leaves out what is so near to straight down in panoramas, degrees; 0 keeps all [default: what is the same in all of them, as a
    /// tripod or a logo is]
    #[arg(long, value_name = "DEGREES", value_parser = nadir, help_heading = MATCHING)]
    pub nadir: Option<f64>,
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
        }
    }
}

impl MatchingFlags {
    /// Checks that no flag is given, for cameras that are not estimated.
    ///
    /// # Errors
    /// When a flag is given; `found` names the source of cameras.
    pub fn check_unused(&self, found: &str) -> Result<(), Failure> {
        if *self == Self::default() {
            return Ok(());
        }
        let flags = "--focal, --no-exif, --own-focal, --distortion, --match-size, --lens, --projection, --nadir";
        Err(Failure::Usage(format!("{flags}: expected estimated cameras, found {found}")))
    }
}

fn nadir(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(degrees) if (0.0..=80.0).contains(&degrees) => Ok(degrees),
        _ => Err("expected degrees from 0 to 80, as in 20".into()),
    }
}

fn focal(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(focal) if (0.2..=20.0).contains(&focal) => Ok(focal),
        _ => Err("expected a number from 0.2 to 20, as in 1.2".into()),
    }
}
