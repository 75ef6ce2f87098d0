//! Drawing on a GPU.

use crate::Console;
use crate::failure::Failure;
use serde_json::{Value, json};
use std::convert::Infallible;
use std::sync::Arc;
use weaver_fit::FitRasterizer;
use weaver_gpu::{Adapter, Choice, Context, GpuRasterizer, GpuWorkspace, PassTime, Transfers, adapters};
use weaver_scene::{CameraSlices, GaussianSlices};
use weaver_splat::{Cotangents, Gradients, Images, RasterError, RasterSettings, RasterStats};

/// A device with the memory for drawing on it.
#[derive(Debug)]
pub struct Device {
    rasterizer: GpuRasterizer,
    workspace: GpuWorkspace,
}

impl Device {
    /// A device by its name: `gpu`, `gpu:N` or a part of a name.
    pub fn open(name: &str) -> Result<Self, Failure> {
        let choice = name.parse::<Choice>().unwrap_or_else(|never: Infallible| match never {});
        let rasterizer = GpuRasterizer::new(Context::open(&choice)?);
        Ok(Self { workspace: rasterizer.workspace(), rasterizer })
    }

    /// The rasterizer of this device.
    pub fn into_rasterizer(self) -> Arc<dyn FitRasterizer> {
        Arc::new(self.rasterizer)
    }

    /// The same device, with every pass measured.
    pub fn measured(self) -> Self {
        let rasterizer = self.rasterizer.measured();
        Self { workspace: rasterizer.workspace(), rasterizer }
    }

    /// Images of the cameras, as the rasterizer draws them.
    pub fn forward(
        &mut self,
        (gaussians, cameras): (&GaussianSlices<'_, f32>, &CameraSlices<'_, f32>),
        settings: &RasterSettings,
        images: Images<'_, f32>,
    ) -> Result<RasterStats, RasterError> {
        self.rasterizer.forward(gaussians, cameras, settings, &mut self.workspace, images)
    }

    /// Gradients of the inputs, after [`forward`](Self::forward) of the same scene.
    pub fn backward(
        &mut self,
        (gaussians, cameras): (&GaussianSlices<'_, f32>, &CameraSlices<'_, f32>),
        settings: &RasterSettings,
        cotangents: &Cotangents<'_, f32>,
        gradients: Gradients<'_, f32>,
    ) -> Result<(), RasterError> {
        self.rasterizer.backward(gaussians, cameras, settings, &mut self.workspace, cotangents, gradients)
    }

    /// Milliseconds of all runs of each pass since the last call; empty where the device has no clock.
    pub fn passes(&mut self) -> Vec<(&'static str, f64)> {
        let pass = |pass: PassTime| (pass.name, 1e3 * pass.time.as_secs_f64());
        self.workspace.pass_times().into_iter().map(pass).collect()
    }

    /// Bytes to the device and from it since the last call.
    pub fn transfers(&mut self) -> [u64; 2] {
        let Transfers { to_device, from_device } = self.workspace.transfers();
        [to_device, from_device]
    }

    /// Its name, for people.
    pub fn title(&self) -> String {
        self.rasterizer.context().adapter().to_string()
    }

    /// Its name, kind, driver and limits, as JSON.
    pub fn json(&self) -> Value {
        described(self.rasterizer.context().adapter())
    }
}

/// Prints the devices that there are.
pub fn list(json: bool, console: &mut Console) -> Result<(), Failure> {
    let found = adapters();
    if json {
        return console.print(&serde_json::to_string_pretty(&found.iter().map(described).collect::<Vec<_>>())?);
    }
    if found.is_empty() {
        return console.print("no devices, neither GPUs nor software ones; is a Vulkan driver installed?");
    }
    let line = |adapter: &Adapter| {
        let ([least, most], mib) = (adapter.subgroups, adapter.binding_bytes >> 20);
        format!("gpu:{} {adapter}; bindings of {mib} MiB, subgroups of {least} to {most}", adapter.number)
    };
    console.print(&found.iter().map(line).collect::<Vec<_>>().join("\n"))
}

fn described(adapter: &Adapter) -> Value {
    json!({
        "number": adapter.number,
        "name": adapter.name,
        "kind": adapter.kind.to_string(),
        "backend": adapter.backend,
        "driver": adapter.driver,
        "binding_bytes": adapter.binding_bytes,
        "subgroups": adapter.subgroups,
    })
}
