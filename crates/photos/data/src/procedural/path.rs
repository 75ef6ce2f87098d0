//! Where the cameras stand: a smooth arc around the objects, with mild jitter, looking at them or straight ahead.

use super::ProceduralOptions;
use super::draws::Draws;
use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose};

/// Angle along the default arc between neighboring cameras, degrees.
const STEP: f64 = 4.0;
/// The longest default arc, degrees: beyond it cameras stand closer together instead.
const LONGEST: f64 = 120.0;
/// No camera is lower, scene units.
const LOWEST: f64 = 0.3;

/// A lens, and how it is carried past the objects; angles in radians, lengths in scene units.
#[derive(Clone, Copy, Debug)]
pub(super) struct Path {
    /// View angle across the width.
    pub fov: f64,
    /// Azimuth of the middle of the arc.
    pub middle: f64,
    /// Angle along the arc between neighboring cameras.
    pub step: f64,
    /// Distance of the arc from the z axis.
    pub radius: f64,
    /// Height of the cameras.
    pub rise: f64,
    /// Swing of radius and height about these values.
    pub sway: f64,
    /// Phase at the beginning of the swing.
    pub phase: f64,
    /// Phase of the swing from one camera to the next.
    pub wave: f64,
    /// Point that the cameras look at.
    pub focus: DVec3,
    /// Movement of the aim along with the camera: 0 always looks at the focus, 1 always in the same direction.
    pub drift: f64,
    /// Jitter of the camera's place, of its aim, and of its roll.
    pub jitter: [f64; 3],
    /// Turn about the optical axis.
    pub roll: f64,
}

impl Path {
    /// The path of the default scenes: an upright camera of about 60 degrees on the -y side.
    pub fn around(views: usize, draws: &mut Draws) -> Self {
        let fov = draws.within(56.0, 64.0_f64).to_radians();
        let step = STEP.min(LONGEST / gaps(views).max(1.0)).to_radians();
        let middle = -std::f64::consts::FRAC_PI_2 + draws.within(-0.2, 0.2);
        let (radius, rise) = (draws.within(3.4, 4.0), draws.within(1.0, 1.8));
        let (sway, phase) = (draws.within(0.1, 0.3), draws.within(0.0, std::f64::consts::TAU));
        let focus = DVec3::new(draws.within(-0.2, 0.2), draws.within(-0.2, 0.2), draws.within(0.4, 0.7));
        let jitter = [0.05, 0.08, 0.0];
        Self { fov, middle, step, radius, rise, sway, phase, wave: 0.6, focus, drift: 0.0, jitter, roll: 0.0 }
    }

    /// A path of a varied scene: view angle 30 to 75 degrees, 8 to 90 degrees from the first camera to the last, from
    /// any side, with roll; one in three looks straight ahead.
    pub fn varied(views: usize, draws: &mut Draws) -> Self {
        let fov = draws.within(30.0, 75.0_f64).to_radians();
        let ahead = draws.chance(0.35);
        let (drift, widest) = if ahead { (draws.within(0.6, 1.0), 0.7 * fov.to_degrees()) } else { (0.0, 90.0) };
        let spread = draws.within(8.0, widest).to_radians();
        // Half the width of the view at the focus: a long lens stands farther away.
        let size = draws.within(1.0, 2.2);
        let distance = size / (fov / 2.0).tan();
        let elevation = (4.0 + if ahead { 20.0 } else { 45.0 } * draws.within(0.0, 1.0).powi(2)).to_radians();
        let focus = DVec3::new(draws.within(-0.4, 0.4), draws.within(-0.4, 0.4), draws.within(0.2, 1.0));
        let tilt = draws.within(-0.15, 0.15) + draws.within(-0.15, 0.15);
        Self {
            fov,
            middle: draws.within(0.0, std::f64::consts::TAU),
            step: spread / gaps(views).max(1.0),
            radius: distance * elevation.cos(),
            rise: focus.z + distance * elevation.sin(),
            sway: distance * draws.within(0.02, 0.12),
            phase: draws.within(0.0, std::f64::consts::TAU),
            wave: draws.within(0.3, 2.0),
            focus,
            drift,
            jitter: [0.02 * distance, 0.08 * size, 0.05],
            roll: tilt,
        }
    }

    /// The cameras along the path, in order.
    pub fn cameras(&self, options: &ProceduralOptions, draws: &mut Draws) -> Vec<Camera> {
        let ProceduralOptions { width, height, views } = *options;
        let focal = width as f64 / 2.0 / (self.fov / 2.0).tan();
        let intrinsics = Intrinsics { fx: focal, fy: focal, cx: width as f64 / 2.0, cy: height as f64 / 2.0 };
        let middle = DVec2::from_angle(self.middle).extend(0.0) * self.radius + DVec3::Z * self.rise;
        let [place, aim, roll] = self.jitter;
        (0..views)
            .map(|i| {
                let along = i as f64 - gaps(views) / 2.0;
                let wave = self.phase + along * self.wave;
                let flat = DVec2::from_angle(self.middle + along * self.step) * (self.radius + self.sway * wave.cos());
                let mut eye = flat.extend(self.rise + self.sway * wave.sin()) + jitter(draws, place);
                eye.z = eye.z.max(LOWEST);
                let target = self.focus + self.drift * (eye - middle) + jitter(draws, aim);
                let turn = self.roll + if roll > 0.0 { draws.within(-roll, roll) } else { 0.0 };
                Camera { pose: look_at(eye, target, turn), intrinsics, width, height }
            })
            .collect()
    }
}

/// Steps from the first view to the last.
fn gaps(views: usize) -> f64 {
    views.saturating_sub(1) as f64
}

fn jitter(draws: &mut Draws, size: f64) -> DVec3 {
    DVec3::new(draws.within(-size, size), draws.within(-size, size), draws.within(-size, size))
}

/// The camera at `eye` that looks at `target`, turned about its axis from upright; the world's z axis is up.
pub(super) fn look_at(eye: DVec3, target: DVec3, roll: f64) -> Pose {
    let forward = (target - eye).normalize();
    let level = forward.cross(DVec3::Z).normalize();
    let plumb = forward.cross(level);
    let (sin, cos) = roll.sin_cos();
    let (right, down) = (level * cos + plumb * sin, plumb * cos - level * sin);
    let rotation = DMat3::from_cols(right, down, forward).transpose();
    Pose::new(rotation, -(rotation * eye))
}
