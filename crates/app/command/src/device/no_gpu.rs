//! A program that was built without GPUs.

use crate::Console;
use crate::failure::Failure;
use serde_json::Value;
use std::convert::Infallible;
use std::sync::Arc;
use weaver_fit::FitRasterizer;
use weaver_scene::{CameraSlices, GaussianSlices};
use weaver_splat::{Cotangents, Gradients, Images, RasterError, RasterSettings, RasterStats};

/// A device that cannot exist.
#[derive(Debug)]
pub struct Device(Infallible);

impl Device {
    /// A device by its name: `gpu`, `gpu:N` or a part of a name.
    pub fn open(name: &str) -> Result<Self, Failure> {
        Err(not_built(&format!("--device {name}")))
    }

    /// The rasterizer of this device.
    pub fn into_rasterizer(self) -> Arc<dyn FitRasterizer> {
        match self.0 {}
    }

    /// The same device, with every pass measured.
    pub fn measured(self) -> Self {
        self
    }

    /// Images of the cameras, as the rasterizer draws them.
    pub fn forward(
        &mut self,
        _: (&GaussianSlices<'_, f32>, &CameraSlices<'_, f32>),
        _: &RasterSettings,
        _: Images<'_, f32>,
    ) -> Result<RasterStats, RasterError> {
        match self.0 {}
    }

    /// Gradients of the inputs, after [`forward`](Self::forward) of the same scene.
    pub fn backward(
        &mut self,
        _: (&GaussianSlices<'_, f32>, &CameraSlices<'_, f32>),
        _: &RasterSettings,
        _: &Cotangents<'_, f32>,
        _: Gradients<'_, f32>,
    ) -> Result<(), RasterError> {
        match self.0 {}
    }

    /// Milliseconds of all runs of each pass since the last call; empty where the device has no clock.
    pub fn passes(&mut self) -> Vec<(&'static str, f64)> {
        match self.0 {}
    }

    /// Bytes to the device and from it since the last call.
    pub fn transfers(&mut self) -> [u64; 2] {
        match self.0 {}
    }

    /// Its name, for people.
    pub fn title(&self) -> String {
        match self.0 {}
    }

    /// Its name, kind, driver and limits, as JSON.
    pub fn json(&self) -> Value {
        match self.0 {}
    }
}

/// Prints the devices that there are.
pub fn list(_: bool, _: &mut Console) -> Result<(), Failure> {
    Err(not_built("--devices"))
}

fn not_built(flag: &str) -> Failure {
    Failure::Usage(format!(
        "{flag}: expected a program that can draw on GPUs, found one that was built without; build it with \
         `cargo build --release --features gpu`"
    ))
}
