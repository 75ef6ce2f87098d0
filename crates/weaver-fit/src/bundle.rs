//! Cameras from photos alone: photometric bundle adjustment of all cameras, the focal length and the depths of points.
//!
//! Stepping each camera toward the scene and the scene toward all cameras in turn halves an error that neighbors share only
//! in dozens of rounds, for the scene lies where the cameras are in the mean. Here the scene gives nothing but first depths:
//! what two photos show of a point must agree, and all cameras that see it move at once.
//!
//! Sources: Alismail et al., Photometric Bundle Adjustment for Vision-Based SLAM, 2016; Engel et al., Direct Sparse
//! Odometry, 2016, for inverse... patches and the elimination of depths.

mod equations;
mod points;
mod pictures;

use equations::System;
pub(crate) use pictures::Picture;
use points::Point;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Pose, se3};

/// Numbers of a camera: translation and rotation of a twist.
const TWIST: usize = 6;

/// All that is adjusted: poses, and the logarithm of a factor of all focal lengths.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Cameras {
    pub poses: Vec<Pose>,
    pub focal: f64,
}

/// Adjusts cameras to their pictures by this many steps of Levenberg and Marquardt; `depths` are those of the scene now.
///
/// The focal length stays as it is unless asked for. Returns the cameras with the smallest cost found.
pub(crate) fn adjust(pictures: &[Picture<'_>], start: Cameras, focal: bool, steps: usize) -> Cameras {
    let mut points = points::choose(pictures, &start);
    let mut cameras = start;
    let mut damping = 1e-4;
    let mut system = System::new(pictures, &points, &cameras, focal);
    for _ in 0..steps {
        let Some((twists, by_focal)) = system.solve(damping) else {
            damping = f64::max(10.0 * damping, 1e-4);
            continue;
        };
        let moved = Cameras {
            poses: cameras.poses.iter().zip(&twists).map(|(pose, twist)| moved(pose, *twist)).collect(),
            focal: cameras.focal + by_focal,
        };
        let deeper: Vec<Point> = system.depths(&points, &twists, by_focal);
        let next = System::new(pictures, &deeper, &moved, focal);
        if std::env::var_os("TRACE").is_some() { println!("  cost {:.5} -> {:.5} damping {damping:.1e} focal {:.4} points {}", system.cost, next.cost, moved.focal, points.len()); }
        if next.cost < system.cost {
            (cameras, points, system) = (moved, deeper, next);
            damping = (damping / 5.0).max(1e-7);
        } else {
            damping *= 8.0;
        }
    }
    cameras
}

pub(crate) fn knob(name: &str, default: f64) -> f64 {
    std::env::var(name).ok().and_then(|x| x.parse().ok()).unwrap_or(default)
}

fn moved(pose: &Pose, [a, b, c, d, e, f]: [f64; TWIST]) -> Pose {
    se3::exp(DVec3::new(a, b, c), DVec3::new(d, e, f)).compose(pose)
}
