//! The rasterizer of this crate behind the trait for all.

use crate::error::RasterError;
use crate::gradients::{Cotangents, Gradients};
use crate::rasterize::rasterize;
use crate::rasterize_backward::rasterize_backward;
use crate::rasterizer::{Images, RasterStats, Rasterizer, Session};
use crate::settings::RasterSettings;
use crate::workspace::Workspace;
use std::any::Any;
use weaver_kernels::Real;
use weaver_scene::{CameraSlices, GaussianSlices};

/// The rasterizer of this crate, on the threads of the processor: [`rasterize`](crate::rasterize()) and
/// [`rasterize_backward`](crate::rasterize_backward()).
///
/// A session of it is a [`Workspace`].
#[derive(Clone, Copy, Debug, Default)]
pub struct CpuRasterizer;

impl<T: Real> Rasterizer<T> for CpuRasterizer {
    fn session(&self) -> Box<dyn Session<T>> {
        let of_scalar = |session: Box<dyn Any>| session.downcast().ok().map(|session| *session);
        let found = of_scalar(Box::new(single())).or_else(|| of_scalar(Box::new(double())));
        found.expect("a scalar is f32 or f64")
    }
}

fn single() -> Box<dyn Session<f32>> {
    Box::new(Workspace::<f32>::new())
}

fn double() -> Box<dyn Session<f64>> {
    Box::new(Workspace::<f64>::new())
}

/// Implements [`Session`] for one scalar at a time: a generic implementation would be compiled again in every crate
/// that makes a session.
macro_rules! session {
    ($scalar:ty) => {
        impl Session<$scalar> for Workspace<$scalar> {
            fn forward(
                &mut self,
                gaussians: &GaussianSlices<'_, $scalar>,
                cameras: &CameraSlices<'_, $scalar>,
                settings: &RasterSettings,
                images: Images<'_, $scalar>,
            ) -> Result<RasterStats, RasterError> {
                rasterize(gaussians, cameras, settings, self, images)
            }

            fn backward(
                &mut self,
                gaussians: &GaussianSlices<'_, $scalar>,
                cameras: &CameraSlices<'_, $scalar>,
                settings: &RasterSettings,
                cotangents: &Cotangents<'_, $scalar>,
                gradients: Gradients<'_, $scalar>,
            ) -> Result<(), RasterError> {
                rasterize_backward(gaussians, cameras, settings, self, cotangents, gradients)
            }
        }
    };
}

session!(f32);
session!(f64);
