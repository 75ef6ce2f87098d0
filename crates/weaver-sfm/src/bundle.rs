//! Bundle adjustment: cameras, lenses and points that explain where points were seen.

mod equations;

use equations::System;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::{Camera, Pose, se3};

/// Numbers of a camera's movement: translation, then rotation.
pub(crate) const TWIST: usize = 6;
/// Numbers of a lens: focal length, distortion, principal point.
pub(crate) const LENS: usize = 4;
/// Damping of the first step over the diagonal; what a success divides it by, and a failure multiplies it by; the largest.
const DAMPING: [f64; 4] = [1e-3, 4.0, 6.0, 1e9];
/// Relative fall of the cost below which nothing more is expected.
const CONVERGED: f64 = 1e-6;

/// What several cameras share.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lens {
    /// Logarithm of a factor of the focal lengths.
    pub log_focal: f64,
    /// Radial distortion: a point at distance r from the axis, over its depth, is seen at `r (1 + k1 r^2)`.
    pub k1: f64,
    /// How far the principal point is from the cameras' own, over the longer sides of their photos.
    pub shift: DVec2,
    /// What [`log_focal`](Self::log_focal) is expected to be.
    pub expected: f64,
    /// Weight of the square of the difference from that, squared pixels.
    pub weight: f64,
    /// Weight of the square of the [`shift`](Self::shift), squared pixels.
    pub shift_weight: f64,
    /// Whether the factor is adjusted.
    pub free_focal: bool,
    /// Whether the distortion is adjusted.
    pub free_k1: bool,
    /// Whether the principal point is adjusted.
    pub free_shift: bool,
}

impl Lens {
    /// Where a camera with this lens sees a point of camera coordinates.
    pub fn project(&self, camera: &Camera, p: DVec3) -> DVec2 {
        let k = &camera.intrinsics;
        let at = DVec2::new(p.x, p.y) / p.z;
        let scale = self.log_focal.exp() * (1.0 + self.k1 * at.length_squared());
        DVec2::new(k.fx * at.x, k.fy * at.y) * scale + self.center(camera)
    }

    /// The principal point of a camera with this lens, pixels.
    pub(crate) fn center(&self, camera: &Camera) -> DVec2 {
        DVec2::new(camera.intrinsics.cx, camera.intrinsics.cy) + self.shift * longer(camera)
    }

    /// The same lens, that nothing adjusts.
    pub(crate) fn held(self) -> Self {
        Self { free_focal: false, free_k1: false, free_shift: false, ..self }
    }
}

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
    /// Where, pixels.
    pub pixel: DVec2,
    /// How exact that is over the others: differences are divided by it.
    pub deviation: f64,
}

/// Cameras, lenses and points, with where points were seen.
///
/// [`Bundle::adjust`] minimizes `sum c^2 log(1 + |pi(p) - u|^2 / (c d)^2) + sum w x^2 + sum v (ln s - e)^2 + sum u |h|^2` over poses, points and, where asked, lenses:
/// pi(p) is where a point is seen by its camera, u where it was, d its [deviation](Observation::deviation), c (`scale` of `adjust`) the
/// difference, in deviations, beyond which an observation counts for less and less; x are the movements of cameras from where they were [expected](Self::expected); s is the factor of focal lengths of a [`Lens`], e its expected logarithm and v the weight; h is the shift of its principal point and u the weight.
#[derive(Clone, Debug, Default)]
pub struct Bundle {
    /// The cameras, one a photo.
    pub cameras: Vec<Camera>,
    /// The lenses.
    pub lenses: Vec<Lens>,
    /// The number of each camera's lens.
    pub lens_of: Vec<usize>,
    /// Which cameras stay where they are.
    pub fixed: Vec<bool>,
    /// Where cameras are expected, and the weights of twists from there, squared pixels; empty if nowhere.
    pub expected: Vec<(Pose, [f64; TWIST])>,
    /// The points, world units.
    pub points: Vec<DVec3>,
    /// Whether points stay where they are.
    pub fixed_points: bool,
    /// Where they were seen, ascending by point.
    pub observations: Vec<Observation>,
}

/// How an adjustment ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solved {
    /// The cost.
    pub cost: f64,
    /// Steps that lowered it.
    pub steps: usize,
}

impl Bundle {
    /// At most this many steps of Levenberg and Marquardt, points eliminated by the Schur complement. The same bits at any
    /// number of threads. The matrix of the cameras is dense: for some hundreds of them.
    ///
    /// Source: Triggs et al., Bundle adjustment, a modern synthesis, 1999, section 6.
    ///
    /// # Panics
    /// If numbers of cameras, lenses or points are out of range, or observations are not ascending by point.
    pub fn adjust(&mut self, scale: f64, most_steps: usize) -> Solved {
        assert!(self.observations.is_sorted_by_key(|o| o.point), "observations are not ascending by point");
        let [mut damping, less, more, largest] = DAMPING;
        let mut system = System::new(self, scale);
        let mut steps = 0;
        let mut tries = 0;
        while tries < most_steps && damping < largest {
            tries += 1;
            let Some(step) = system.solve(damping) else {
                damping *= more;
                continue;
            };
            let next = self.moved(&system, &step, damping);
            let next_system = System::new(&next, scale);
            if next_system.cost < system.cost {
                let converged = system.cost - next_system.cost < CONVERGED * system.cost;
                (*self, system) = (next, next_system);
                damping = (damping / less).max(1e-12);
                steps += 1;
                if converged {
                    break;
                }
            } else {
                damping *= more;
            }
        }
        Solved { cost: system.cost, steps }
    }

    fn moved(&self, system: &System, step: &[f64], damping: f64) -> Self {
        let mut next = self.clone();
        for (camera, twist) in next.cameras.iter_mut().zip(step.as_chunks::<TWIST>().0) {
            let [a, b, c, d, e, f] = *twist;
            camera.pose = se3::exp(DVec3::new(a, b, c), DVec3::new(d, e, f)).compose(&camera.pose);
        }
        for (lens, by) in next.lenses.iter_mut().zip(step[TWIST * self.cameras.len()..].as_chunks::<LENS>().0) {
            let [focal, k1, x, y] = *by;
            lens.log_focal += focal;
            lens.k1 += k1;
            lens.shift += DVec2::new(x, y);
        }
        system.move_points(&mut next.points, step, damping);
        next
    }

    /// The difference of every observation from where its point is seen, pixels; infinite behind the camera.
    pub fn errors(&self) -> Vec<f64> {
        let error = |o: &Observation| {
            let camera = &self.cameras[o.camera];
            let p = camera.pose.apply(self.points[o.point]);
            let lens = &self.lenses[self.lens_of[o.camera]];
            if p.z > 0.0 { lens.project(camera, p).distance(o.pixel) } else { f64::INFINITY }
        };
        self.observations.iter().map(error).collect()
    }

    /// How well every observation fits: 1 where it is exact, 0 from so many of its deviations on.
    pub(crate) fn fits(&self, within: f64) -> Vec<f64> {
        let each = self.errors().into_iter().zip(&self.observations);
        each.map(|(error, o)| (1.0 - (error / (within * o.deviation)).powi(2)).max(0.0)).collect()
    }

    /// Leaves out observations that are off by more pixels than this.
    pub fn leave_out(&mut self, farthest: f64) {
        let errors = self.errors();
        let mut errors = errors.iter();
        self.observations.retain(|o| errors.next().is_some_and(|e| *e <= farthest * o.deviation));
    }

    /// Leaves out observations that are off by more pixels than this, then points that fewer than two cameras see.
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

    /// Of each point, whether at least two cameras see it.
    pub(crate) fn agreed(&self) -> Vec<bool> {
        let mut seen = vec![0; self.points.len()];
        self.observations.iter().for_each(|o| seen[o.point] += 1);
        seen.into_iter().map(|n| n > 1).collect()
    }

    /// How many points each camera sees.
    pub(crate) fn seen(&self) -> Vec<usize> {
        let mut seen = vec![0; self.cameras.len()];
        self.observations.iter().for_each(|o| seen[o.camera] += 1);
        seen
    }

    /// The median difference of observations from where their points are seen, pixels; not a number without observations.
    pub(crate) fn median_error(&self) -> f64 {
        let mut errors = self.errors();
        errors.sort_unstable_by(f64::total_cmp);
        errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN)
    }

    /// A camera with its lens's focal length and principal point.
    pub fn camera(&self, number: usize) -> Camera {
        let mut camera = self.cameras[number];
        let lens = &self.lenses[self.lens_of[number]];
        let (factor, center) = (lens.log_focal.exp(), lens.center(&camera));
        let k = &mut camera.intrinsics;
        (k.fx, k.fy, k.cx, k.cy) = (k.fx * factor, k.fy * factor, center.x, center.y);
        camera
    }
}
