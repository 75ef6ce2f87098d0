//! Cameras from photos: photometric bundle adjustment of all cameras, the focal length and the depths of points at once.
//!
//! A camera that steps toward the scene, and the scene toward all cameras, in turn, lessen an error that neighbors share only
//! over dozens of rounds, for the scene lies where the cameras are in the mean. Here the scene gives nothing but first depths:
//! what photos show of a point must agree, and all cameras that see it move together.
//!
//! Sources: Alismail et al., Photometric Bundle Adjustment for Vision-Based SLAM, 2016; Engel et al., Direct Sparse
//! Odometry, 2016.

mod equations;
mod pictures;
mod points;
mod prior;

use crate::FitError;
use crate::cameras::{TWIST, moved};
use crate::fit::Fit;
use crate::photos::at_level;
use equations::System;
use pictures::Picture;
use prior::Prior;
use weaver_geometry::Pose;
use weaver_splat::Rasterizer;

/// Steps of Levenberg and Marquardt.
const STEPS: usize = 12;
/// Damping of the first step, over the diagonal; the least; what a success divides it by, and a failure multiplies it by.
const DAMPING: [f64; 4] = [1e-4, 1e-7, 5.0, 8.0];
/// Opacity below which there is no depth.
const OPAQUE: f32 = 0.5;

/// All that is adjusted but depths: poses, and the logarithm of a factor of all focal lengths.
#[derive(Clone, Debug, PartialEq)]
struct Cameras {
    poses: Vec<Pose>,
    focal: f64,
}

impl<R: Rasterizer<f32>> Fit<R> {
    /// Adjusts all cameras to photos that are halved this often, with depths of the scene as it is.
    ///
    /// The matrix has six rows a camera and is dense: for some hundreds of cameras.
    pub(crate) fn adjust(&mut self, level: usize) -> Result<(), FitError> {
        let mut depths = Vec::with_capacity(self.photos());
        for i in 0..self.photos() {
            let (_, level) = self.pyramids()[i].level(level);
            let [_, alpha, mut depth] = self.draw(&at_level(&self.camera(i), level))?;
            depth.iter_mut().zip(alpha).for_each(|(z, a)| *z = if a > OPAQUE { *z / a } else { 0.0 });
            depths.push(depth);
        }
        let pictures: Vec<Picture<'_>> = self
            .pyramids()
            .iter()
            .zip(depths)
            .map(|(pyramid, depth)| Picture::new(pyramid.level(level).0, depth))
            .collect();
        let start = Cameras { poses: self.poses.clone(), focal: self.focal };
        let prior = Prior::new(&pictures, (0..self.photos()).map(|i| self.photo(i).camera.pose).collect());
        let found = adjusted(&pictures, &prior, start, self.settings.poses.focal);
        (self.poses, self.focal) = (found.poses, found.focal);
        Ok(())
    }
}

/// The cameras of the smallest cost that is found.
fn adjusted(pictures: &[Picture<'_>], prior: &Prior, start: Cameras, focal: bool) -> Cameras {
    let mut points = points::choose(pictures, &start);
    let mut cameras = start;
    let [mut damping, least, less, more] = DAMPING;
    let mut system = System::new(pictures, prior, &points, &cameras, focal);
    for _ in 0..STEPS {
        let Some((twists, by_focal)) = system.solve(damping) else {
            damping *= more;
            continue;
        };
        let next_cameras = Cameras {
            poses: cameras.poses.iter().zip(&twists).map(|(pose, twist)| moved(pose, *twist, 1.0)).collect(),
            focal: cameras.focal + by_focal,
        };
        let next_points = system.deeper(&points, &twists, by_focal);
        let next = System::new(pictures, prior, &next_points, &next_cameras, focal);
        if next.cost < system.cost {
            (cameras, points, system) = (next_cameras, next_points, next);
            damping = (damping / less).max(least);
        } else {
            damping *= more;
        }
    }
    cameras
}
