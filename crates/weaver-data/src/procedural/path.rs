//! Where the cameras stand: a smooth arc around the objects, with mild jitter, looking at them.

use super::draws::Draws;
use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose};

/// Angle along the arc between neighboring cameras, degrees.
const STEP: f64 = 4.0;
/// The longest arc, degrees: beyond it cameras stand closer together instead.
const LONGEST: f64 = 120.0;

/// `views` cameras of one lens, in order along the arc.
pub(super) fn cameras(width: usize, height: usize, views: usize, draws: &mut Draws) -> Vec<Camera> {
    let fov = draws.within(56.0, 64.0_f64).to_radians();
    let focal = width as f64 / 2.0 / (fov / 2.0).tan();
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx: width as f64 / 2.0, cy: height as f64 / 2.0 };
    let gaps = views.saturating_sub(1) as f64;
    let step = STEP.min(LONGEST / gaps.max(1.0)).to_radians();
    let middle = -std::f64::consts::FRAC_PI_2 + draws.within(-0.2, 0.2);
    let (radius, rise) = (draws.within(3.4, 4.0), draws.within(1.0, 1.8));
    let (sway, phase) = (draws.within(0.1, 0.3), draws.within(0.0, std::f64::consts::TAU));
    let focus = DVec3::new(draws.within(-0.2, 0.2), draws.within(-0.2, 0.2), draws.within(0.4, 0.7));
    (0..views)
        .map(|i| {
            let along = i as f64 - gaps / 2.0;
            let wave = phase + along * 0.6;
            let flat = DVec2::from_angle(middle + along * step) * (radius + sway * wave.cos());
            let eye = flat.extend(rise + sway * wave.sin()) + jitter(draws, 0.05);
            let pose = look_at(eye, focus + jitter(draws, 0.08));
            Camera { pose, intrinsics, width, height }
        })
        .collect()
}

fn jitter(draws: &mut Draws, size: f64) -> DVec3 {
    DVec3::new(draws.within(-size, size), draws.within(-size, size), draws.within(-size, size))
}

/// The upright camera at `eye` that looks at `target`; the world's z axis is up.
fn look_at(eye: DVec3, target: DVec3) -> Pose {
    let forward = (target - eye).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let down = forward.cross(right);
    let rotation = DMat3::from_cols(right, down, forward).transpose();
    Pose::new(rotation, -(rotation * eye))
}
