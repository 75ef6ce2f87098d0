//! How much an estimate is to be believed.

use crate::estimate::Estimate;

/// From this part of what the best explanation explains, another one is a rival.
const RIVAL: f64 = 0.9;
/// An estimate is doubtful whose points are this far off in the median, pixels.
const OFF: f64 = 1.0;

/// How much an estimate is to be believed.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Confidence {
    /// Nothing speaks against it.
    Good,
    /// Other cameras explain the photos nearly as well.
    Ambiguous,
    /// Points are not where photos see them.
    Inexact,
    /// The focal length is not known, and two photos hardly tell it.
    Guessed,
    /// There are no cameras.
    None,
}

impl Estimate {
    /// How much the cameras are to be believed.
    ///
    /// Of four photos each, 45 times from eleven captures, at 128 x 96 pixels with known focal lengths, 35 are good, all of these within
    /// 1.1 degrees; of the other ten four are more than 5 degrees off.
    pub fn confidence(&self) -> Confidence {
        if self.observations.is_empty() {
            Confidence::None
        } else if self.error > OFF {
            Confidence::Inexact
        } else if self.focal_guessed {
            Confidence::Guessed
        } else if self.rival > RIVAL {
            Confidence::Ambiguous
        } else {
            Confidence::Good
        }
    }
}
