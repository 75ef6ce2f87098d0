//! A rasterizer for workloads: the processor or a device, with its memory and the times of its parts.

use weaver_command::device::Device;
use weaver_scene::{CameraSlices, GaussianSlices};
use weaver_splat::{
    Cotangents, Gradients, Images, RasterError, RasterSettings, RasterStats, Workspace, rasterize, rasterize_backward,
};

/// A rasterizer with its memory.
pub enum Draws {
    Processor(Box<Workspace<f32>>),
    Device(Box<Device>),
}

impl Draws {
    pub fn forward(
        &mut self,
        scene: (&GaussianSlices<'_, f32>, &CameraSlices<'_, f32>),
        settings: &RasterSettings,
        images: Images<'_, f32>,
    ) -> Result<RasterStats, RasterError> {
        match self {
            Self::Processor(workspace) => rasterize(scene.0, scene.1, settings, workspace, images),
            Self::Device(device) => device.forward(scene, settings, images),
        }
    }

    pub fn backward(
        &mut self,
        scene: (&GaussianSlices<'_, f32>, &CameraSlices<'_, f32>),
        settings: &RasterSettings,
        cotangents: &Cotangents<'_, f32>,
        gradients: Gradients<'_, f32>,
    ) -> Result<(), RasterError> {
        match self {
            Self::Processor(workspace) => {
                rasterize_backward(scene.0, scene.1, settings, workspace, cotangents, gradients)
            }
            Self::Device(device) => device.backward(scene, settings, cotangents, gradients),
        }
    }

    /// Times of the last drawing by the processor.
    #[cfg(feature = "lidar")]
    pub fn timings(&self) -> Option<weaver_splat::Timings> {
        match self {
            Self::Processor(workspace) => Some(workspace.timings()),
            Self::Device(_) => None,
        }
    }

    /// Milliseconds of the parts of the last drawing.
    pub fn stages(&mut self, backward: bool) -> Vec<(&'static str, f64)> {
        match self {
            Self::Processor(workspace) => {
                let timings = workspace.timings();
                let forward = [("project", timings.project), ("bin", timings.bin), ("composite", timings.blend)];
                let backward = backward.then_some(("backward", timings.backward));
                forward.into_iter().chain(backward).map(|(name, time)| (name, 1e3 * time.as_secs_f64())).collect()
            }
            Self::Device(device) => device.passes(),
        }
    }

    pub fn device(&self) -> Option<&Device> {
        match self {
            Self::Processor(_) => None,
            Self::Device(device) => Some(device),
        }
    }

    /// Bytes to the device and from it in the last drawing.
    pub fn transfers(&mut self) -> Option<[u64; 2]> {
        match self {
            Self::Processor(_) => None,
            Self::Device(device) => Some(device.transfers()),
        }
    }
}
