//! The weights of the rasterizer.

use crate::error::{LiftError, expect_len};
use crate::operator::Operator;
use weaver_geometry::Camera;
use weaver_kernels::Real;
use weaver_scene::{CameraSlices, Color, Features, GaussianSlices, Model};
use weaver_splat::{Images, RasterSettings, Target, Workspace, rasterize};

/// The compositing weights of Gaussians: [`forward`](Operator::forward) is [`rasterize`] with features,
/// [`adjoint`](Operator::adjoint) their gradient, [`Workspace::feature_gradients`]. There is no second rasterizer.
///
/// Same bits at any number of threads, and of channels at a time.
#[derive(Debug)]
pub struct Raster<'a, T> {
    gaussians: GaussianSlices<'a, T>,
    cameras: &'a [Camera],
    settings: RasterSettings,
    workspace: Workspace<T>,
    /// The last drawn view, held by the workspace.
    drawn: Option<usize>,
    /// Unused output of the rasterizer.
    alpha: Vec<T>,
}

impl<'a, T: Real> Raster<'a, T> {
    /// The weights of `gaussians` in the views of `cameras`; colors and features of the Gaussians are not used.
    pub fn new(gaussians: GaussianSlices<'a, T>, cameras: &'a [Camera], settings: RasterSettings) -> Self {
        Self {
            gaussians: GaussianSlices { color: Color::None, features: None, ..gaussians },
            cameras,
            settings: RasterSettings { region: None, ..settings },
            workspace: Workspace::new(),
            drawn: None,
            alpha: Vec::new(),
        }
    }

    /// Draws a view with features, or with none of them.
    fn draw(&mut self, view: usize, features: Option<(Features<'_, T>, &mut [T])>) -> Result<(), LiftError> {
        self.alpha.resize(self.rays(view), T::ZERO);
        let (features, image) = features.unzip();
        let gaussians = GaussianSlices { features, ..self.gaussians };
        let images = Images { image: &mut [], alpha: &mut self.alpha, depth: None, features: image };
        self.drawn = None;
        let camera = Numbers::of(&self.cameras[view]);
        rasterize(&gaussians, &camera.as_slices(), &self.settings, &mut self.workspace, images)?;
        self.drawn = Some(view);
        Ok(())
    }

    /// Draws a view for its weights, unless it was the last drawn one.
    fn hold(&mut self, view: usize) -> Result<(), LiftError> {
        if self.drawn == Some(view) { Ok(()) } else { self.draw(view, None) }
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
        self.draw(view, Some((Features { values: x, channels }, y)))
    }

    fn adjoint(&mut self, view: usize, y: &[T], channels: usize, x: &mut [T]) -> Result<(), LiftError> {
        self.check(view, x.len(), y.len(), channels)?;
        self.hold(view)?;
        Ok(self.workspace.feature_gradients(y, channels, Target::add(x))?)
    }

    fn adjoint_squared(&mut self, view: usize, y: &[T], channels: usize, x: &mut [T]) -> Result<(), LiftError> {
        self.check(view, x.len(), y.len(), channels)?;
        self.hold(view)?;
        Ok(self.workspace.squared_contributions(y, channels, Target::add(x))?)
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
        CameraSlices {
            viewmats: viewmat,
            intrinsics,
            background,
            width: *width,
            height: *height,
            model: Model::Pinhole,
        }
    }
}
