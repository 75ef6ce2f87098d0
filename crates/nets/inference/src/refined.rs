//! A model's predictions, refined on the photos that they were made from.

use crate::{CameraSource, Density, Error, Photos, Prediction, Predictor, planar};
use std::path::PathBuf;
use std::sync::Arc;
use weaver_fit::{Fit, FitRasterizer, FitSettings, StrategyKind, steps_in};
use weaver_geometry::{Camera, Pose, Similarity};
use weaver_io::Image;
use weaver_kernels::random::Stream;
use weaver_scene::{Gaussians, Photo, Pixels};
use weaver_splat::{CpuRasterizer, RasterSettings, Renderer};

/// For how long a prediction is refined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Effort {
    /// A fixed number of steps.
    Steps(usize),
    /// The steps that fit into so many seconds.
    Seconds(f64),
}

/// A predictor whose Gaussians, and predicted cameras, are optimized to meet the photos that it was given.
///
/// There are never more Gaussians than the predictor made. Cameras that were given stay; predicted ones move, and the
/// first stays the origin. Photos may be larger than the network's: it sees them shrunk, the optimization as they are.
#[derive(Debug)]
pub struct Refined {
    inner: Box<dyn Predictor>,
    size: [usize; 2],
    effort: Effort,
    rasterizer: Arc<dyn FitRasterizer>,
    settings: FitSettings,
    steps: usize,
}

impl Refined {
    /// Refines the predictions of `inner` on photos of `size` (height, width), which has the shape of the network's.
    pub fn new(inner: Box<dyn Predictor>, size: [usize; 2], effort: Effort) -> Self {
        let rasterizer = Arc::new(CpuRasterizer);
        Self { inner, size, effort, rasterizer, settings: Self::usual_settings(), steps: 0 }
    }

    /// As [`new`](Self::new), on photos of this long side; `None` is the size of the smallest of `photos`, and the
    /// network's where that is larger or there are none.
    ///
    /// # Errors
    /// When a photo cannot be read.
    pub fn at_size(
        inner: Box<dyn Predictor>,
        long_side: Option<usize>,
        photos: &[PathBuf],
        effort: Effort,
    ) -> Result<Self, Error> {
        let [height, width] = inner.image_size();
        let scale = match long_side {
            Some(side) => side as f64 / height.max(width) as f64,
            None => own_scale(photos, [height, width])?,
        };
        let size = [height, width].map(|side| (side as f64 * scale).round().max(1.0) as usize);
        Ok(Self::new(inner, size, effort))
    }

    /// The same, but no Gaussian is given up for another elsewhere: predicted ones are only adjusted.
    #[must_use]
    pub fn in_place(mut self) -> Self {
        self.settings.density.strategy = StrategyKind::Keep;
        self
    }

    /// The same, but optimized by these settings in place of the [usual ones](Self::usual_settings).
    #[must_use]
    pub fn with_settings(self, settings: FitSettings) -> Self {
        Self { settings, ..self }
    }

    /// Settings of a refinement, except for the ones that each prediction and each effort set anew: steps, Gaussians,
    /// degree of the harmonics, background and refinement of cameras. The weights of opacities and scales are for one
    /// Gaussian per pixel, they and the rate of the means for photos of the network's size.
    ///
    /// The aim is that Gaussians which the photos do not need become transparent, and that others are split in their
    /// place where the error is. Opacities of all Gaussians are pulled down equally, for any number of them: where they
    /// are scarce, all are needed.
    ///
    /// Means and rotations go in longer steps than in a fit, and the last gradient counts beside Adam's mean of them:
    /// photos that are not fitted are met better so, after few steps and many.
    pub fn usual_settings() -> FitSettings {
        let mut settings = FitSettings { sh_interval: 0.0, coarse_until: 0.0, halvings: 0, ..FitSettings::default() };
        settings.density.strategy = StrategyKind::Split;
        settings.density.opacity_decay = 0.01;
        settings.density.opacity_weight = 0.25;
        settings.density.scale_weight = 0.0075;
        settings.rates.means *= 6.0;
        settings.rates.means_end = 0.1;
        settings.rates.quats *= 4.0;
        settings.rates.scales *= 3.0;
        // In so few steps a fall at the end takes more than it brings.
        settings.rates.end = 1.0;
        // A running mean over ten steps is too slow for so few.
        settings.rates.last = 0.5;
        settings
    }

    /// The same, but with this rasterizer for the optimization in place of the one for CPUs.
    #[must_use]
    pub fn fitted_by(self, rasterizer: Arc<dyn FitRasterizer>) -> Self {
        Self { rasterizer, ..self }
    }

    /// Steps of the last refinement.
    pub fn steps(&self) -> usize {
        self.steps
    }

    fn refine(&mut self, photos: Photos<'_>, prediction: &mut Prediction, moving: bool) -> Result<(), Error> {
        let gaussians = prediction.gaussians.to_stored();
        if gaussians.is_empty() {
            return Ok(());
        }
        let photos = views(photos, &prediction.cameras);
        let mut settings = self.settings.clone();
        (settings.gaussians, settings.sh_degree) = (gaussians.len(), gaussians.degree);
        let per_pixel = gaussians.len() as f32 / prediction.counts.len().max(1) as f32;
        // Larger photos are met less well by as many Gaussians: with the same weight, whole scenes fade.
        let shrinking = (self.inner.image_size()[1] as f32 / self.size[1] as f32).min(1.0);
        settings.density.opacity_weight *= per_pixel * shrinking;
        settings.density.scale_weight *= per_pixel * shrinking;
        // An error of one of the network's pixels is an error of several of a larger photo's.
        settings.rates.means *= f64::from(1.0 / shrinking).min(FARTHEST);
        settings.background = self.inner.background();
        settings.poses.refine = moving;
        let (initial, effort) = (finite(gaussians), self.effort);
        if let Effort::Steps(steps) = effort {
            settings.steps = steps;
            // A short run has fewer rounds: split Gaussians are to be optimized before the next.
            settings.density.rounds = settings.density.rounds.min(steps.div_ceil(STEPS_OF_A_ROUND));
        }
        let mut fit = Fit::with(self.rasterizer.clone(), settings.density.strategy(), photos, &initial, settings)?;
        fit.set_raster_settings(self.inner.raster_settings());
        if let Effort::Seconds(seconds) = effort {
            let steps = steps_in(&mut fit, seconds)?;
            fit.set_steps(steps);
        }
        while fit.steps_done() < fit.settings().steps {
            fit.step()?;
        }
        fit.fetch()?;
        self.steps = fit.steps_done();
        let refined: Vec<Camera> = (0..fit.photos()).map(|i| fit.camera(i)).collect();
        let origin = first_as_origin(&refined[0].pose);
        prediction.gaussians = fit.gaussians().transformed(&origin).to_activated();
        prediction.view_opacity = None;
        if moving {
            prediction.cameras =
                refined.iter().map(|camera| Camera { pose: origin.apply_to_pose(&camera.pose), ..*camera }).collect();
            prediction.predicted = prediction.cameras.clone();
        }
        Ok(())
    }
}

/// Steps between rounds of density control, at least.
const STEPS_OF_A_ROUND: usize = 10;

/// Largest factor on the rate of the means for photos that are larger than the network's: the factor of the largest
/// measured photos.
const FARTHEST: f64 = 2.5;

/// Logits that can be learned from.
fn finite(mut gaussians: Gaussians) -> Gaussians {
    gaussians.opacity_logits.iter_mut().for_each(|o| *o = o.clamp(-9.0, 9.0));
    gaussians
}

/// The transform to the world in which this camera stands at the origin.
fn first_as_origin(pose: &Pose) -> Similarity {
    Similarity { scale: 1.0, rotation: pose.rotation, translation: pose.translation }
}

fn views(photos: Photos<'_>, cameras: &[Camera]) -> Vec<Photo> {
    let Photos { planes, inside, height, width } = photos;
    let pixels = height * width;
    let mask = |i: usize| Some(inside?[i * pixels..][..pixels].to_vec());
    let rgb = |planes: &[f32]| -> Pixels {
        (0..3 * pixels).map(|i| (planes[i % 3 * pixels + i / 3] * 255.0).round() as u8).collect()
    };
    (planes.chunks_exact(3 * pixels).zip(cameras).enumerate())
        .map(|(i, (planes, camera))| Photo {
            name: i.to_string(),
            camera: *camera,
            rgb: rgb(planes),
            mask: mask(i),
            lens: None,
        })
        .collect()
}

/// A camera of an image resized to `size` (height, width).
fn resized(camera: &Camera, [height, width]: [usize; 2]) -> Camera {
    let (sx, sy) = (width as f64 / camera.width as f64, height as f64 / camera.height as f64);
    Camera { intrinsics: camera.intrinsics.resized(sx, sy), width, height, ..*camera }
}

/// Photos `[V, 3, H, W]` shrunk to `size`.
fn shrunk(photos: Photos<'_>, [height, width]: [usize; 2]) -> Vec<f32> {
    let Photos { planes, height: h, width: w, .. } = photos;
    let small = planes.chunks_exact(3 * h * w).map(|photo| {
        let pixels = (0..3 * h * w).map(|i| photo[i % 3 * h * w + i / 3]).collect();
        Image { width: w, height: h, pixels }.resize(width, height, [0.0, 0.0, w as f64, h as f64])
    });
    planar(&small.collect::<Vec<_>>())
}

/// Values `[V, h, w]` of the nearest pixels, `[V, H, W]`.
fn spread<T: Copy>(values: &[T], [h, w]: [usize; 2], [height, width]: [usize; 2]) -> Vec<T> {
    let at = |v: usize, y: usize, x: usize| values[(v * h + y * h / height) * w + x * w / width];
    let rows = (0..values.len() / (h * w).max(1)).flat_map(|v| (0..height).map(move |y| (v, y)));
    rows.flat_map(|(v, y)| (0..width).map(move |x| at(v, y, x))).collect()
}

/// Ratio of the smallest photo to the network's size; at least 1, and 1 of no photos.
fn own_scale(photos: &[PathBuf], [height, width]: [usize; 2]) -> Result<f64, Error> {
    let mut least = f64::INFINITY;
    for photo in photos {
        let (w, h) = Image::dimensions(photo)?;
        least = least.min((w as f64 / width as f64).min(h as f64 / height as f64));
    }
    Ok(if least.is_finite() { least.max(1.0) } else { 1.0 })
}

impl Predictor for Refined {
    fn predict(
        &mut self,
        photos: Photos<'_>,
        cameras: CameraSource<'_>,
        density: Density,
        stream: Stream,
    ) -> Result<Prediction, Error> {
        let small = self.inner.image_size();
        let [height, width] = small;
        let given = cameras.given();
        let kept: Vec<Camera> = given.unwrap_or_default().iter().map(|c| resized(c, small)).collect();
        let (source, moving) = (cameras.with_cameras(&kept), given.is_none());
        let planes = shrunk(photos, small);
        let large = [photos.height, photos.width];
        let inside = photos.inside.map(|inside| spread(inside, large, small));
        let small_photos = Photos { planes: &planes, inside: inside.as_deref(), height, width };
        let mut prediction = self.inner.predict(small_photos, source, density, stream)?;
        for cameras in [&mut prediction.cameras, &mut prediction.predicted] {
            cameras.iter_mut().for_each(|camera| *camera = resized(camera, large));
        }
        self.refine(photos, &mut prediction, moving)?;
        prediction.depth = spread(&prediction.depth, small, large);
        prediction.counts = spread(&prediction.counts, small, large);
        prediction.density = spread(&prediction.density, small, large);
        Ok(prediction)
    }

    fn remark(&self, density: Density) -> Option<String> {
        self.inner.remark(density)
    }

    fn density(&self, asked: Density) -> Result<Density, Error> {
        self.inner.density(asked)
    }

    fn needs_points(&self) -> bool {
        self.inner.needs_points()
    }

    fn image_size(&self) -> [usize; 2] {
        self.size
    }

    fn max_per_pixel(&self) -> usize {
        self.inner.max_per_pixel()
    }

    fn raster_settings(&self) -> RasterSettings {
        self.inner.raster_settings()
    }

    fn background(&self) -> [f32; 3] {
        self.inner.background()
    }

    fn renderer(&mut self) -> &mut Renderer {
        self.inner.renderer()
    }
}
