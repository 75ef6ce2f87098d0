//! Finding where a photo was taken in a scene that stays as it is.

use crate::FitError;
use crate::bundle::{self, Cameras, Picture};
use crate::cameras::{Alignment, Views, moved};
use crate::fit::Fit;
use crate::photos::{Photo, Pyramid, at_level};
use weaver_geometry::Camera;
use weaver_splat::Rasterizer;

/// Halvings of the photo at the beginning.
const HALVINGS: usize = 2;

impl<R: Rasterizer<f32>> Fit<R> {
    /// The camera near `start` from which the scene looks most like the photo, after this many Gauss-Newton steps; they begin
    /// at a quarter of the photo's size and end at its own. Nothing in the fit changes.
    ///
    /// # Errors
    /// When the rasterizer refuses.
    pub fn locate(&mut self, photo: &Photo, start: Camera, steps: usize) -> Result<Camera, FitError> {
        let pyramid = Pyramid::new(photo.clone(), HALVINGS);
        let mut camera = start;
        for step in 0..steps {
            let (photo, level) = pyramid.level(HALVINGS - step * (HALVINGS + 1) / steps);
            let seen = at_level(&camera, level);
            let [image, alpha, depth] = self.draw(&seen)?;
            let target: Vec<f32> = photo.rgb.iter().map(|b| f32::from(*b) / 255.0).collect();
            let views = Views { image: &image, alpha: &alpha, depth: &depth, photo: &target, mask: photo.mask.as_deref() };
            let Some(twist) = Alignment::new(&seen, &views).twist() else { break };
            camera.pose = moved(&camera.pose, twist, 1.0);
        }
        Ok(camera)
    }
}

impl<R: Rasterizer<f32>> Fit<R> {
    /// Adjusts all cameras to each other; see [`crate::bundle`].
    pub(crate) fn bundle(&mut self, level: usize, steps: usize) -> Result<(), FitError> {
        let mut depths = Vec::with_capacity(self.photos());
        for i in 0..self.photos() {
            let level = self.pyramids()[i].level(level).1;
            let [_, alpha, mut depth] = self.draw(&at_level(&self.camera(i), level))?;
            depth.iter_mut().zip(alpha).for_each(|(z, a)| *z = if a > 0.5 { *z / a } else { 0.0 });
            depths.push(depth);
        }
        let pictures: Vec<Picture<'_>> = (self.pyramids().iter().zip(depths))
            .map(|(pyramid, depth)| {
                let (photo, _) = pyramid.level(level);
                Picture::new(photo, photo.camera, depth)
            })
            .collect();
        let start = Cameras { poses: self.poses.clone(), focal: self.focal.log };
        let found = bundle::adjust(&pictures, start, self.settings.poses.focal, steps);
        self.poses = found.poses;
        self.focal.log = found.focal;
        Ok(())
    }
}
