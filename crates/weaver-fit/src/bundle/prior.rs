//! What given cameras are worth.

use super::pictures::Picture;
use crate::cameras::TWIST;
use weaver_geometry::{Pose, se3};

/// How wrong given cameras are taken to be: degrees, and parts of the median depth.
const EXPECTED: [f64; 2] = [1.0, 0.01];

/// Cost of a camera that is as wrong as expected: that of some two dozen patches that do not fit at all.
const WEIGHT: f64 = 0.01;

/// Given cameras, each taken to be wrong by about a degree and 1 % of the distance, independently of the others.
///
/// Photos from a narrow arc hardly say how far the arc turns: the relief could be flatter, and the arc longer. The mean of
/// many independent errors does.
pub(super) struct Prior {
    given: Vec<Pose>,
    /// Weights of a twist, in units of the cost of differences.
    pub weights: Vec<[f64; TWIST]>,
}

impl Prior {
    pub fn new(pictures: &[Picture<'_>], given: Vec<Pose>) -> Self {
        let weights = pictures
            .iter()
            .map(|picture| {
                let [turn, part] = EXPECTED;
                let turn = WEIGHT / turn.to_radians().powi(2);
                let shift = picture.median_depth().map_or(0.0, |depth| WEIGHT / (part * depth).powi(2));
                [shift, shift, shift, turn, turn, turn]
            })
            .collect();
        Self { given, weights }
    }

    /// The twist from a given camera to what it has become.
    pub fn twist(&self, camera: usize, now: &Pose) -> [f64; TWIST] {
        let (v, w) = se3::log(&now.relative_to(&self.given[camera]));
        [v.x, v.y, v.z, w.x, w.y, w.z]
    }
}
