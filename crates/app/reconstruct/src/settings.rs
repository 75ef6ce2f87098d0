//! Settings of a run.

use crate::sources::Sources;
use crate::{Coverage, Error, Gaining};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use weaver_data::capture::HoldOut;
use weaver_data::posed::{Lenses, Masked, PosedOptions};
use weaver_fit::{FitError, FitRasterizer, FitSettings};
use weaver_io::SceneFormat;

/// The largest count.
const MOST: usize = u32::MAX as usize;
/// The most Gaussians of a run, which the command line takes, too: where they begin at random, a part of these is made
/// at once.
const MOST_GAUSSIANS: usize = 100_000_000;

/// Settings of a run.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct RunSettings {
    /// The capture: a folder, or a transforms.json.
    pub capture: PathBuf,
    /// Longest side of the photos, pixels; `None` takes them as they are.
    pub long_side: Option<usize>,
    /// The choice of held-out photos.
    #[serde(flatten, with = "held")]
    pub hold_out: HoldOut,
    /// The most photos to fit to, evenly spread in the capture's order.
    pub views: Option<usize>,
    /// True if masks are read.
    pub masks: bool,
    /// True if black counts in masks.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub invert_masks: bool,
    /// Meaning of masked pixels for the scene.
    #[serde(default, skip_serializing_if = "is_unknown")]
    pub masked: Masked,
    /// Treatment of photos whose lens bends straight lines. Runs of earlier versions undid all distortion.
    #[serde(default)]
    pub lenses: Lenses,
    /// True if the focal length is refined with the cameras ([`Poses::refine`](weaver_fit::Poses::refine)), one factor
    /// for all photos; it stays as given where a lens is a fisheye.
    pub focal: bool,
    /// Settings that the photos decide; empty once they are decided, and then in [`RunSettings::fit`].
    #[serde(skip)]
    pub by_photos: BTreeSet<ByPhotos>,
    /// Where the Gaussians begin.
    pub init: Initial,
    /// Photos whose depth is found where Gaussians begin on surfaces, at most; `None` before that is decided,
    /// which follows from the time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_photos: Option<usize>,
    /// Time for all of it, minutes; the number of steps follows from the speed. `None` takes [`FitSettings::steps`].
    pub minutes: Option<f64>,
    /// With [`minutes`](Self::minutes), the least number of steps, however long they take.
    #[serde(default)]
    pub least_steps: usize,
    /// True if the most Gaussians follow from the time, with [`minutes`](Self::minutes): there are fewer where the
    /// machine turns out to be slower. Once steps begin, the number is in [`RunSettings::fit`].
    #[serde(skip)]
    pub gaussians_in_time: bool,
    /// With [`minutes`](Self::minutes), the most passes through the photos, though there be time for more: further
    /// passes improve the fitted photos alone. `None` uses the time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub most_rounds: Option<usize>,
    /// The ends that a run has come to that goes on for as long as held-out photos gain; `None` ends it after
    /// [`FitSettings::steps`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gaining: Option<Gaining>,
    /// Seconds between checkpoints, at least.
    pub save_every: f64,
    /// Further files of the scene, beside `scene.ply`.
    pub formats: Vec<SceneFormat>,
    /// Level of a compressed file that the end of the run is made for, 0 to 3
    /// ([`Quality::level`](weaver_codec::lite::Quality::level)); `None` writes none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compress: Option<f64>,
    /// True if the scene is also written as a page to look at, `view.html`.
    #[serde(default = "written")]
    pub html: bool,
    /// Settings of the fit.
    pub fit: FitSettings,
}

/// The choice of runs that are older than the key.
fn written() -> bool {
    true
}

fn is_unknown(masked: &Masked) -> bool {
    *masked == Masked::Unknown
}

/// A setting of the fit that follows from the photos, for lack of a choice by the user.
#[derive(Clone, Copy, Debug, Eq, Ord, PartialEq, PartialOrd)]
pub enum ByPhotos {
    /// The colors of photos are corrected ([`FitSettings::exposure`]) where the photos differ in exposure or white
    /// balance ([`ColorAgreement::differ`](weaver_fit::ColorAgreement::differ)).
    Exposure,
    /// The background is the [mean color](weaver_fit::mean_color) of the photos that are fitted; where photos have
    /// transparent parts, it stays the color behind these parts.
    Background,
    /// [`FitSettings::dropout`] is the larger the fewer photos there are ([`FitSettings::dropout_for`]).
    Dropout,
    /// Gaussians begin on surfaces that photos agree about ([`Initial::Dense`]) where these cover enough of the photos,
    /// and are found in a small part of the time; with [`Initial::Auto`] alone.
    Start,
    /// Where Gaussians begin so, their means move the more slowly the larger the photos are
    /// ([`Rates::means_on_surfaces`](weaver_fit::Rates::means_on_surfaces)).
    Means,
    /// The more photos there are, the less weight pulls opacities down ([`weaver_fit::Density::opacity_weight_for`]).
    Fade,
    /// The more photos there are, the more slowly opacities change ([`Rates::opacities_for`](weaver_fit::Rates)).
    Opacities,
    /// Large photos are halved more often at the beginning, and for longer ([`FitSettings::coarse_for`]).
    Coarse,
    /// A shell far behind the scene begins where photos show nothing near ([`weaver_fit::sky`]).
    Sky,
}

impl ByPhotos {
    /// Everything that photos can decide.
    pub const ALL: [Self; 9] = [
        Self::Exposure,
        Self::Background,
        Self::Dropout,
        Self::Start,
        Self::Means,
        Self::Fade,
        Self::Opacities,
        Self::Coarse,
        Self::Sky,
    ];
}

/// Where Gaussians begin.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Initial {
    /// On the capture's points, at random if it has none.
    #[default]
    Auto,
    /// On the capture's points.
    Points,
    /// On surfaces that photos agree about ([`weaver_stereo`]), and on the capture's points that these do not show.
    Dense,
    /// At random.
    Random,
    /// As given to [`Run::create`](crate::Run::create).
    Given,
}

impl RunSettings {
    /// Default least number of steps of a run in a time: fewer make nothing worth seeing.
    pub const LEAST_STEPS: usize = 200;

    /// A run of this capture with everything else as usual.
    pub fn new(capture: impl Into<PathBuf>, fit: FitSettings) -> Self {
        Self {
            capture: capture.into(),
            long_side: None,
            hold_out: HoldOut::Listed,
            views: None,
            masks: false,
            invert_masks: false,
            masked: Masked::Unknown,
            lenses: Lenses::Auto,
            focal: false,
            by_photos: BTreeSet::new(),
            init: Initial::Auto,
            depth_photos: None,
            minutes: None,
            least_steps: Self::LEAST_STEPS,
            gaussians_in_time: false,
            most_rounds: None,
            gaining: None,
            save_every: 20.0,
            formats: Vec::new(),
            compress: None,
            html: true,
            fit,
        }
    }

    /// Default settings of a fit: transients, which single photos show, are left out, and at the end the Gaussians that
    /// no photo needs.
    pub fn usual_fit() -> FitSettings {
        FitSettings { transients: true, clean: true, ..FitSettings::default() }
    }

    /// Checks that every number is in its range, as the command line does: settings may come from a file.
    ///
    /// # Errors
    /// The first that is not, with its range.
    pub fn check(&self) -> Result<(), FitError> {
        let wrong = |key, expected: &str, found: &dyn ToString| {
            Err(FitError::Setting { key, expected: expected.into(), found: found.to_string() })
        };
        match self {
            Self { long_side: Some(side), .. } if !(16..=65_536).contains(side) => {
                wrong("long_side", "16 to 65536", side)
            }
            Self { views: Some(0), .. } => wrong("views", "at least 1", &0),
            Self { minutes: Some(minutes), .. } if !(*minutes > 0.0 && *minutes <= 10_000.0) => {
                wrong("minutes", "a number above 0 and up to 10000", minutes)
            }
            Self { least_steps, .. } if *least_steps > MOST => wrong("least_steps", "below 2^32", least_steps),
            Self { most_rounds: Some(rounds), .. } if !(1..=MOST).contains(rounds) => {
                wrong("most_rounds", "1 to 2^32", rounds)
            }
            Self { save_every, .. } if !(0.0..=1e6).contains(save_every) => {
                wrong("save_every", "seconds from 0 to 1000000", save_every)
            }
            Self { compress: Some(level), .. } if !(0.0..=3.0).contains(level) => wrong("compress", "0 to 3", level),
            Self { fit, .. } if fit.gaussians > MOST_GAUSSIANS => {
                wrong("gaussians", "at most 100000000", &fit.gaussians)
            }
            _ => self.fit.check(),
        }
    }

    /// Undoes distortion on devices, which draw pinholes alone, unless lenses are to be kept.
    pub(crate) fn decide_lenses(&mut self, rasterizer: &dyn FitRasterizer) {
        if self.lenses == Lenses::Auto && rasterizer.device_fit().is_some() {
            self.lenses = Lenses::Undistort;
        }
    }

    /// Options of loading the photos.
    pub(crate) fn posed_options(&self) -> PosedOptions {
        PosedOptions {
            long_side: self.long_side,
            hold_out: self.hold_out,
            masks: self.masks,
            invert_masks: self.invert_masks,
            masked: self.masked,
            background: self.fit.background,
            lenses: self.lenses,
            ..PosedOptions::default()
        }
    }
}

/// The choice of held-out photos in run.json: none with `all`, or each `every`-th, else the listed ones.
mod held {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};
    use weaver_data::capture::HoldOut;

    #[derive(Deserialize, Serialize)]
    struct Held {
        all: bool,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        every: Option<usize>,
    }

    pub fn serialize<S: Serializer>(hold_out: &HoldOut, to: S) -> Result<S::Ok, S::Error> {
        let every = if let HoldOut::Every(step) = hold_out { Some(*step) } else { None };
        Held { all: *hold_out == HoldOut::Nothing, every }.serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<HoldOut, D::Error> {
        Held::deserialize(from).map(|held| match held {
            Held { all: true, .. } => HoldOut::Nothing,
            Held { every: Some(step), .. } => HoldOut::Every(step),
            Held { every: None, .. } => HoldOut::Listed,
        })
    }
}

/// The content of run.json: the settings, and checksums of the inputs. Runs of earlier versions lack the latter.
#[derive(Debug, Deserialize, Serialize)]
pub(crate) struct RunFile {
    #[serde(flatten)]
    pub settings: RunSettings,
    #[serde(default)]
    pub sources: Sources,
    /// Part of each photo with a depth that two others agree about.
    #[serde(default, skip_serializing_if = "Coverage::is_empty")]
    pub coverage: Coverage,
}

impl RunFile {
    /// Name of the file.
    pub const NAME: &str = "run.json";

    pub fn read(folder: &Path) -> Result<Self, Error> {
        let path = folder.join(Self::NAME);
        let invalid = |place: &str, expected: String, found: String| {
            Error::File(weaver_io::Error::Invalid { path: path.clone(), place: place.into(), expected, found })
        };
        let mut file: Self = serde_json::from_str(&weaver_io::read_text(&path)?)
            .map_err(|error| invalid("settings", "those of a fit".into(), error.to_string()))?;
        file.settings.check().map_err(|error| match error {
            FitError::Setting { key, expected, found } => invalid(key, expected, found),
            other => other.into(),
        })?;
        file.settings.capture = folder.join(file.settings.capture);
        Ok(file)
    }

    /// The text of the file in a folder: a capture that lies in it, as estimated cameras do, is named relative to it,
    /// so that both may be moved; so is one whose whole path is not UTF-8.
    ///
    /// # Errors
    /// When no such path is UTF-8.
    pub fn text(&self, folder: &Path) -> Result<String, Error> {
        let relative = weaver_io::relative_path(folder, &self.settings.capture);
        let capture = match (weaver_io::path_in_utf8(&self.settings.capture), relative) {
            (Ok(whole), Ok(relative)) => {
                if relative.starts_with("..") {
                    whole.to_string()
                } else {
                    relative
                }
            }
            (Ok(whole), Err(_)) => whole.to_string(),
            (Err(_), relative) => relative?,
        };
        let settings = RunSettings { capture: capture.into(), ..self.settings.clone() };
        let file = Self { settings, sources: self.sources.clone(), coverage: self.coverage.clone() };
        Ok(serde_json::to_string_pretty(&file).expect("settings are plain data") + "\n")
    }
}
