//! The scene as it is: drawn from a camera, and cameras of further photos of it.

use crate::cameras::{Alignment, Views, moved};
use crate::fit::Fit;
use crate::photos::{Pyramid, at_level};
use crate::transients::counted;
use crate::{Exposure, FitError, Judge};
use weaver_geometry::Camera;
use weaver_geometry::lens::LensCamera;
use weaver_scene::{CameraRows, CameraSlices, Model, Photo};
use weaver_splat::Images;

/// Halvings of the photo at the beginning: coarse pictures reach cameras that are farther off.
const HALVINGS: usize = 2;

/// Longest side of a photo for a first look, pixels.
const SMALL: usize = 160;

/// Photos whose corrections are averaged for a camera.
const NEIGHBORS: usize = 2;

impl Fit {
    /// The camera near `start` from which the scene looks most like the photo, after this many Gauss-Newton steps; they
    /// begin at a quarter of the photo's size and end at its own. Nothing in the fit changes.
    ///
    /// # Errors
    /// When the rasterizer refuses.
    pub fn locate(&mut self, photo: &Photo, start: Camera, steps: usize) -> Result<Camera, FitError> {
        let pyramid = Pyramid::new(photo.clone(), HALVINGS);
        let mut camera = start;
        for step in 0..steps {
            let (photo, level) = pyramid.level(HALVINGS - step * (HALVINGS + 1) / steps);
            let seen = at_level(&camera, level);
            let [image, alpha, depth] = self.draw(&seen, photo.model())?;
            let target: Vec<f32> = photo.rgb.iter().map(|b| f32::from(*b) / 255.0).collect();
            let views =
                Views { image: &image, alpha: &alpha, depth: &depth, photo: &target, mask: photo.mask.as_deref() };
            let seen = LensCamera::new(seen, photo.lens);
            let Some(twist) = Alignment::new(&seen, &views).twist() else { break };
            camera.pose = moved(&camera.pose, twist, 1.0);
        }
        Ok(camera)
    }

    /// The color correction of a photo that is taken from this camera, if photos have them: the mean of the two nearest
    /// photos', in inverse proportion to their distance. A camera meters its view, so that neighbors have similar
    /// exposures.
    ///
    /// The distance is the sum of the centers' distance over the size of the scene and the angle between the cameras,
    /// in radians.
    pub fn exposure_at(&self, camera: &Camera) -> Option<Exposure> {
        let distance = |photo: usize| {
            let other = self.camera(photo).pose;
            other.center().distance(camera.pose.center()) / self.extent() + other.angle_to(&camera.pose)
        };
        let mut near: Vec<(f64, &Exposure)> =
            self.exposures.iter().enumerate().map(|(photo, exposure)| (distance(photo), exposure)).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.truncate(NEIGHBORS);
        let weight = |distance: f64| 1.0 / (distance + 1e-6);
        let all: f64 = near.iter().map(|(distance, _)| weight(*distance)).sum();
        let weighted = near.iter().map(|(d, exposure)| ((weight(*d) / all) as f32, *exposure));
        (!near.is_empty()).then(|| Exposure::mean(weighted))
    }

    /// Draws the Gaussians from a camera: an image `[H, W, 3]`, values not clamped.
    ///
    /// # Errors
    /// When the rasterizer refuses.
    pub fn render(&mut self, camera: &Camera) -> Result<Vec<f32>, FitError> {
        self.render_through(Model::Pinhole, camera)
    }

    /// Draws as [`render`](Self::render) does, by a camera of any model.
    ///
    /// # Errors
    /// When the rasterizer refuses.
    pub fn render_through(&mut self, model: Model, camera: &Camera) -> Result<Vec<f32>, FitError> {
        self.draw(camera, model).map(|[image, ..]| image)
    }

    /// The PSNR of a photo at a glance, dB: of the pixels that count, halved until it has 160 pixels at most.
    ///
    /// # Errors
    /// When the rasterizer refuses.
    pub fn glance(&mut self, index: usize) -> Result<f64, FitError> {
        let (photo, camera) = self.small(index);
        let mut image = self.render_through(photo.model(), &camera)?;
        if let Some(exposure) = self.exposure(index) {
            let drawn = image.clone();
            exposure.apply(&drawn, &mut image);
        }
        let mask = counted(&photo, self.transients(index));
        Ok(Judge::psnr(&image, &photo.rgb, mask.as_deref()))
    }

    /// A photo, halved until it is small enough for a first look, and its camera as refined so far.
    pub(crate) fn small(&self, index: usize) -> (Photo, Camera) {
        let longest = |level: usize| {
            let Camera { width, height, .. } = at_level(&self.photo(index).camera, level);
            width.max(height)
        };
        let halvings = (0..).find(|level| longest(*level) <= SMALL).unwrap_or(0);
        let pyramid = Pyramid::new(self.photo(index).clone(), halvings);
        let (photo, halvings) = pyramid.level(halvings);
        (photo.clone(), at_level(&self.camera(index), halvings))
    }

    /// Image, alpha and depth from a camera.
    pub(crate) fn draw(&mut self, camera: &Camera, model: Model) -> Result<[Vec<f32>; 3], FitError> {
        let pixels = camera.width * camera.height;
        let (mut image, mut alpha, mut depth) = (vec![0.0; 3 * pixels], vec![0.0; pixels], vec![0.0; pixels]);
        let rows = CameraRows::new(&[*camera]);
        let raster = self.raster;
        self.fetch()?;
        self.activated.update(&self.population);
        let images = Images { image: &mut image, alpha: &mut alpha, depth: Some(&mut depth), features: None };
        let cameras = CameraSlices { model, ..rows.as_slices(&self.settings.background) };
        let gaussians = self.activated.slices(&self.population);
        self.session.forward(&gaussians, &cameras, &raster, images)?;
        Ok([image, alpha, depth])
    }
}
