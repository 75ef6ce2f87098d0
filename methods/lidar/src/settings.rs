//! How maps are made and scans are tracked.

use crate::{Error, LossWeights, NormalTarget, RangeMean, Result};

/// Rules by which surfels are made of keyframes.
#[derive(Clone, Debug, PartialEq)]
pub struct MapSettings {
    /// Steps of Adam at each keyframe.
    pub iterations: usize,
    /// Share of the pixels that are not covered yet which get a surfel.
    pub density: f64,
    /// Pixels with at most this opacity are not covered.
    pub uncovered: f64,
    /// Largest standard deviation that costs nothing, meters.
    pub scale_limit: f64,
    /// Weight of the scales beyond it.
    pub scale_weight: f64,
    /// True if they are averaged over surfels, as other terms are over pixels, so that surfels grow into holes; else summed, as published,
    /// which keeps all below the limit.
    pub scale_mean: bool,
    /// Weights of the other terms.
    pub loss: LossWeights,
    /// True if surfels begin with normals by principal components; else they face the sensor.
    pub measured_normals: bool,
    /// Opacity below which a surfel goes after a keyframe.
    pub prune: f64,
    /// A new map begins above so many surfels.
    pub most_surfels: usize,
    /// A new map begins after so many keyframes.
    pub most_keyframes: usize,
    /// Seed of all chance.
    pub seed: u64,
}

impl Default for MapSettings {
    fn default() -> Self {
        Self {
            iterations: 200,
            density: 0.3,
            uncovered: 0.2,
            scale_limit: 0.3,
            scale_weight: 1.0,
            scale_mean: false,
            loss: LossWeights { range: RangeMean::Measured, opacity: 0.1, normal: 0.5, target: NormalTarget::Measured },
            measured_normals: true,
            prune: 0.1,
            most_surfels: 150_000,
            most_keyframes: 100,
            seed: 0,
        }
    }
}

impl MapSettings {
    /// The published settings: surfels face the sensor first, their normals follow those of drawn ranges, and are at most 0.1 m large.
    pub fn published() -> Self {
        let loss = LossWeights { range: RangeMean::Image, opacity: 0.4, normal: 0.5, target: NormalTarget::Drawn };
        Self { scale_limit: 0.1, loss, measured_normals: false, ..Self::default() }
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// [`Error::Settings`], which names the one that makes no sense.
    pub fn check(&self) -> Result<()> {
        let shares = [("density", self.density), ("uncovered", self.uncovered), ("prune", self.prune)];
        for (name, share) in shares {
            if !(share > 0.0 && share <= 1.0) {
                return Err(Error::Settings(format!("{name}: expected a share above 0 up to 1, found {share}")));
            }
        }
        if !(self.scale_limit > 0.0 && self.scale_limit.is_finite()) {
            return Err(Error::Settings(format!("scale limit: expected meters above 0, found {}", self.scale_limit)));
        }
        Ok(())
    }
}

/// Rules by which scans are tracked and become keyframes.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackSettings {
    /// Steps of the geometric stage.
    pub geometric_steps: usize,
    /// Steps of the range stage; 0 leaves it out.
    pub range_steps: usize,
    /// A scan becomes a keyframe if less of it fits.
    pub least_fitness: f64,
    /// A scan is lost if less of it fits.
    pub lost_fitness: f64,
    /// A scan becomes a keyframe if it is farther from the last one, meters.
    pub farthest: f64,
    /// A scan becomes a keyframe after so many others.
    pub most_frames: usize,
    /// True if points are moved to where the sensor was when the sweep began, by their times and the motion of the sweep before.
    pub deskew: bool,
    /// Rules by which keyframes that come back are registered to earlier ones; none if they are not.
    pub loops: Option<LoopSettings>,
    /// Tracking ends after so many scans were lost in a row.
    pub lost: usize,
}

impl Default for TrackSettings {
    fn default() -> Self {
        Self {
            geometric_steps: 10,
            range_steps: 10,
            least_fitness: 0.3,
            // Real scans that are tracked rightly have 0.19 and more, those of another place 0.02.
            lost_fitness: 0.1,
            farthest: 5.0,
            most_frames: usize::MAX,
            deskew: false,
            loops: None,
            lost: 3,
        }
    }
}

/// When a keyframe is registered to an earlier one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopSettings {
    /// Largest distance between the two as far as is known, meters.
    pub reach: f64,
    /// Keyframes between the two at least.
    pub gap: usize,
    /// Share of the scan that must fit.
    pub least_fitness: f64,
}

impl Default for LoopSettings {
    fn default() -> Self {
        Self { reach: 3.0, gap: 10, least_fitness: 0.6 }
    }
}
