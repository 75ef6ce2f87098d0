//! Settings of mapping and tracking.

use crate::{Error, LossWeights, NormalTarget, RangeMean, Result};

/// Rules for making surfels of keyframes.
#[derive(Clone, Debug, PartialEq)]
pub struct MapSettings {
    /// Steps of Adam at each keyframe.
    pub iterations: usize,
    /// Share of the uncovered pixels that get a surfel.
    pub density: f64,
    /// Largest opacity of an uncovered pixel.
    pub uncovered: f64,
    /// Largest standard deviation without a penalty, meters.
    pub scale_limit: f64,
    /// Weight of the penalty on larger scales.
    pub scale_weight: f64,
    /// True if the penalty is averaged over surfels, as other terms are over pixels, so that surfels grow into holes;
    /// false if it is summed, as published, which keeps all scales below the limit.
    pub scale_mean: bool,
    /// Weights of the other terms.
    pub loss: LossWeights,
    /// True if surfels begin with normals by principal components; else they face the sensor.
    pub measured_normals: bool,
    /// Opacity below which a surfel is pruned after a keyframe.
    pub prune: f64,
    /// Number of surfels above which a new map begins.
    pub most_surfels: usize,
    /// Number of keyframes after which a new map begins.
    pub most_keyframes: usize,
    /// Seed of all random numbers.
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
    /// The published settings: surfels first face the sensor, their normals follow the normals of drawn ranges, and
    /// they are at most 0.1 m large.
    pub fn published() -> Self {
        let loss = LossWeights { range: RangeMean::Image, opacity: 0.4, normal: 0.5, target: NormalTarget::Drawn };
        Self { scale_limit: 0.1, loss, measured_normals: false, ..Self::default() }
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// [`Error::Settings`], which names the first invalid one.
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

/// Rules of tracking and of the choice of keyframes.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackSettings {
    /// Steps of the geometric stage.
    pub geometric_steps: usize,
    /// Steps of the range stage; 0 leaves it out.
    pub range_steps: usize,
    /// Least share of a scan that fits the map, below which it becomes a keyframe.
    pub least_fitness: f64,
    /// Least share of a scan that fits the map, below which it is lost.
    pub lost_fitness: f64,
    /// Largest distance from the last keyframe, above which a scan becomes a keyframe, meters.
    pub farthest: f64,
    /// Number of other scans after which a scan becomes a keyframe.
    pub most_frames: usize,
    /// True if points are moved to the sensor's position at the beginning of the sweep, by their times and the motion
    /// of the previous sweep.
    pub deskew: bool,
    /// Rules of loop closures; `None` without them.
    pub loops: Option<LoopSettings>,
    /// Number of consecutive lost scans after which tracking ends.
    pub lost: usize,
}

impl Default for TrackSettings {
    fn default() -> Self {
        Self {
            geometric_steps: 10,
            range_steps: 10,
            least_fitness: 0.3,
            // Correctly tracked real scans have 0.19 and more, scans of another place 0.02.
            lost_fitness: 0.1,
            farthest: 5.0,
            most_frames: usize::MAX,
            deskew: false,
            loops: None,
            lost: 3,
        }
    }
}

/// Conditions of a loop closure between two keyframes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopSettings {
    /// Largest distance between the two by their estimated poses, meters.
    pub reach: f64,
    /// Least number of keyframes between the two.
    pub gap: usize,
    /// Share of the scan that must fit.
    pub least_fitness: f64,
}

impl Default for LoopSettings {
    fn default() -> Self {
        Self { reach: 3.0, gap: 10, least_fitness: 0.6 }
    }
}
