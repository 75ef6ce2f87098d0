//! Summary of estimated cameras, for programs to read.

use super::EstimatedPhotos;
use crate::{Error, Placement};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use weaver_sfm::{Confidence, LeftOut};

/// Quality and exactness of estimated cameras: the file `cameras.json` beside the transforms.json that has the cameras.
///
/// Deviations are standard deviations, up to the world's place, turn and scale; `None` where they are not known.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct CamerasSummary {
    /// `good`, `none`, or `doubtful` with the reason.
    pub confidence: String,
    /// The doubt, in a sentence; `None` where there is none.
    #[serde(default)]
    pub doubt: Option<String>,
    /// The remedy.
    #[serde(default)]
    pub help: Option<String>,
    /// Points that photos agree about.
    pub points: usize,
    /// Median difference between where points are and were seen, pixels of the photos as they were matched.
    pub error_pixels: Option<f64>,
    /// The focal length of the first camera over the longer side of its photo.
    pub focal_length: Option<f64>,
    /// The deviation of that, over the longer side too.
    pub focal_length_deviation: Option<f64>,
    /// The root of the mean square distance of centers from their middle, in units of transforms.json.
    pub spread_of_centers: Option<f64>,
    /// Support of the best explanation with other rotations, over the support of the chosen one.
    pub rival: f64,
    /// Where the world was brought.
    #[serde(default)]
    pub placement: Placement,
    /// Each photo, by its path as it was given.
    pub photos: BTreeMap<String, CameraSummary>,
}

/// Summary of the camera of one photo.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct CameraSummary {
    /// The reason why it has no camera; `None` if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub left_out: Option<String>,
    /// True if the second look with a learned matcher placed it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub second_look: bool,
    /// Points that it sees.
    #[serde(default)]
    pub points: usize,
    /// Its focal length over its longer side.
    #[serde(default)]
    pub focal_length: Option<f64>,
    /// The deviation of its rotation, degrees.
    #[serde(default)]
    pub rotation_deviation_degrees: Option<f64>,
    /// The deviation of its center, in units of transforms.json.
    #[serde(default)]
    pub center_deviation: Option<f64>,
}

impl CamerasSummary {
    /// Name of the file.
    pub const NAME: &str = "cameras.json";

    /// The summary of a capture's cameras, a folder or its transforms.json; `None` where there is none, or something
    /// else.
    pub fn of_capture(capture: &Path) -> Option<Self> {
        let folder = if capture.is_dir() { capture } else { capture.parent()? };
        serde_json::from_str(&weaver_io::read_text(folder.join(Self::NAME)).ok()?).ok()
    }

    /// Writes it as JSON.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub(super) fn write(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        let text = serde_json::to_string_pretty(self).expect("a summary is plain data") + "\n";
        Ok(weaver_io::write_text(path, &text)?)
    }
}

impl EstimatedPhotos {
    /// Summary of the cameras' quality and exactness.
    pub fn summary(&self) -> CamerasSummary {
        let e = &self.estimate;
        let finite = |x: f64| x.is_finite().then_some(x);
        let photo = |i: usize| match &e.cameras[i] {
            Err(reason) => CameraSummary { left_out: Some(left_out(*reason).into()), ..CameraSummary::default() },
            Ok(camera) => {
                // Photos that are only located have no known deviations.
                let told = e.uncertainty.as_ref().filter(|u| u.rotations[i] > 0.0);
                CameraSummary {
                    left_out: None,
                    second_look: e.second_look.contains(&i),
                    points: e.seen[i],
                    focal_length: finite(camera.intrinsics.fx / camera.width.max(camera.height) as f64),
                    rotation_deviation_degrees: told.and_then(|u| finite(u.rotations[i].to_degrees())),
                    center_deviation: told.and_then(|u| finite(u.centers[i])),
                }
            }
        };
        let doubt = self.doubt();
        CamerasSummary {
            confidence: confidence(self.confidence()).into(),
            doubt: doubt.as_ref().map(|doubt| doubt.what.clone()),
            help: doubt.map(|doubt| doubt.help),
            points: e.points.len(),
            error_pixels: finite(e.error),
            focal_length: finite(self.focal()),
            focal_length_deviation: e.uncertainty.as_ref().and_then(|u| finite(u.focal * self.focal())),
            spread_of_centers: e.uncertainty.as_ref().and_then(|u| finite(u.spread)),
            rival: e.rival,
            placement: self.placement.clone(),
            photos: (0..self.paths.len()).map(|i| (self.paths[i].display().to_string(), photo(i))).collect(),
        }
    }
}

fn confidence(of: Confidence) -> &'static str {
    match of {
        Confidence::Good => "good",
        Confidence::Ambiguous => "doubtful: other cameras explain nearly as much",
        Confidence::Inexact => "doubtful: points are not where photos see them",
        Confidence::Guessed => "doubtful: focal length guessed",
        Confidence::Untied => "doubtful: parts hardly tied to each other",
        Confidence::LooseFocal => "doubtful: focal length",
        Confidence::LooseRotation => "doubtful: rotations",
        Confidence::LooseCenter => "doubtful: centers",
        Confidence::None => "none",
    }
}

fn left_out(reason: LeftOut) -> &'static str {
    match reason {
        LeftOut::Textureless => "no texture",
        LeftOut::Unmatched => "nothing in common with others",
        LeftOut::OnePlace => "taken from the place of others",
        LeftOut::Unplaced => "too little in common with others",
    }
}
