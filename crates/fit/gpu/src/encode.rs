//! Drawing as a part of an embedder's own commands.

use crate::error::GpuError;
use crate::forward::{Forward, PARAMS};
use crate::rasterizer::GpuRasterizer;
use crate::room::Room;
use crate::workspace::GpuWorkspace;
use weaver_scene::{CameraSlices, Color, GaussianSlices};
use weaver_splat::{Extent, RasterError, RasterSettings};

/// Gaussians in an embedder's storage buffers.
#[derive(Clone, Copy, Debug)]
pub struct DeviceGaussians<'a> {
    /// The number.
    pub count: usize,
    /// `[N, 12]`, `f32`: mean 3, quaternion wxyz 4, standard deviations 3, opacity, unused.
    pub params: &'a wgpu::Buffer,
    /// `[N, 3]` or, with harmonics of degree d, `[N, (d + 1)^2, 3]`, `f32`.
    pub colors: &'a wgpu::Buffer,
    /// The degree of the harmonics; `None` for plain colors.
    pub degree: Option<usize>,
}

/// Buffers of a recorded drawing.
#[derive(Clone, Copy, Debug)]
pub struct Recorded<'a> {
    /// `[h, w, 5]`, `f32`: red, green, blue and depth without background, and the transmittance.
    pub pixels: &'a wgpu::Buffer,
    /// `[3]`, `u32`: splats, entries of tiles, rejected Gaussians. More entries than the capacity are an overflow: the
    /// farthest ones were left out; draw again with more.
    pub totals: &'a wgpu::Buffer,
}

impl GpuRasterizer {
    /// Records the drawing of one view into an embedder's commands, of buffers that stay on the device; nothing is read
    /// back and nothing waited for. There is room for `capacity` entries, splats over tiles: about three for each
    /// Gaussian is usual. All of it is sorted, used or not.
    ///
    /// The workspace keeps the drawing until its next use. Backward needs a [`forward`](GpuRasterizer::forward).
    ///
    /// # Errors
    /// Other than one camera, settings out of range, buffers that are too small, more than a binding of the device
    /// holds.
    ///
    /// ```no_run
    /// use weaver_gpu::{Context, DeviceGaussians, GpuRasterizer, GpuWorkspace, wgpu};
    /// # fn draw(context: Context, params: &wgpu::Buffer, colors: &wgpu::Buffer, camera: &weaver_scene::CameraSlices<'_, f32>) -> Result<(), Box<dyn std::error::Error>> {
    /// let rasterizer = GpuRasterizer::new(context.clone());
    /// let mut workspace = GpuWorkspace::default();
    /// let mut encoder = context.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    /// let gaussians = DeviceGaussians { count: 1000, params, colors, degree: Some(3) };
    /// let drawn = rasterizer.encode(&mut encoder, gaussians, camera, &Default::default(), 5000, &mut workspace)?;
    /// // More passes that read `drawn.pixels`, then:
    /// context.queue().submit([encoder.finish()]);
    /// # Ok(()) }
    /// ```
    pub fn encode<'w>(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        gaussians: DeviceGaussians<'_>,
        camera: &CameraSlices<'_, f32>,
        settings: &RasterSettings,
        capacity: usize,
        workspace: &'w mut GpuWorkspace,
    ) -> Result<Recorded<'w>, RasterError> {
        let DeviceGaussians { count, params, colors, degree } = gaussians;
        let color = degree.map_or(Color::Plain(&[]), |degree| Color::Sh { coefficients: &[], degree });
        let nothing =
            GaussianSlices { means: &[], quats: &[], scales: &[], opacities: &[], color, features: None, groups: None };
        let mut extent = Extent::of(&nothing, camera, settings, true)?;
        extent.gaussians = count;
        if extent.views != 1 {
            return Err(RasterError::Unsupported(format!("{} cameras, expected one", extent.views)));
        }
        workspace.drawn = None;
        workspace.params = theirs("parameters", params, PARAMS * count as u64)?;
        workspace.color = theirs("colors", colors, 4 * (extent.color_len * count) as u64)?;
        let recorded = Forward::new(self.context(), (&nothing, camera, settings, &extent), workspace);
        recorded.record(encoder, capacity.max(1))?;
        // The next drawing from the host brings its own.
        (workspace.params, workspace.color) = Default::default();
        Ok(Recorded { pixels: workspace.drawings[0].pixels.buffer(), totals: workspace.scratch.totals.buffer() })
    }
}

fn theirs(what: &str, buffer: &wgpu::Buffer, needed: u64) -> Result<Room, GpuError> {
    if buffer.size() >= needed.max(16) {
        return Ok(Room::of(buffer, needed));
    }
    let (found, needed) = (buffer.size(), needed.max(16));
    Err(GpuError::Buffer { what: format!("{what} of the Gaussians"), needed, found })
}
