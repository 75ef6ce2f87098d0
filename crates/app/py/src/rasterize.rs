//! Drawing arrays of Python.

use crate::arrays::{AnyArrays, Arrays, Scalar, Settings, slice_mut};
use crate::failed::Failed;
use crate::failure_kind::FailureKind;
use crate::kept::{Drawing, Kept, Shelved};
use crate::threads::compute;
use numpy::{Element, PyReadwriteArrayDyn};
use pyo3::prelude::*;
use std::sync::Mutex;
use weaver_splat::{Images, Session, Workspace};

type Write<'py, T> = Option<PyReadwriteArrayDyn<'py, T>>;

/// Arrays to draw into: image `[C, H, W, 3]`, alpha `[C, H, W, 1]`, depth `[C, H, W, 1]` and features `[C, H, W, F]`,
/// None where there are none.
#[derive(Debug, FromPyObject)]
#[allow(clippy::type_complexity)]
pub struct Planes<'py, T: Element>((Write<'py, T>, Write<'py, T>, Write<'py, T>, Write<'py, T>));

/// [`Planes`] of either number type.
#[derive(FromPyObject)]
pub enum AnyPlanes<'py> {
    Single(Planes<'py, f32>),
    Double(Planes<'py, f64>),
}

/// Refuses arrays of `bytes` bytes where there is no memory for them.
#[pyfunction]
pub fn check_memory(bytes: u64) -> Result<(), Failed> {
    let refused = weaver_command::memory::check(bytes, "fewer pixels or cameras take less").err();
    refused.map_or(Ok(()), |failure| Err(Failed::new(FailureKind::Memory, failure.line().unwrap_or_default())))
}

/// Draws into arrays, and returns the state for gradients.
#[pyfunction]
pub fn rasterize<'py>(
    py: Python<'py>,
    arrays: AnyArrays<'py>,
    planes: AnyPlanes<'py>,
    settings: Settings,
) -> PyResult<Drawing> {
    let kept = match (&arrays, planes) {
        (AnyArrays::Single(arrays), AnyPlanes::Single(planes)) => Kept::Single(drawn(py, arrays, planes, &settings)?),
        (AnyArrays::Double(arrays), AnyPlanes::Double(planes)) => Kept::Double(drawn(py, arrays, planes, &settings)?),
        _ => return Err(Failed::input("rasterize: expected planes of the number type of the arrays").into()),
    };
    Ok(Drawing::new(kept, settings))
}

fn drawn<T: Scalar>(
    py: Python<'_>,
    arrays: &Arrays<'_, T>,
    mut planes: Planes<'_, T>,
    settings: &Settings,
) -> Result<Mutex<Shelved<T>>, Failed>
where
    Workspace<T>: Session<T>,
{
    let views = settings.views(arrays)?;
    let gaussians = settings.gaussians(arrays)?;
    let cameras = settings.cameras(arrays, &views)?;
    let raster = settings.raster()?;
    let (image, alpha, depth, features) = &mut planes.0;
    let empty = || Ok::<_, Failed>(&mut [][..]);
    let images = Images {
        image: image.as_mut().map_or_else(empty, |array| slice_mut("image", array))?,
        alpha: alpha.as_mut().map_or_else(empty, |array| slice_mut("alpha", array))?,
        depth: depth.as_mut().map(|array| slice_mut("depth", array)).transpose()?,
        features: features.as_mut().map(|array| slice_mut("features", array)).transpose()?,
    };
    compute(py, move || {
        let mut kept = Shelved::<T>::take();
        kept.workspace().forward(&gaussians, &cameras, &raster, images)?;
        Ok(Mutex::new(kept))
    })
}
