//! Pictures of a scene, for those who want no gradients.

use crate::cpu_rasterizer::CpuRasterizer;
use crate::error::RasterError;
use crate::rasterizer::{AnyRasterizer, Images, Session};
use crate::settings::RasterSettings;
use crate::workspace::Workspace;
use std::sync::Arc;
use weaver_geometry::Camera;
use weaver_scene::{ActivatedGaussians, CameraRows, CameraSlices, Model};

/// Draws Gaussians from cameras: for each camera an image `[H, W, 3]` over `background`, values not clamped.
///
/// Cameras may differ in image size; neighbors of equal size are drawn together. `workspace` keeps its memory from call
/// to call. For gradients, alpha, depth or features see [`rasterize`](crate::rasterize()) and
/// [`Rasterize`](crate::Rasterize).
///
/// # Errors
/// When the lengths of fields disagree, an image has no pixels, or there are too many Gaussians for one call.
///
/// ```
/// use weaver_geometry::{Camera, Intrinsics, Pose};
/// use weaver_scene::ActivatedGaussians;
/// use weaver_splat::{RasterSettings, Workspace, render};
/// let gaussians = ActivatedGaussians {
///     means: vec![0.0, 0.0, 2.0],
///     scales: vec![0.5; 3],
///     quats: vec![1.0, 0.0, 0.0, 0.0],
///     opacities: vec![0.8],
///     sh: vec![1.0, 0.0, -1.0],
///     degree: 0,
/// };
/// let intrinsics = Intrinsics { fx: 10.0, fy: 10.0, cx: 1.5, cy: 1.5 };
/// let camera = Camera { pose: Pose::IDENTITY, intrinsics, width: 3, height: 3 };
/// let images = render(&gaussians, &[camera], [0.0; 3], &RasterSettings::default(), &mut Workspace::new())?;
/// let [red, green, blue] = images[0][3 * 4..][..3] else { unreachable!() };
/// assert!(red > green && green > blue);
/// # Ok::<(), weaver_splat::RasterError>(())
/// ```
pub fn render(
    gaussians: &ActivatedGaussians,
    cameras: &[Camera],
    background: [f32; 3],
    settings: &RasterSettings,
    workspace: &mut Workspace<f32>,
) -> Result<Vec<Vec<f32>>, RasterError> {
    render_by(workspace, Model::Pinhole, (gaussians, cameras, background), settings)
}

/// Draws one scene after the other by any rasterizer, whose memory it keeps.
#[derive(Debug)]
pub struct Renderer {
    rasterizer: AnyRasterizer<f32>,
    session: Box<dyn Session<f32>>,
}

impl Default for Renderer {
    fn default() -> Self {
        Self::new(Arc::new(CpuRasterizer))
    }
}

impl Renderer {
    /// Draws by this rasterizer.
    pub fn new(rasterizer: AnyRasterizer<f32>) -> Self {
        Self { session: rasterizer.session(), rasterizer }
    }

    /// The rasterizer.
    pub fn rasterizer(&self) -> &AnyRasterizer<f32> {
        &self.rasterizer
    }

    /// Draws as [`render`] does.
    ///
    /// # Errors
    /// As [`render`], and any failure of the rasterizer.
    pub fn render(
        &mut self,
        gaussians: &ActivatedGaussians,
        cameras: &[Camera],
        background: [f32; 3],
        settings: &RasterSettings,
    ) -> Result<Vec<Vec<f32>>, RasterError> {
        self.render_through(Model::Pinhole, gaussians, cameras, background, settings)
    }

    /// Draws as [`render`] does, by cameras of any model; the intrinsics are those of the model.
    ///
    /// # Errors
    /// As [`render`], and any failure of the rasterizer, such as one that draws pinholes only.
    ///
    /// ```
    /// use weaver_geometry::lens::{self, Lens};
    /// use weaver_geometry::{Camera, Pose};
    /// use weaver_scene::{ActivatedGaussians, Model};
    /// use weaver_splat::{RasterSettings, Renderer};
    /// let behind = ActivatedGaussians {
    ///     means: vec![0.0, 0.0, -2.0],
    ///     scales: vec![0.5; 3],
    ///     quats: vec![1.0, 0.0, 0.0, 0.0],
    ///     opacities: vec![0.8],
    ///     sh: vec![1.0, 0.0, -1.0],
    ///     degree: 0,
    /// };
    /// let camera = Camera { pose: Pose::IDENTITY, intrinsics: lens::equirectangular(16, 8), width: 16, height: 8 };
    /// let sphere = Model::Lens(Lens::Equirectangular);
    /// let settings = RasterSettings::default();
    /// let images = Renderer::default().render_through(sphere, &behind, &[camera], [0.0; 3], &settings)?;
    /// let red = |x: usize, y: usize| images[0][3 * (16 * y + x)];
    /// assert!(red(0, 4) > 0.3 && red(15, 4) > 0.3 && red(8, 4) == 0.0);
    /// # Ok::<(), weaver_splat::RasterError>(())
    /// ```
    pub fn render_through(
        &mut self,
        model: Model,
        gaussians: &ActivatedGaussians,
        cameras: &[Camera],
        background: [f32; 3],
        settings: &RasterSettings,
    ) -> Result<Vec<Vec<f32>>, RasterError> {
        render_by(self.session.as_mut(), model, (gaussians, cameras, background), settings)
    }
}

fn render_by(
    session: &mut dyn Session<f32>,
    model: Model,
    (gaussians, cameras, background): (&ActivatedGaussians, &[Camera], [f32; 3]),
    settings: &RasterSettings,
) -> Result<Vec<Vec<f32>>, RasterError> {
    let mut rendered = Vec::with_capacity(cameras.len());
    let together = |a: &Camera, b: &Camera| {
        // A call through a lens has one table of rays.
        (a.width, a.height) == (b.width, b.height) && (model == Model::Pinhole || a.intrinsics == b.intrinsics)
    };
    for group in cameras.chunk_by(together) {
        let (width, height) = (group[0].width, group[0].height);
        let region = settings.region.filter(|region| region.is_within(width, height));
        let pixels = region.map_or(width * height, |region| region.pixels());
        let mut image = vec![0.0; 3 * pixels * group.len()];
        let mut alpha = vec![0.0; pixels * group.len()];
        let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
        let rows = CameraRows::new(group);
        let cameras = CameraSlices { model, ..rows.as_slices(&background) };
        session.forward(&gaussians.as_slices(), &cameras, settings, images)?;
        if group.len() == 1 {
            rendered.push(image);
        } else {
            rendered.extend(image.chunks(3 * pixels).map(<[f32]>::to_vec));
        }
    }
    Ok(rendered)
}
