//! Cameras around a scene.

use crate::Gaussians;
use std::f64::consts::FRAC_PI_3;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, trajectory};

/// Cameras on a circle around a scene, -y up, with a horizontal field of view of 60 degrees and pictures of `[width,
/// height]` pixels; `None` of a scene without Gaussians.
///
/// The circle is about the [`middle`] of the scene, far enough to have most of the Gaussians inside the picture, and
/// never inside a single one.
///
/// ```
/// use weaver_scene::{Gaussians, orbit};
///
/// let gaussians = Gaussians { means: vec![[0.0, 0.0, 2.0]], log_scales: vec![[-1.0; 3]], ..Gaussians::default() };
/// let cameras = orbit(&gaussians, 4, [64, 48]).unwrap();
/// assert!(cameras.iter().all(|camera| camera.pose.apply([0.0, 0.0, 2.0].into()).z > 0.0));
/// assert_eq!(orbit(&Gaussians::default(), 4, [64, 48]), None);
/// ```
pub fn orbit(gaussians: &Gaussians, count: usize, [width, height]: [usize; 2]) -> Option<Vec<Camera>> {
    let middle = middle(gaussians)?;
    let means = gaussians.means.iter().map(|mean| DVec3::from(mean.map(f64::from)));
    let spread = quantile(0.8, means.map(|mean| mean.distance(middle)).collect())?;
    let scale = quantile(0.5, gaussians.log_scales.as_flattened().iter().map(|s| f64::from(*s).exp()).collect())?;
    let eye = middle - DVec3::Z * (2.0 * spread + 4.0 * scale);
    let focal = width as f64 / 2.0 / (FRAC_PI_3 / 2.0).tan();
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx: width as f64 / 2.0, cy: height as f64 / 2.0 };
    let poses = trajectory::orbit(eye, middle, -DVec3::Y, count);
    Some(poses.into_iter().map(|pose| Camera { pose, intrinsics, width, height }).collect())
}

/// The middle of a scene: on each axis halfway between the 10 % and 90 % quantiles, so that neither a dense floor nor
/// outliers shift it; `None` without Gaussians.
pub fn middle(gaussians: &Gaussians) -> Option<DVec3> {
    let axis = |axis: usize| {
        let tenth = |q| quantile(q, gaussians.means.iter().map(|mean| f64::from(mean[axis])).collect());
        Some((tenth(0.1)? + tenth(0.9)?) / 2.0)
    };
    Some(DVec3::new(axis(0)?, axis(1)?, axis(2)?))
}

/// The value below which a part `q` of the values lie.
fn quantile(q: f64, mut values: Vec<f64>) -> Option<f64> {
    let rank = (q * values.len() as f64) as usize;
    if values.is_empty() {
        return None;
    }
    Some(*values.select_nth_unstable_by(rank, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_orbit_looks_at_the_middle_from_all_sides() {
        let gaussians = Gaussians {
            means: vec![[0.0, -0.5, 1.0], [1.0, 0.0, 2.0], [-1.0, 0.5, 3.0]],
            log_scales: vec![[-2.0; 3]; 3],
            ..Gaussians::default()
        };
        let cameras = orbit(&gaussians, 4, [640, 480]).unwrap();
        let middle = DVec3::new(0.0, 0.0, 2.0);
        for camera in &cameras {
            let seen = camera.pose.apply(middle);
            assert!(seen.x.abs() < 1e-9 && seen.y.abs() < 1e-9 && seen.z > 1.0, "{seen}");
        }
        assert!(cameras[0].pose.center().z < 0.0);
    }

    #[test]
    fn a_single_gaussian_has_an_orbit_too() {
        let gaussians = Gaussians { means: vec![[0.0; 3]], log_scales: vec![[-1.0; 3]], ..Gaussians::default() };
        let cameras = orbit(&gaussians, 2, [40, 30]).unwrap();
        assert!(cameras.iter().all(|c| c.pose.translation.is_finite() && (c.width, c.height) == (40, 30)));
    }
}
