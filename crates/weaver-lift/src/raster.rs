//! The weights of the rasterizer.

use crate::error::{LiftError, expect_len};
use crate::operator::Operator;
use weaver_geometry::Camera;
use weaver_kernels::Real;
use weaver_scene::{CameraSlices, Color, Features, GaussianSlices};
use weaver_splat::{Cotangents, Gradients, Images, RasterSettings, Target, Workspace, rasterize, rasterize_backward};

/// The weights with which Gaussians are drawn: [`forward`](Operator::forward) is [`rasterize`] with features,
/// [`adjoint`](Operator::adjoint) their gradient in [`rasterize_backward`]. There is no second drawing.
///
/// Same bits at any number of threads, and of channels at a time.
#[derive(Debug)]
pub struct Raster<'a, T> {
    gaussians: GaussianSlices<'a, T>,
    cameras: &'a [Camera],
    settings: RasterSettings,
    workspace: Workspace<T>,
    /// The view and the number of channels that the workspace holds.
    drawn: Option<(usize, usize)>,
    /// Features that stand in where only the weights matter, and images that nobody looks at.
    zeros: Vec<T>,
    alpha: Vec<T>,
    image: Vec<T>,
}

impl<'a, T: Real> Raster<'a, T> {
    /// The weights of `gaussians` in the views of `cameras`; colors and features of the Gaussians are not looked at.
    pub fn new(gaussians: GaussianSlices<'a, T>, cameras: &'a [Camera], settings: RasterSettings) -> Self {
        Self {
            gaussians: GaussianSlices { color: Color::None, features: None, ..gaussians },
            cameras,
            settings: RasterSettings { region: None, ..settings },
            workspace: Workspace::new(),
            drawn: None,
            zeros: Vec::new(),
            alpha: Vec::new(),
            image: Vec::new(),
        }
    }

    /// Draws a view with features, or with zeros for them where there are none.
    fn draw(&mut self, view: usize, x: Option<&[T]>, channels: usize, y: Option<&mut [T]>) -> Result<(), LiftError> {
        let rays = self.rays(view);
        self.alpha.resize(rays, T::ZERO);
        if x.is_none() {
            self.zeros.resize(self.splats() * channels, T::ZERO);
        }
        if y.is_none() {
            self.image.resize(rays * channels, T::ZERO);
        }
        let features = Features { values: x.unwrap_or(&self.zeros), channels };
        let gaussians = GaussianSlices { features: Some(features), ..self.gaussians };
        let images = Images {
            image: &mut [],
            alpha: &mut self.alpha,
            depth: None,
            features: Some(y.unwrap_or(&mut self.image)),
        };
        self.drawn = None;
        let camera = Numbers::of(&self.cameras[view]);
        rasterize(&gaussians, &camera.as_slices(), &self.settings, &mut self.workspace, images)?;
        self.drawn = Some((view, channels));
        Ok(())
    }

    fn check(&self, view: usize, x: usize, y: usize, channels: usize) -> Result<(), LiftError> {
        expect_len("features of Gaussians", x, self.splats() * channels)?;
        expect_len("features of pixels", y, self.rays(view) * channels)
    }
}

impl<T: Real> Operator<T> for Raster<'_, T> {
    fn splats(&self) -> usize {
        self.gaussians.opacities.len()
    }

    fn views(&self) -> usize {
        self.cameras.len()
    }

    fn rays(&self, view: usize) -> usize {
        self.cameras[view].width * self.cameras[view].height
    }

    fn forward(&mut self, view: usize, x: &[T], channels: usize, y: &mut [T]) -> Result<(), LiftError> {
        self.check(view, x.len(), y.len(), channels)?;
        self.draw(view, Some(x), channels, Some(y))
    }

    fn adjoint(&mut self, view: usize, y: &[T], channels: usize, x: &mut [T]) -> Result<(), LiftError> {
        self.check(view, x.len(), y.len(), channels)?;
        if self.drawn != Some((view, channels)) {
            self.draw(view, None, channels, None)?;
        }
        // What features a Gaussian has does not matter to what it receives.
        self.zeros.resize(self.splats() * channels, T::ZERO);
        let features = Features { values: &self.zeros, channels };
        let gaussians = GaussianSlices { features: Some(features), ..self.gaussians };
        let cotangents = Cotangents { features: Some(y), ..Cotangents::default() };
        let gradients = Gradients { features: Some(Target::add(x)), ..Gradients::default() };
        let camera = Numbers::of(&self.cameras[view]);
        let cameras = camera.as_slices();
        rasterize_backward(&gaussians, &cameras, &self.settings, &mut self.workspace, &cotangents, gradients)?;
        Ok(())
    }

    fn adjoint_squared(&mut self, view: usize, y: &[T], channels: usize, x: &mut [T]) -> Result<(), LiftError> {
        self.check(view, x.len(), y.len(), channels)?;
        if self.drawn.is_none_or(|(drawn, _)| drawn != view) {
            self.draw(view, None, 0, None)?;
        }
        self.workspace.squared_contributions(y, channels, Target::add(x))?;
        Ok(())
    }
}

/// A camera in the rasterizer's numbers.
struct Numbers<T> {
    viewmat: [T; 12],
    intrinsics: [T; 4],
    background: [T; 3],
    size: [usize; 2],
}

impl<T: Real> Numbers<T> {
    fn of(camera: &Camera) -> Self {
        let rotation = camera.pose.rotation.transpose().to_cols_array_2d();
        let translation = camera.pose.translation.to_array();
        let number = |i: usize| if i % 4 == 3 { translation[i / 4] } else { rotation[i / 4][i % 4] };
        let k = camera.intrinsics;
        Self {
            viewmat: std::array::from_fn(|i| T::from_f64(number(i))),
            intrinsics: [k.fx, k.fy, k.cx, k.cy].map(T::from_f64),
            background: [T::ZERO; 3],
            size: [camera.width, camera.height],
        }
    }

    fn as_slices(&self) -> CameraSlices<'_, T> {
        let Self { viewmat, intrinsics, background, size: [width, height] } = self;
        CameraSlices { viewmats: viewmat, intrinsics, background, width: *width, height: *height }
    }
}
