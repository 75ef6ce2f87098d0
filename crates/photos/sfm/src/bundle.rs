//! Bundle adjustment: cameras, lenses and points that fit observations.

mod covariance;
mod dense;
mod descent;
mod lens;
mod linear;
mod profile;
mod reduced;
mod rig;
mod some;
mod sparse;
mod structure;
mod sums;
mod system;
#[cfg(test)]
mod tests;

pub use covariance::Covariance;
use descent::{Descent, Limits};
pub use lens::Lens;
pub use rig::Mounted;
pub(crate) use some::LARGE;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::{Camera, Pose};
use weaver_kernels::order::median_high;

/// Numbers of a camera's movement: translation, then rotation.
pub(crate) const TWIST: usize = 6;

/// The longer side of a camera's photo, pixels.
pub(crate) fn longer(camera: &Camera) -> f64 {
    camera.width.max(camera.height) as f64
}

/// A point seen in a photo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Number of the camera.
    pub camera: usize,
    /// Number of the point.
    pub point: usize,
    /// The observed pixel.
    pub pixel: DVec2,
    /// Standard deviation relative to the others': residuals are divided by it.
    pub deviation: f64,
}

/// Cameras, lenses and points, with the observations of points.
///
/// [`Bundle::adjust`] minimizes `sum c^2 log(1 + |pi(p) - u|^2 / (c d)^2) + sum w x^2 + sum v (ln s - e)^2 + sum b
/// (k1^2 + k2^2) + sum a |h|^2` over poses, points and free lenses. The first sum is over observations: pi(p) is the
/// projection of the point, u the observed pixel, d the [deviation](Observation::deviation), and c (`scale` of
/// `adjust`) the residual, in deviations, beyond which an observation counts for less and less. The others are priors:
/// x is each number of the twist of a camera from its [expected](Self::expected) pose, and w its weight; s is the
/// factor on focal lengths of a [`Lens`], e its expected logarithm and v its weight; k1 and k2 are the distortion and b
/// its weight; h is the shift of the principal point and a its weight.
#[derive(Clone, Debug, Default)]
pub struct Bundle {
    /// The cameras, one a photo.
    pub cameras: Vec<Camera>,
    /// The lenses.
    pub lenses: Vec<Lens>,
    /// The number of each camera's lens.
    pub lens_of: Vec<usize>,
    /// The place of each camera in a rig, whose cameras follow one another, have one lens and move together; empty if
    /// each stands alone. A camera that stands alone is mounted on itself.
    pub rig: Vec<Mounted>,
    /// True for cameras that stay where they are; of a rig, the first one decides.
    pub fixed: Vec<bool>,
    /// Expected poses of cameras, and the weights of twists from them, squared pixels; empty if there are none. Of a
    /// rig, the first camera's counts.
    pub expected: Vec<(Pose, [f64; TWIST])>,
    /// The points, world units.
    pub points: Vec<DVec3>,
    /// True if points stay where they are.
    pub fixed_points: bool,
    /// Their observations, ascending by point.
    pub observations: Vec<Observation>,
}

/// Result of an adjustment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solved {
    /// The cost.
    pub cost: f64,
    /// Steps that lowered it.
    pub steps: usize,
    /// True if no further step would have lowered it by much; `false` if there were not enough steps, or none was
    /// possible.
    pub converged: bool,
}

impl Bundle {
    /// At most this many steps of Levenberg and Marquardt, points eliminated by the Schur complement. The same bits at
    /// any number of threads.
    ///
    /// Only cameras that are not fixed, and lenses that are free, take part: a few free cameras among many fixed ones
    /// cost as much as they would alone. Up to 200 of them, the reduced matrix is dense and solved directly; beyond, it
    /// has blocks only for cameras with points in common. If these can be numbered near each other, as along a walk, it
    /// is solved directly, too, and up to 700 as if it were dense where that is faster; else by conjugate gradients. A
    /// fall of the cost by less than 1e-7 ends it, or a step in which all cameras and lenses together move by less than
    /// a hundredth of their standard deviation: points without depth would go on for long without any effect on
    /// cameras.
    ///
    /// Sources: Triggs et al., Bundle adjustment, a modern synthesis, 1999, section 6; Agarwal et al., Bundle
    /// adjustment in the large, 2010; Nielsen, Damping parameter in Marquardt's method, 1999.
    ///
    /// # Panics
    /// If numbers of cameras, lenses or points are out of range, or observations are not ascending by point.
    pub fn adjust(&mut self, scale: f64, most_steps: usize) -> Solved {
        self.adjust_within(scale, most_steps, &Limits::USUAL)
    }

    /// The same until a step moves all cameras and lenses together by less than a tenth of a standard deviation.
    pub(crate) fn adjust_nearly(&mut self, scale: f64, most_steps: usize) {
        self.adjust_within(scale, most_steps, &Limits::NEAR);
    }

    /// The same until a step moves cameras and lenses by less than a third of their standard deviation, which leaves
    /// them within one deviation of the minimum: for bundles that are adjusted again later. Many cameras are adjusted
    /// by [some](Self::some) of the observations alone, and all points then follow.
    pub(crate) fn adjust_roughly(&mut self, scale: f64, most_steps: usize) {
        let Some(some) = self.some() else {
            self.adjust_within(scale, most_steps, &Limits::ROUGH);
            return;
        };
        let all = std::mem::replace(&mut self.observations, some);
        self.adjust_within(scale, most_steps, &Limits::ROUGH);
        self.observations = all;
        let (fixed, lenses) = (self.fixed.clone(), self.lenses.clone());
        self.fixed.fill(true);
        self.lenses.iter_mut().for_each(|lens| *lens = lens.held());
        self.adjust_within(scale, most_steps, &Limits::ROUGH);
        (self.fixed, self.lenses) = (fixed, lenses);
    }

    /// Adjusts to the end or, where there is [plenty](Self::has_plenty), roughly.
    pub(crate) fn adjust_as_needed(&mut self, scale: f64, most_steps: usize) {
        if self.has_plenty() {
            self.adjust_roughly(scale, most_steps);
        } else {
            self.adjust(scale, most_steps);
        }
    }

    fn adjust_within(&mut self, scale: f64, most_steps: usize, limits: &Limits) -> Solved {
        assert!(self.observations.is_sorted_by_key(|o| o.point), "observations are not ascending by point");
        let mut descent = Descent::new(self, scale, limits);
        let solved = descent.run(most_steps);
        let Descent { state, parts, .. } = descent;
        for (camera, pose) in self.cameras.iter_mut().zip(state.poses) {
            camera.pose = pose;
        }
        self.lenses = state.lenses;
        for part in &parts {
            part.numbers.iter().zip(&part.points).for_each(|(number, point)| self.points[*number as usize] = *point);
        }
        solved
    }

    /// The residual of every observation, pixels; infinite behind the camera.
    pub fn errors(&self) -> Vec<f64> {
        let error = |o: &Observation| {
            let camera = &self.cameras[o.camera];
            let p = camera.pose.apply(self.points[o.point]);
            let lens = &self.lenses[self.lens_of[o.camera]];
            if p.z > 0.0 { lens.project(camera, p).distance(o.pixel) } else { f64::INFINITY }
        };
        self.observations.iter().map(error).collect()
    }

    /// Weight of every observation: 1 for a residual of 0, 0 from `within` deviations on.
    pub(crate) fn fits(&self, within: f64) -> Vec<f64> {
        let each = self.errors().into_iter().zip(&self.observations);
        each.map(|(error, o)| (1.0 - (error / (within * o.deviation)).powi(2)).max(0.0)).collect()
    }

    /// Leaves out observations with larger residuals than this, in deviations.
    pub fn leave_out(&mut self, farthest: f64) {
        let errors = self.errors();
        let mut errors = errors.iter();
        self.observations.retain(|o| errors.next().is_some_and(|e| *e <= farthest * o.deviation));
    }

    /// Leaves out observations with larger residuals than this, in deviations, then points that fewer than two cameras
    /// see.
    pub fn prune(&mut self, farthest: f64) {
        self.leave_out(farthest);
        let agreed = self.agreed();
        self.observations.retain(|o| agreed[o.point]);
        let mut number = 0;
        let numbers: Vec<usize> = (agreed.iter())
            .map(|agreed| {
                let this = number;
                number += usize::from(*agreed);
                this
            })
            .collect();
        let mut kept = agreed.iter();
        self.points.retain(|_| kept.next() == Some(&true));
        self.observations.iter_mut().for_each(|o| o.point = numbers[o.point]);
    }

    /// True for points that at least two cameras see, which are not of one rig.
    pub(crate) fn agreed(&self) -> Vec<bool> {
        let mut agreed = vec![false; self.points.len()];
        for seen in self.observations.chunk_by(|a, b| a.point == b.point) {
            let first = self.mounted(seen[0].camera).on;
            agreed[seen[0].point] = seen.iter().any(|o| self.mounted(o.camera).on != first);
        }
        agreed
    }

    /// Number of points that each camera sees.
    pub(crate) fn seen(&self) -> Vec<usize> {
        let mut seen = vec![0; self.cameras.len()];
        self.observations.iter().for_each(|o| seen[o.camera] += 1);
        seen
    }

    /// The median residual, pixels; not a number without observations.
    pub(crate) fn median_error(&self) -> f64 {
        median_high(&mut self.errors()).unwrap_or(f64::NAN)
    }

    /// A camera with its lens's focal length and principal point.
    pub fn camera(&self, number: usize) -> Camera {
        let mut camera = self.cameras[number];
        let lens = &self.lenses[self.lens_of[number]];
        let factor = lens.log_focal.exp();
        let center = lens.center(&camera);
        let k = &mut camera.intrinsics;
        (k.fx, k.fy, k.cx, k.cy) = (k.fx * factor, k.fy * factor, center.x, center.y);
        camera
    }
}
