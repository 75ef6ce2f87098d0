//! State between a drawing and its gradients.

use crate::arrays::{AnyArrays, Arrays, Scalar, Settings, slice, slice_mut};
use crate::failed::Failed;
use crate::threads::on_pool;
use numpy::ndarray::IxDyn;
use numpy::{Element, IntoPyArray, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyReadwriteArrayDyn};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::sync::{Mutex, PoisonError};
use weaver_splat::{Cotangents, GaussianStatistics, Gradients, Session, Target, Workspace};

/// A drawing: the state for its gradients, and the places of its Gaussians on the image.
#[pyclass(frozen, module = "splatweaver._splatweaver")]
#[derive(Debug)]
pub struct Drawing {
    kept: Kept,
    settings: Settings,
}

/// The memory of a drawing, of either number type.
#[derive(Debug)]
pub enum Kept {
    Single(Mutex<Shelved<f32>>),
    Double(Mutex<Shelved<f64>>),
}

/// A workspace that goes back to where the next drawing finds it.
#[derive(Debug)]
pub struct Shelved<T: Scalar>(Option<Workspace<T>>);

/// Workspaces kept for later drawings, at most.
const SHELF: usize = 2;

impl<T: Scalar> Shelved<T> {
    pub fn take() -> Self {
        let kept = T::shelf().lock().unwrap_or_else(PoisonError::into_inner).pop();
        Self(Some(kept.unwrap_or_default()))
    }

    pub fn workspace(&mut self) -> &mut Workspace<T> {
        self.0.get_or_insert_default()
    }
}

impl<T: Scalar> Drop for Shelved<T> {
    fn drop(&mut self) {
        let mut shelf = T::shelf().lock().unwrap_or_else(PoisonError::into_inner);
        if shelf.len() < SHELF {
            shelf.extend(self.0.take());
        }
    }
}

type Answer<'py> = PyResult<Bound<'py, PyTuple>>;
type Cotangent<'py, T> = Option<PyReadonlyArrayDyn<'py, T>>;
type FourCotangents<'py, T> = (Cotangent<'py, T>, Cotangent<'py, T>, Cotangent<'py, T>, Cotangent<'py, T>);
type Write<'py, T> = Option<PyReadwriteArrayDyn<'py, T>>;

/// Gradients with respect to image, alpha, depth and features.
#[derive(FromPyObject)]
pub enum AnyCotangents<'py> {
    Single(FourCotangents<'py, f32>),
    Double(FourCotangents<'py, f64>),
}

/// Memory for the gradients of the arrays that were drawn.
#[derive(FromPyObject)]
#[allow(clippy::type_complexity)]
pub struct NineGradients<'py, T: Element>(
    (
        Write<'py, T>,
        Write<'py, T>,
        Write<'py, T>,
        Write<'py, T>,
        Write<'py, T>,
        Write<'py, T>,
        Write<'py, T>,
        Write<'py, T>,
        Write<'py, T>,
    ),
);

/// [`NineGradients`] of either number type.
#[derive(FromPyObject)]
pub enum AnyGradients<'py> {
    Single(NineGradients<'py, f32>),
    Double(NineGradients<'py, f64>),
}

impl Drawing {
    pub fn new(kept: Kept, settings: Settings) -> Self {
        Self { kept, settings }
    }
}

#[pymethods]
impl Drawing {
    /// Writes gradients into arrays, in the order and with the shapes of the drawn arrays; None for gradients that are
    /// not wanted.
    ///
    /// With `statistics`, absolute screen gradients are summed as well.
    fn backward<'py>(
        &self,
        py: Python<'py>,
        arrays: AnyArrays<'py>,
        cotangents: AnyCotangents<'py>,
        into: AnyGradients<'py>,
        statistics: bool,
    ) -> Result<(), Failed> {
        match (&self.kept, arrays, cotangents, into) {
            (
                Kept::Single(kept),
                AnyArrays::Single(arrays),
                AnyCotangents::Single(given),
                AnyGradients::Single(into),
            ) => differentiate(py, kept, (&arrays, given, into), (&self.settings, statistics)),
            (
                Kept::Double(kept),
                AnyArrays::Double(arrays),
                AnyCotangents::Double(given),
                AnyGradients::Double(into),
            ) => differentiate(py, kept, (&arrays, given, into), (&self.settings, statistics)),
            _ => Err(Failed::input("backward: expected numbers of the type that was drawn")),
        }
    }

    /// Centers `[C, N, 2]`, radii `[C, N, 2]` and depths `[C, N]` on the image, as rows of numbers; zeros for Gaussians
    /// that are not seen.
    fn splats<'py>(&self, py: Python<'py>) -> Answer<'py> {
        match &self.kept {
            Kept::Single(kept) => splats(py, kept),
            Kept::Double(kept) => splats(py, kept),
        }
    }

    /// Gradients with respect to the centers, `[C, N, 2]`, and their absolute sums, None without statistics.
    fn screen_gradients<'py>(&self, py: Python<'py>) -> Answer<'py> {
        match &self.kept {
            Kept::Single(kept) => screen_gradients(py, kept),
            Kept::Double(kept) => screen_gradients(py, kept),
        }
    }
}

/// Runs `job` on the memory of a drawing, with the lock of the interpreter released.
///
/// A thread waits for a drawing without the interpreter's lock, which the thread that holds the drawing needs to go on.
fn with_workspace<T: Scalar, R: Send>(
    py: Python<'_>,
    kept: &Mutex<Shelved<T>>,
    job: impl FnOnce(&mut Workspace<T>) -> Result<R, Failed> + Send,
) -> Result<R, Failed> {
    py.detach(|| job(kept.lock().unwrap_or_else(PoisonError::into_inner).workspace()))
}

/// An array of this shape that takes the numbers over.
pub fn shaped<'py, T: numpy::Element>(
    py: Python<'py>,
    values: Vec<T>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    values.into_pyarray(py).reshape(IxDyn(shape))
}

fn differentiate<T: Scalar>(
    py: Python<'_>,
    kept: &Mutex<Shelved<T>>,
    (arrays, given, mut into): (&Arrays<'_, T>, FourCotangents<'_, T>, NineGradients<'_, T>),
    (settings, statistics): (&Settings, bool),
) -> Result<(), Failed>
where
    Workspace<T>: Session<T>,
{
    let views = settings.views(arrays)?;
    let gaussians = settings.gaussians(arrays)?;
    let cameras = settings.cameras(arrays, &views)?;
    let [image, alpha, depth, features] = [&given.0, &given.1, &given.2, &given.3]
        .map(|cotangent| cotangent.as_ref().map(|cotangent| slice("cotangent", cotangent)).transpose());
    let cotangents = Cotangents { image: image?, alpha: alpha?, depth: depth?, features: features? };
    let raster = settings.raster()?;
    let n = gaussians.opacities.len();
    let NineGradients((a, b, c, d, e, f, g, h, i)) = &mut into;
    let [means, quats, scales, opacities, colors, features, viewmats, background] =
        [a, b, c, d, e, f, g, i].map(|array| array.as_mut().map(|array| slice_mut("gradient", array)).transpose());
    let matrices = h.as_mut().map(|array| slice_mut("gradient", array)).transpose()?;
    let mut intrinsics = vec![T::ZERO; 4 * cameras.views()];
    let mut sums = vec![GaussianStatistics::default(); if statistics { n } else { 0 }];
    let targets = Gradients {
        means: target(means)?,
        quats: target(quats)?,
        scales: target(scales)?,
        opacities: target(opacities)?,
        colors: target(colors)?,
        features: target(features)?,
        viewmats: target(viewmats)?,
        intrinsics: matrices.is_some().then(|| Target::write(&mut intrinsics)),
        background: target(background)?,
        statistics: statistics.then_some(&mut sums[..]),
    };
    with_workspace(py, kept, |workspace| {
        on_pool(|| Ok(workspace.backward(&gaussians, &cameras, &raster, &cotangents, targets)?))
    })?;
    if let Some(matrices) = matrices {
        put_intrinsics(&intrinsics, matrices);
    }
    Ok(())
}

/// A gradient's memory as the rasterizer takes it.
fn target<T: Scalar>(values: Result<Option<&mut [T]>, Failed>) -> Result<Option<Target<'_, T>>, Failed> {
    Ok(values?.map(Target::write))
}

/// Puts gradients of fx, fy, cx and cy where they are in matrices of intrinsics, `[C, 3, 3]`.
fn put_intrinsics<T: Scalar>(intrinsics: &[T], matrices: &mut [T]) {
    let zero = T::ZERO;
    for (matrix, k) in matrices.chunks_exact_mut(9).zip(intrinsics.chunks_exact(4)) {
        matrix.copy_from_slice(&[k[0], zero, k[2], zero, k[1], k[3], zero, zero, zero]);
    }
}

fn splats<'py, T: Scalar>(py: Python<'py>, kept: &Mutex<Shelved<T>>) -> Answer<'py> {
    let all = with_workspace(py, kept, |workspace| Ok(workspace.splats()?))?;
    let known = || all.iter().map(|splat| splat.unwrap_or_default());
    let centers: Vec<T> = known().flat_map(|splat| splat.center).collect();
    let radii: Vec<i32> = known().flat_map(|splat| splat.radii).map(|radius| radius.to_f64().ceil() as i32).collect();
    let depths: Vec<T> = known().map(|splat| splat.depth).collect();
    (centers.into_pyarray(py), radii.into_pyarray(py), depths.into_pyarray(py)).into_pyobject(py)
}

fn screen_gradients<'py, T: Scalar>(py: Python<'py>, kept: &Mutex<Shelved<T>>) -> Answer<'py> {
    let all = with_workspace(py, kept, |workspace| Ok(workspace.screen_gradients()?))?;
    let absolute: Option<Vec<T>> =
        all.iter().map(|gradient| gradient.absolute).collect::<Option<Vec<_>>>().map(|pairs| pairs.into_flattened());
    let plain: Vec<T> = all.iter().flat_map(|gradient| gradient.plain).collect();
    (plain.into_pyarray(py), absolute.map(|absolute| absolute.into_pyarray(py))).into_pyobject(py)
}
