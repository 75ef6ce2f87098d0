//! Memory of the CPU rasterizer, kept between calls.

use crate::error::RasterError;
use crate::ewa::EwaGaussian;
use crate::extent::{Extent, expect_len};
use crate::gradients::Target;
use crate::lens::{RayGaussian, Rays, RaysCache};
use crate::settings::RasterSettings;
use crate::tiles::{Compared, Tiles};
use std::sync::Arc;
use std::time::Duration;
use weaver_kernels::Real;
use weaver_kernels::lanes::Row;
use weaver_scene::Features;

/// State from forward for backward, and room to work in. It only grows: calls of sizes seen before allocate nothing.
#[derive(Debug)]
pub struct Workspace<T> {
    /// The sizes and settings of the last forward.
    pub(crate) drawn: Option<(Extent, RasterSettings)>,
    pub(crate) tiles: Tiles<T>,
    /// The rays of the last forward through a lens; `None` after one of pinholes.
    pub(crate) rays: Option<Arc<Rays<T>>>,
    pub(crate) rays_cache: RaysCache<T>,
    /// Camera gradients of chunks of Gaussians.
    pub(crate) camera_sums: Vec<Row<T>>,
    pub(crate) timings: Timings,
    /// True if a backward pass since the last forward collected statistics, false if one did not; `None` without one.
    pub(crate) differentiated: Option<bool>,
}

/// Times of the stages of the last calls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Timings {
    /// From Gaussians to splats, and which tiles they cover.
    pub project: Duration,
    /// Sorting by depth, and binning: putting splats into the lists of their tiles.
    pub bin: Duration,
    /// Blending, and putting images together.
    pub blend: Duration,
    /// All of backward.
    pub backward: Duration,
}

impl<T: Real> Workspace<T> {
    /// An empty workspace.
    pub fn new() -> Self {
        Self {
            drawn: None,
            tiles: Tiles::new(),
            rays: None,
            rays_cache: RaysCache::default(),
            camera_sums: Vec::new(),
            timings: Timings::default(),
            differentiated: None,
        }
    }

    /// The sizes and settings of the last forward.
    pub(crate) fn last(&self) -> Result<(Extent, RasterSettings), RasterError> {
        self.drawn.ok_or_else(|| RasterError::Arguments("nothing was drawn with this workspace".into()))
    }

    /// Times of the last forward and the last backward.
    pub fn timings(&self) -> Timings {
        self.timings
    }

    /// Calls `visit(pixel, gaussian, weight, transmittance)` for every Gaussian at every pixel that it adds to, in the
    /// last image drawn with this workspace.
    ///
    /// `pixel` indexes `[V, H, W]` (`[V, K, H, W]` of Gaussians in K groups, here and below), `gaussian` is 0 to N - 1,
    /// `transmittance` T is the light that arrives there, `weight` is alpha T, the same numbers that the image is made
    /// of. At each pixel hits come front to back. Tiles are visited in parallel, so that hits of different pixels come
    /// in no fixed order.
    ///
    /// # Errors
    ///
    /// A workspace that nothing was drawn with, or whose last drawing failed.
    ///
    /// ```
    /// # use weaver_scene::{CameraSlices, Color, GaussianSlices, Model};
    /// # use weaver_splat::{Images, RasterSettings, Workspace, rasterize};
    /// # let gaussians = GaussianSlices {
    /// #     means: &[0.0_f32, 0.0, 2.0],
    /// #     quats: &[1.0, 0.0, 0.0, 0.0],
    /// #     scales: &[0.5, 0.5, 0.5],
    /// #     opacities: &[0.8],
    /// #     color: Color::None,
    /// #     features: None,
    /// #     groups: None,
    /// # };
    /// # let cameras = CameraSlices {
    /// #     viewmats: &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
    /// #     intrinsics: &[10.0, 10.0, 0.5, 0.5],
    /// #     background: &[0.0; 3],
    /// #     width: 1,
    /// #     height: 1,
    /// #     model: Model::Pinhole,
    /// # };
    /// # let mut alpha = [0.0];
    /// # let images = Images { image: &mut [], alpha: &mut alpha, depth: None, features: None };
    /// let mut workspace = Workspace::new();
    /// rasterize(&gaussians, &cameras, &RasterSettings::default(), &mut workspace, images)?;
    /// workspace.for_each_hit(|pixel, gaussian, weight, transmittance| {
    ///     assert_eq!((pixel, gaussian, weight, transmittance), (0, 0, 0.8, 1.0));
    /// })?;
    /// # Ok::<(), weaver_splat::RasterError>(())
    /// ```
    pub fn for_each_hit(&self, visit: impl Fn(usize, usize, T, T) + Sync) -> Result<(), RasterError> {
        let (_, settings) = self.last()?;
        match self.rays.as_deref() {
            None => self.tiles.for_each_hit(&EwaGaussian, settings.alpha_max, visit),
            Some(rays) => self.tiles.for_each_hit(&RayGaussian(rays), settings.alpha_max, visit),
        }
        Ok(())
    }

    /// Contribution of each Gaussian to the last image drawn with this workspace: the sum and the largest of its
    /// weights alpha T over the pixels, `[V, N]` each; 0 where it is not seen.
    ///
    /// # Errors
    ///
    /// Lengths that do not fit, or a workspace that nothing was drawn with.
    pub fn contributions(&mut self, sums: &mut [T], largest: &mut [T]) -> Result<(), RasterError> {
        let (extent, settings) = self.last()?;
        expect_len("sums of the contributions", sums.len(), extent.views * extent.gaussians)?;
        expect_len("largest contributions", largest.len(), extent.views * extent.gaussians)?;
        match self.rays.as_deref() {
            None => self.tiles.contributions(&EwaGaussian, settings.alpha_max, sums, largest),
            Some(rays) => self.tiles.contributions(&RayGaussian(rays), settings.alpha_max, sums, largest),
        }
        Ok(())
    }

    /// Need of each Gaussian in the last image drawn with this workspace: the rise of the image's squared error without
    /// it alone, and the sum of its weights w = alpha T over the pixels that count, `[V, N]` each; 0 where it is not
    /// seen.
    ///
    /// A pixel shows `C = sum_i w_i c_i` over the background, `e` beside what it should be. Without Gaussian i it
    /// changes by `d = -w_i (c_i - B_i)`, with `B_i` the color of everything behind, and its error rises by
    /// `A d (2 e + A d)`, where A is [`Compared::map`].
    ///
    /// # Errors
    ///
    /// Lengths that do not fit, or a workspace that nothing was drawn with.
    ///
    /// ```
    /// # use weaver_scene::{CameraSlices, Color, GaussianSlices, Model};
    /// # use weaver_splat::{Compared, Images, RasterSettings, Workspace, rasterize};
    /// # let cameras = CameraSlices {
    /// #     viewmats: &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
    /// #     intrinsics: &[10.0, 10.0, 0.5, 0.5],
    /// #     background: &[0.5; 3],
    /// #     width: 1,
    /// #     height: 1,
    /// #     model: Model::Pinhole,
    /// # };
    /// let gaussians = GaussianSlices {
    ///     means: &[0.0_f32, 0.0, 2.0],
    ///     quats: &[1.0, 0.0, 0.0, 0.0],
    ///     scales: &[0.5, 0.5, 0.5],
    ///     opacities: &[0.8],
    ///     color: Color::Plain(&[1.0, 1.0, 1.0]),
    ///     features: None,
    ///     groups: None,
    /// };
    /// let (mut image, mut alpha, mut workspace) = ([0.0; 3], [0.0], Workspace::new());
    /// let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
    /// rasterize(&gaussians, &cameras, &RasterSettings::default(), &mut workspace, images)?;
    /// // The image is right, and would be off by 0.4 in three channels: the background is gray.
    /// let map = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    /// let compared = Compared { image: &image, error: &[0.0; 3], counts: &[1.0], map };
    /// let (mut rises, mut shown) = ([0.0], [0.0]);
    /// workspace.removal(&compared, &mut rises, &mut shown)?;
    /// assert!((rises[0] - 0.48).abs() < 1e-5 && shown == [0.8]);
    /// # Ok::<(), weaver_splat::RasterError>(())
    /// ```
    pub fn removal(&mut self, compared: &Compared<'_, T>, rises: &mut [T], shown: &mut [T]) -> Result<(), RasterError> {
        let (extent, settings) = self.last()?;
        expect_len("image of the removal", compared.image.len(), 3 * extent.pixels())?;
        expect_len("error of the removal", compared.error.len(), 3 * extent.pixels())?;
        expect_len("pixels of the removal", compared.counts.len(), extent.pixels())?;
        expect_len("rises of the removal", rises.len(), extent.views * extent.gaussians)?;
        expect_len("weights of the removal", shown.len(), extent.views * extent.gaussians)?;
        match self.rays.as_deref() {
            None => self.tiles.removal(&EwaGaussian, settings.alpha_max, compared, rises, shown),
            Some(rays) => self.tiles.removal(&RayGaussian(rays), settings.alpha_max, compared, rises, shown),
        }
        Ok(())
    }

    /// The gradients with respect to features alone, from the gradients with respect to the image of the features `[V,
    /// H, W, C]`: for the last image drawn with this workspace, with any features or none, `[N, C]`.
    ///
    /// The same bits as from [`rasterize_backward`](crate::rasterize_backward()), which computes the gradients of
    /// shapes as well.
    ///
    /// # Errors
    ///
    /// Lengths that do not fit, or a workspace that nothing was drawn with.
    pub fn feature_gradients(
        &mut self,
        cotangent: &[T],
        channels: usize,
        target: Target<'_, T>,
    ) -> Result<(), RasterError> {
        let (extent, settings) = self.last()?;
        expect_len("cotangent of the features", cotangent.len(), extent.pixels() * channels)?;
        expect_len("gradient of the features", target.values.len(), extent.gaussians * channels)?;
        let values = Features { values: cotangent, channels };
        match self.rays.as_deref() {
            None => self.tiles.feature_gradients(&EwaGaussian, settings.alpha_max, values, target),
            Some(rays) => self.tiles.feature_gradients(&RayGaussian(rays), settings.alpha_max, values, target),
        }
        Ok(())
    }

    /// Sums over the pixels of the last image drawn with this workspace, for each Gaussian, by the squares of its
    /// weights: the sums of w^2 times `values` `[V, H, W, C]`, w = alpha T, over pixels and views, `[N, C]`.
    ///
    /// Linear in `values`. By the weights themselves, [`feature_gradients`](Self::feature_gradients) gathers. Same bits
    /// at any number of threads.
    ///
    /// # Errors
    ///
    /// Lengths that do not fit, or a workspace that nothing was drawn with.
    pub fn squared_contributions(
        &mut self,
        values: &[T],
        channels: usize,
        sums: Target<'_, T>,
    ) -> Result<(), RasterError> {
        let (extent, settings) = self.last()?;
        expect_len("values to gather", values.len(), extent.pixels() * channels)?;
        expect_len("sums of the squared contributions", sums.values.len(), extent.gaussians * channels)?;
        let values = Features { values, channels };
        match self.rays.as_deref() {
            None => self.tiles.squared_contributions(&EwaGaussian, settings.alpha_max, values, sums),
            Some(rays) => self.tiles.squared_contributions(&RayGaussian(rays), settings.alpha_max, values, sums),
        }
        Ok(())
    }
}

impl<T: Real> Default for Workspace<T> {
    fn default() -> Self {
        Self::new()
    }
}
