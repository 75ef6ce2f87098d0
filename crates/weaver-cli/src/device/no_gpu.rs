//! A program that was built without GPUs.

use crate::Console;
use crate::failure::Failure;
use serde_json::Value;
use std::convert::Infallible;
use std::sync::Arc;
use weaver_fit::FitRasterizer;
use weaver_scene::{CameraSlices, GaussianSlices};
use weaver_splat::{Cotangents, Gradients, Images, RasterError, RasterSettings, RasterStats};

/// A device, of which there is none.
#[derive(Debug)]
pub struct Device(Infallible);

impl Device {
    pub fn open(name: &str) -> Result<Self, Failure> {
        Err(not_built(&format!("--device {name}")))
    }

    pub fn into_rasterizer(self) -> Arc<dyn FitRasterizer> {
        match self.0 {}
    }

    pub fn measured(self) -> Self {
        self
    }

    pub fn forward(
        &mut self,
        _: (&GaussianSlices<'_, f32>, &CameraSlices<'_, f32>),
        _: &RasterSettings,
        _: Images<'_, f32>,
    ) -> Result<RasterStats, RasterError> {
        match self.0 {}
    }

    pub fn backward(
        &mut self,
        _: (&GaussianSlices<'_, f32>, &CameraSlices<'_, f32>),
        _: &RasterSettings,
        _: &Cotangents<'_, f32>,
        _: Gradients<'_, f32>,
    ) -> Result<(), RasterError> {
        match self.0 {}
    }

    pub fn passes(&mut self) -> Vec<(&'static str, f64)> {
        match self.0 {}
    }

    pub fn transfers(&mut self) -> [u64; 2] {
        match self.0 {}
    }

    pub fn title(&self) -> String {
        match self.0 {}
    }

    pub fn json(&self) -> Value {
        match self.0 {}
    }
}

pub fn list(_: bool, _: &mut Console) -> Result<(), Failure> {
    Err(not_built("--devices"))
}

fn not_built(flag: &str) -> Failure {
    Failure::Usage(format!(
        "{flag}: expected a program that can draw on GPUs, found one that was built without; build it with \
         `cargo build --release --features gpu`"
    ))
}
