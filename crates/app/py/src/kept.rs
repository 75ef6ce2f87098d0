//! State between a drawing and its gradients.

use crate::failed::Failed;
use crate::rasterize::{AnyArrays, Arrays, Scalar, Settings, slice};
use crate::threads::compute;
use numpy::{IntoPyArray, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, ndarray::IxDyn};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::sync::{Mutex, MutexGuard, PoisonError};
use weaver_splat::{Cotangents, GaussianStatistics, Gradients, Session, Target, Workspace};

/// A drawing: what its gradients need, and where its Gaussians are on the image.
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

/// Gradients with respect to image, alpha, depth and features.
#[derive(FromPyObject)]
pub enum AnyCotangents<'py> {
    Single((Cotangent<'py, f32>, Cotangent<'py, f32>, Cotangent<'py, f32>, Cotangent<'py, f32>)),
    Double((Cotangent<'py, f64>, Cotangent<'py, f64>, Cotangent<'py, f64>, Cotangent<'py, f64>)),
}

impl Drawing {
    pub fn new(kept: Kept, settings: Settings) -> Self {
        Self { kept, settings }
    }
}

#[pymethods]
impl Drawing {
    /// Gradients in the order of the arrays that were drawn; None for those that are not wanted.
    ///
    /// With `statistics`, absolute screen gradients are summed as well.
    fn backward<'py>(
        &self,
        py: Python<'py>,
        arrays: AnyArrays<'py>,
        cotangents: AnyCotangents<'py>,
        wanted: [bool; 9],
        statistics: bool,
    ) -> Answer<'py> {
        match (&self.kept, arrays, cotangents) {
            (Kept::Single(kept), AnyArrays::Single(arrays), AnyCotangents::Single((a, b, c, d))) => {
                differentiated(py, lock(kept), &arrays, [a, b, c, d], (&self.settings, wanted, statistics))
            }
            (Kept::Double(kept), AnyArrays::Double(arrays), AnyCotangents::Double((a, b, c, d))) => {
                differentiated(py, lock(kept), &arrays, [a, b, c, d], (&self.settings, wanted, statistics))
            }
            _ => Err(Failed::input("backward: expected numbers of the type that was drawn").into()),
        }
    }

    /// Centers `[C, N, 2]`, radii `[C, N, 2]` and depths `[C, N]` on the image; zeros for Gaussians that are not seen.
    fn splats<'py>(&self, py: Python<'py>) -> Answer<'py> {
        match &self.kept {
            Kept::Single(kept) => splats(py, lock(kept), &self.settings),
            Kept::Double(kept) => splats(py, lock(kept), &self.settings),
        }
    }

    /// Gradients with respect to the centers, `[C, N, 2]`, and their absolute sums, None without statistics.
    fn screen_gradients<'py>(&self, py: Python<'py>) -> Answer<'py> {
        match &self.kept {
            Kept::Single(kept) => screen_gradients(py, lock(kept)),
            Kept::Double(kept) => screen_gradients(py, lock(kept)),
        }
    }
}

fn lock<T: Scalar>(kept: &Mutex<Shelved<T>>) -> MutexGuard<'_, Shelved<T>> {
    kept.lock().unwrap_or_else(PoisonError::into_inner)
}

/// An array of this shape that takes the numbers over.
pub fn shaped<'py, T: numpy::Element>(
    py: Python<'py>,
    values: Vec<T>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    values.into_pyarray(py).reshape(IxDyn(shape))
}

fn differentiated<'py, T: Scalar>(
    py: Python<'py>,
    mut kept: MutexGuard<'_, Shelved<T>>,
    arrays: &Arrays<'py, T>,
    cotangents: [Cotangent<'py, T>; 4],
    (settings, wanted, statistics): (&Settings, [bool; 9], bool),
) -> Answer<'py>
where
    Workspace<T>: Session<T>,
{
    let views = settings.views(arrays)?;
    let gaussians = settings.gaussians(arrays)?;
    let cameras = settings.cameras(arrays, &views)?;
    let [image, alpha, depth, features] = cotangents
        .each_ref()
        .map(|cotangent| cotangent.as_ref().map(|cotangent| slice("cotangent", cotangent)).transpose());
    let cotangents = Cotangents { image: image?, alpha: alpha?, depth: depth?, features: features? };
    let (shapes, raster) = (arrays.shapes(), settings.raster());
    let n = gaussians.opacities.len();
    let workspace = kept.workspace();
    let gradients = compute(py, move || {
        let mut out: [Option<Vec<T>>; 9] = std::array::from_fn(|i| {
            let length = if i == 7 { 4 * cameras.views() } else { shapes[i].iter().product() };
            wanted[i].then(|| vec![T::ZERO; length])
        });
        let [means, quats, scales, opacities, colors, features, viewmats, intrinsics, background] =
            out.each_mut().map(|values| values.as_mut().map(|values| Target::write(values)));
        let mut sums = vec![GaussianStatistics::default(); if statistics { n } else { 0 }];
        let statistics = statistics.then_some(&mut sums[..]);
        let targets = Gradients {
            means,
            quats,
            scales,
            opacities,
            colors,
            features,
            viewmats,
            intrinsics,
            background,
            statistics,
        };
        workspace.backward(&gaussians, &cameras, &raster, &cotangents, targets)?;
        out[7] = out[7].take().map(|intrinsics| matrices(&intrinsics));
        Ok(out)
    })?;
    let shapes = arrays.shapes();
    let gradients = gradients
        .into_iter()
        .zip(shapes)
        .map(|(gradient, shape)| gradient.map(|gradient| shaped(py, gradient, shape)).transpose());
    PyTuple::new(py, gradients.collect::<PyResult<Vec<_>>>()?)
}

/// Gradients of fx, fy, cx and cy where they are in matrices of intrinsics, `[C, 3, 3]`.
fn matrices<T: Scalar>(intrinsics: &[T]) -> Vec<T> {
    let zero = T::ZERO;
    let matrix = |k: &[T]| [k[0], zero, k[2], zero, k[1], k[3], zero, zero, zero];
    intrinsics.chunks_exact(4).flat_map(matrix).collect()
}

fn splats<'py, T: Scalar>(py: Python<'py>, mut kept: MutexGuard<'_, Shelved<T>>, settings: &Settings) -> Answer<'py> {
    let workspace = kept.workspace();
    let (centers, radii, depths) = py.detach(|| {
        let all = workspace.splats().map_err(Failed::from)?;
        let mut centers = Vec::with_capacity(2 * all.len());
        let mut radii = Vec::with_capacity(2 * all.len());
        let mut depths = Vec::with_capacity(all.len());
        for splat in all {
            let known = splat.unwrap_or_default();
            centers.extend(known.center);
            radii.extend(known.radii.map(|radius| radius.to_f64().ceil() as i32));
            depths.push(known.depth);
        }
        Ok::<_, Failed>((centers, radii, depths))
    })?;
    let n = depths.len() / settings.views;
    let (views, depths) = (settings.views, shaped(py, depths, &[settings.views, n])?);
    let (centers, radii) = (shaped(py, centers, &[views, n, 2])?, shaped(py, radii, &[views, n, 2])?);
    (centers, radii, depths).into_pyobject(py)
}

fn screen_gradients<'py, T: Scalar>(py: Python<'py>, mut kept: MutexGuard<'_, Shelved<T>>) -> Answer<'py> {
    let workspace = kept.workspace();
    let all = py.detach(|| workspace.screen_gradients()).map_err(Failed::from)?;
    let absolute: Option<Vec<T>> =
        all.iter().map(|gradient| gradient.absolute).collect::<Option<Vec<_>>>().map(|pairs| pairs.into_flattened());
    let plain: Vec<T> = all.iter().flat_map(|gradient| gradient.plain).collect();
    (plain.into_pyarray(py), absolute.map(|absolute| absolute.into_pyarray(py))).into_pyobject(py)
}
