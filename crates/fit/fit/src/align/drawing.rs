//! The loss of a camera: the scene drawn, compared with the photo, and differentiated by the camera.

use super::AlignError;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Pose};
use weaver_kernels::Real;
use weaver_scene::{CameraSlices, GaussianSlices, Model};
use weaver_splat::{Cotangents, Gradients, Images, RasterError, RasterSettings, Rasterizer, Session, Target};

/// A scene, which stays as it is.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a, T> {
    /// The Gaussians.
    pub gaussians: GaussianSlices<'a, T>,
    /// The color behind them.
    pub background: [T; 3],
    /// Settings of drawing them.
    pub settings: RasterSettings,
    /// The length that [`Method::TwoXplat`](super::Method::TwoXplat) measures centers in, world units: there the
    /// largest coordinate of a scene is 1.
    pub unit: f64,
}

/// The largest coordinate of a camera's center from the middle of all, the [unit](Scene::unit) of 2Xplat; 1 of a single
/// camera.
///
/// ```
/// use weaver_fit::align::unit;
/// assert_eq!(unit([[0.0; 3], [4.0, 0.0, 2.0]].map(Into::into).into_iter()), 2.0);
/// ```
pub fn unit(centers: impl Iterator<Item = DVec3> + Clone) -> f64 {
    let middle = centers.clone().sum::<DVec3>() / centers.clone().count().max(1) as f64;
    let largest = centers.map(|center| (center - middle).abs().max_element()).fold(0.0, f64::max);
    if largest > 0.0 { largest } else { 1.0 }
}

/// A photo of the scene.
#[derive(Clone, Copy, Debug)]
pub struct Photo<'a, T> {
    /// sRGB, `[height, width, 3]`.
    pub pixels: &'a [T],
    /// Mask of the pixels that count, `[height, width]`; `None` if all do.
    pub mask: Option<&'a [bool]>,
    /// The first guess, and the photo's size.
    pub camera: Camera,
}

impl<T: Real> Photo<'_, T> {
    pub(crate) fn check(&self, photo: usize) -> Result<(), AlignError> {
        let Camera { width, height, .. } = self.camera;
        let mask = self.mask.map_or(width * height, <[bool]>::len);
        for (what, expected, found) in
            [("pixels", 3 * width * height, self.pixels.len()), ("mask", width * height, mask)]
        {
            if expected != found || found == 0 {
                return Err(AlignError::Size { photo, what, width, height, expected, found });
            }
        }
        if let Some(at) = self.pixels.iter().position(|x| !x.is_finite()) {
            let (row, column) = (at / 3 / width, at / 3 % width);
            return Err(AlignError::NotFinite { photo, row, column, value: self.pixels[at].to_f64() });
        }
        match self.mask {
            Some(mask) if !mask.contains(&true) => Err(AlignError::Masked { photo }),
            _ => Ok(()),
        }
    }
}

/// `mean (image - photo)^2`, and its gradient by the image, which is written over `gradient`.
pub fn mean_square<T: Real>(image: &[T], photo: &[T], _size: [usize; 2], gradient: &mut [T]) -> f64 {
    let factor = T::from_f64(2.0 / image.len() as f64);
    let square = |((slope, a), b): ((&mut T, &T), &T)| {
        let difference = *a - *b;
        *slope = factor * difference;
        difference.to_f64() * difference.to_f64()
    };
    gradient.iter_mut().zip(image).zip(photo).map(square).sum::<f64>() / image.len() as f64
}

/// A photo at its own size or at half of it, with the pixels that count.
pub(crate) struct Level<T> {
    pub pixels: Vec<T>,
    pub counts: Vec<bool>,
    /// Each side of the photo over this one's.
    pub shrink: f64,
    /// Standard deviation of the blur of render and photo, pixels; 0 for none.
    pub blur: f64,
}

impl<T: Real> Level<T> {
    /// Means of 2 x 2 pixels; an odd last row or column is left out. A pixel counts if all four do.
    pub fn halved(&self, [height, width]: [usize; 2]) -> Self {
        let places = || (0..height / 2).flat_map(|y| (0..width / 2).map(move |x| 2 * (y * width + x)));
        let four = |at: usize| [at, at + 1, at + width, at + width + 1];
        let mean = |at, c| four(at).map(|at| self.pixels[3 * at + c]).into_iter().sum::<T>() * T::from_f64(0.25);
        let pixels = places().flat_map(|at| [0, 1, 2].map(|c| mean(at, c))).collect();
        let counts = places().map(|at| four(at).iter().all(|at| self.counts[*at])).collect();
        Self { pixels, counts, shrink: 2.0 * self.shrink, blur: self.blur }
    }

    /// The camera of a photo, at this size.
    fn camera(&self, camera: &Camera) -> Camera {
        let [width, height] = [camera.width, camera.height].map(|side| (side as f64 / self.shrink) as usize);
        let scale = 1.0 / self.shrink;
        Camera { pose: camera.pose, intrinsics: camera.intrinsics.resized(scale, scale), width, height }
    }
}

/// Draws a scene from cameras.
pub(crate) struct Drawing<'a, T> {
    scene: &'a Scene<'a, T>,
    session: Box<dyn Session<T>>,
    settings: RasterSettings,
    viewmat: [T; 12],
    intrinsics: [T; 4],
    pub image: Vec<T>,
    pub alpha: Vec<T>,
    pub depth: Vec<T>,
    slopes: Vec<T>,
}

impl<'a, T: Real> Drawing<'a, T> {
    pub fn new(scene: &'a Scene<'a, T>, rasterizer: &dyn Rasterizer<T>) -> Self {
        let (viewmat, intrinsics) = ([T::ZERO; 12], [T::ZERO; 4]);
        let [image, alpha, depth, slopes] = std::array::from_fn(|_| Vec::new());
        let (session, settings) = (rasterizer.session(), scene.settings);
        Self { scene, session, settings, viewmat, intrinsics, image, alpha, depth, slopes }
    }

    /// Image, alpha and depth of a view that is so many times smaller than its photo. The low-pass filter is the
    /// photo's, scaled to these pixels, with the variance of the mean over a pixel: small renders and small photos
    /// would not meet at the right camera otherwise.
    pub fn draw(&mut self, camera: &Camera, shrink: f64) -> Result<(), RasterError> {
        let eps2d = (self.scene.settings.eps2d + (shrink * shrink - 1.0) / 12.0) / (shrink * shrink);
        self.settings = RasterSettings { eps2d, ..self.scene.settings };
        let Camera { pose: Pose { rotation, translation }, intrinsics: k, width, height } = *camera;
        let (r, t) = (rotation.to_cols_array_2d(), translation.to_array());
        self.viewmat = std::array::from_fn(|i| T::from_f64(if i % 4 == 3 { t[i / 4] } else { r[i % 4][i / 4] }));
        self.intrinsics = [k.fx, k.fy, k.cx, k.cy].map(T::from_f64);
        self.image.resize(3 * width * height, T::ZERO);
        for plane in [&mut self.alpha, &mut self.depth] {
            plane.resize(width * height, T::ZERO);
        }
        let Self { scene, image, alpha, depth, .. } = self;
        let cameras = cameras(&self.viewmat, &self.intrinsics, &scene.background, [height, width]);
        let images = Images { image, alpha, depth: Some(depth), features: None };
        self.session.forward(&scene.gaussians, &cameras, &self.settings, images)?;
        Ok(())
    }

    /// The loss of a camera. Masked pixels of the photo are taken to be as drawn.
    pub fn loss(&mut self, camera: &Camera, level: &Level<T>, loss: &mut Loss<'_, T>) -> Result<f64, RasterError> {
        let camera = level.camera(camera);
        let size = [camera.height, camera.width];
        self.draw(&camera, level.shrink)?;
        let mut photo = level.pixels.clone();
        let uncounted = || level.counts.iter().enumerate().filter(|(_, counts)| !**counts).map(|(at, _)| 3 * at);
        uncounted().for_each(|at| photo[at..at + 3].copy_from_slice(&self.image[at..at + 3]));
        blur(&mut photo, size, level.blur);
        let mut image = self.image.clone();
        blur(&mut image, size, level.blur);
        self.slopes.resize(image.len(), T::ZERO);
        let value = loss(&image, &photo, size, &mut self.slopes);
        // The blur is symmetric: its own transpose.
        blur(&mut self.slopes, size, level.blur);
        uncounted().for_each(|at| self.slopes[at..at + 3].fill(T::ZERO));
        let counted = level.counts.iter().filter(|counts| **counts).count();
        Ok(value * level.counts.len() as f64 / counted.max(1) as f64)
    }

    /// The gradient of the last [`loss`](Self::loss) by `[A | t]` and by the logarithms of fx and fy.
    pub fn gradient(&mut self, camera: &Camera, level: &Level<T>) -> Result<([f64; 12], [f64; 2]), RasterError> {
        let Camera { height, width, .. } = level.camera(camera);
        let (mut viewmat, mut intrinsics) = ([T::ZERO; 12], [T::ZERO; 4]);
        let Self { scene, slopes, .. } = self;
        let cameras = cameras(&self.viewmat, &self.intrinsics, &scene.background, [height, width]);
        let cotangents = Cotangents { image: Some(slopes), ..Cotangents::default() };
        let gradients = Gradients {
            viewmats: Some(Target::write(&mut viewmat)),
            intrinsics: Some(Target::write(&mut intrinsics)),
            ..Gradients::default()
        };
        let (gaussians, settings) = (&scene.gaussians, &self.settings);
        self.session.backward(gaussians, &cameras, settings, &cotangents, gradients)?;
        let focal = [0, 1].map(|i| (intrinsics[i] * self.intrinsics[i]).to_f64());
        Ok((viewmat.map(T::to_f64), focal))
    }
}

/// Compares an image with a photo, both `[H, W, 3]`, and writes the gradient by the image.
pub(crate) type Loss<'a, T> = dyn FnMut(&[T], &[T], [usize; 2], &mut [T]) -> f64 + 'a;

fn cameras<'a, T>(
    viewmats: &'a [T],
    intrinsics: &'a [T],
    background: &'a [T],
    [height, width]: [usize; 2],
) -> CameraSlices<'a, T> {
    CameraSlices { viewmats, intrinsics, background, width, height, model: Model::Pinhole }
}

/// Convolves rows, then columns, with a Gaussian cut at three deviations; zeros outside.
fn blur<T: Real>(pixels: &mut [T], [height, width]: [usize; 2], deviation: f64) {
    if deviation == 0.0 {
        return;
    }
    let reach = (3.0 * deviation).ceil() as usize;
    let weight = |d: usize| (-0.5 * (d as f64 / deviation).powi(2)).exp();
    let sum = weight(0) + 2.0 * (1..=reach).map(weight).sum::<f64>();
    let weights: Vec<T> = (0..=reach).map(|d| T::from_f64(weight(d) / sum)).collect();
    let mut line = Vec::new();
    for (lines, step, length, apart) in [(height, 1, width, width), (width, width, height, 1)] {
        for start in (0..lines).map(|i| i * apart) {
            for c in 0..3 {
                let at = |i: usize| 3 * (start + i * step) + c;
                line.clear();
                line.extend((0..length).map(|i| pixels[at(i)]));
                for i in 0..length {
                    let near = i.saturating_sub(reach)..length.min(i + reach + 1);
                    pixels[at(i)] = near.map(|j| line[j] * weights[i.abs_diff(j)]).sum();
                }
            }
        }
    }
}
