//! Doubts about estimated cameras, in words, and their remedies.

use super::EstimatedPhotos;
use crate::remarks::some_of;
use weaver_sfm::{Confidence, Uncertainty};

/// A focal length is not determined at all if its deviation is so large a part of it.
const UNTOLD: f64 = 0.5;

/// A doubt about cameras, and its remedy.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Doubt {
    /// The doubt, in a few words.
    pub what: String,
    /// The remedy.
    pub help: String,
}

impl EstimatedPhotos {
    /// Doubt about the cameras; `None` where there is none, and without cameras.
    pub fn doubt(&self) -> Option<Doubt> {
        let between = "photos between it and the others would tell";
        let (what, help) = match self.confidence() {
            Confidence::Good | Confidence::None => return None,
            Confidence::Ambiguous => (
                format!("other cameras explain {:.0} % as much", 100.0 * self.estimate.rival),
                "more photos between these, or --focal, would tell",
            ),
            Confidence::Inexact => (
                "points are not where photos see them; something may have moved".into(),
                "photos of which nothing moves, or masks, would help",
            ),
            Confidence::Guessed => (
                "two photos hardly tell their focal length".into(),
                "a third one from another place, or --focal, would",
            ),
            Confidence::Untied => {
                let untied: Vec<String> =
                    self.estimate.untied.iter().map(|photo| self.paths[*photo].display().to_string()).collect();
                let what = match untied.is_empty() {
                    true => "parts of the scene have no points in common".into(),
                    false => format!("what ties these to the other photos may be chance: {}", some_of(&untied)),
                };
                (what, "photos between would tell")
            }
            Confidence::LooseFocal => {
                let told = self.estimate.uncertainty.as_ref().map_or(f64::NAN, |u| u.focal);
                let what = match told < UNTOLD {
                    true => format!("the focal length is told to {:.0} % only", 100.0 * told),
                    false => {
                        "nothing tells the focal length, as where photos of a wall are taken going towards it".into()
                    }
                };
                (what, "photos from more different places, or --focal, would tell")
            }
            Confidence::LooseRotation => {
                (format!("{} may be turned by some degrees", self.least_told(|u| &u.rotations)), between)
            }
            Confidence::LooseCenter => {
                (format!("where {} was taken is told badly", self.least_told(|u| &u.centers)), between)
            }
        };
        Some(Doubt { what, help: help.into() })
    }

    /// The photo with the largest uncertainty of some kind.
    fn least_told(&self, of: impl Fn(&Uncertainty) -> &Vec<f64>) -> String {
        let most = self.estimate.uncertainty.as_ref().and_then(|u| {
            let deviations = of(u).iter().enumerate();
            deviations.max_by(|a, b| a.1.total_cmp(b.1)).map(|(photo, _)| self.paths[photo].display().to_string())
        });
        most.unwrap_or_else(|| "a photo".into())
    }
}
