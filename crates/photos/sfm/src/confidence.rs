//! Confidence in an estimate.

use crate::uncertainty::Uncertainty;

/// Another explanation is a rival from this part of the best one's support on.
const RIVAL: f64 = 0.75;
/// An estimate is doubtful if the median residual is larger, pixels.
const OFF: f64 = 1.0;
/// Required accuracy of cameras: degrees, part of the spread of centers, part of the focal length.
const TURN: f64 = 2.0;
const CENTER: f64 = 0.05;
const FOCAL: f64 = 0.05;
/// Number of standard deviations that must lie within that. With 3 in place of 2.5, more right estimates were called
/// doubtful; with 2, more wrong ones good.
const SURE: f64 = 2.5;

/// Confidence in an estimate.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Confidence {
    /// No doubt.
    Good,
    /// Other cameras explain the photos nearly as well.
    Ambiguous,
    /// Residuals are large.
    Inexact,
    /// The focal length is not given, and two photos hardly determine it.
    Guessed,
    /// Parts of the scene have too little in common to fix their relative place, or matches contradict it.
    Untied,
    /// The focal length may be more than 5 % off.
    LooseFocal,
    /// A photo's rotation may be more than 2 degrees off.
    LooseRotation,
    /// A photo's place may be off by more than 5 % of the spread of centers.
    LooseCenter,
    /// There are no cameras.
    None,
}

/// Grounds of confidence.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Grounds<'a> {
    /// True if there are observations.
    pub observed: bool,
    /// Median residual, pixels.
    pub error: f64,
    pub focal_guessed: bool,
    /// True if parts of the scene are not tied to the rest, or in a doubtful place.
    pub untied: bool,
    pub rival: f64,
    pub uncertainty: Option<&'a Uncertainty>,
}

impl Grounds<'_> {
    pub fn confidence(&self) -> Confidence {
        let [turn, center] = self.uncertainty.map_or([f64::INFINITY; 2], Uncertainty::most);
        let focal = self.uncertainty.map_or(f64::INFINITY, |u| u.focal);
        if !self.observed {
            Confidence::None
        } else if self.error > OFF {
            Confidence::Inexact
        } else if self.focal_guessed {
            Confidence::Guessed
        } else if self.untied || [focal, turn, center].iter().any(|x| !x.is_finite()) {
            Confidence::Untied
        } else if self.rival > RIVAL {
            Confidence::Ambiguous
        } else if SURE * focal > FOCAL {
            Confidence::LooseFocal
        } else if SURE * turn.to_degrees() > TURN {
            Confidence::LooseRotation
        } else if SURE * center > CENTER {
            Confidence::LooseCenter
        } else {
            Confidence::Good
        }
    }
}
