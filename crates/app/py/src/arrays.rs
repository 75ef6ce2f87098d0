//! Arrays of Python as the rasterizer takes them.

use crate::failed::Failed;
use numpy::{Element, PyReadonlyArrayDyn, PyReadwriteArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use std::sync::Mutex;
use weaver_kernels::Real;
use weaver_scene::{CameraSlices, Color, Features, GaussianSlices, Model};
use weaver_splat::{RasterSettings, Workspace};

/// A number type of arrays, with the workspaces that are kept for it.
pub trait Scalar: Real + Element {
    fn shelf() -> &'static Mutex<Vec<Workspace<Self>>>;
}

macro_rules! scalar {
    ($scalar:ty) => {
        impl Scalar for $scalar {
            fn shelf() -> &'static Mutex<Vec<Workspace<Self>>> {
                static SHELF: Mutex<Vec<Workspace<$scalar>>> = Mutex::new(Vec::new());
                &SHELF
            }
        }
    };
}

scalar!(f32);
scalar!(f64);

type Read<'py, T> = PyReadonlyArrayDyn<'py, T>;

/// Gaussians and cameras as arrays: means `[N, 3]`, quats `[N, 4]`, scales `[N, 3]`, opacities `[N]`, colors `[N, 3]`,
/// `[N, K, 3]` or `[N, 0]`, features `[N, F]`, viewmats `[C, 4, 4]`, Ks `[C, 3, 3]`, background `[C, 3]`.
#[derive(Debug, FromPyObject)]
#[allow(clippy::type_complexity)]
pub struct Arrays<'py, T: Element>(
    (
        Read<'py, T>,
        Read<'py, T>,
        Read<'py, T>,
        Read<'py, T>,
        Read<'py, T>,
        Read<'py, T>,
        Read<'py, T>,
        Read<'py, T>,
        Read<'py, T>,
    ),
);

impl<T: Element> Arrays<'_, T> {
    /// The shape of each, in their order.
    pub fn shapes(&self) -> [&[usize]; 9] {
        let (a, b, c, d, e, f, g, h, i) = &self.0;
        [a, b, c, d, e, f, g, h, i].map(|array| array.shape())
    }
}

/// [`Arrays`] of either number type.
#[derive(FromPyObject)]
pub enum AnyArrays<'py> {
    Single(Arrays<'py, f32>),
    Double(Arrays<'py, f64>),
}

/// Rules of drawing, as Python gives them.
#[derive(Clone, Debug, FromPyObject)]
#[pyo3(from_item_all)]
pub struct Settings {
    pub width: usize,
    pub height: usize,
    near: f64,
    far: f64,
    eps2d: f64,
    alpha_max: f64,
    antialiased: bool,
    radius_clip: Option<f64>,
    degree: Option<usize>,
}

/// The numbers of an array in the order of its indices.
pub fn slice<'a, T: Element>(name: &str, array: &'a Read<'_, T>) -> Result<&'a [T], Failed> {
    array.as_slice().map_err(|error| Failed::input(format!("{name}: {error}")))
}

impl Settings {
    /// The rules as the rasterizer takes them.
    ///
    /// # Errors
    /// When a number means nothing.
    pub fn raster(&self) -> Result<RasterSettings, Failed> {
        let Self { near, far, eps2d, alpha_max, antialiased, radius_clip, .. } = *self;
        checked(RasterSettings { near, far, eps2d, alpha_max, antialiased, radius_clip, ..RasterSettings::default() })
    }

    pub fn gaussians<'a, T: Scalar>(&self, arrays: &'a Arrays<'_, T>) -> Result<GaussianSlices<'a, T>, Failed> {
        let (means, quats, scales, opacities, colors, features, ..) = &arrays.0;
        let channels = features.shape().last().copied().unwrap_or(0);
        let colors = slice("colors", colors)?;
        let features = Features { values: slice("features", features)?, channels };
        Ok(GaussianSlices {
            means: slice("means", means)?,
            quats: slice("quats", quats)?,
            scales: slice("scales", scales)?,
            opacities: slice("opacities", opacities)?,
            color: match self.degree {
                Some(degree) => Color::Sh { coefficients: colors, degree },
                None if arrays.shapes()[4].last() == Some(&0) => Color::None,
                None => Color::Plain(colors),
            },
            features: (channels > 0).then_some(features),
            groups: None,
        })
    }

    /// fx, fy, cx and cy of each camera.
    pub fn views<T: Scalar>(&self, arrays: &Arrays<'_, T>) -> Result<Vec<T>, Failed> {
        let matrices = slice("Ks", &arrays.0.7)?;
        Ok(matrices.chunks_exact(9).flat_map(|k| [k[0], k[4], k[2], k[5]]).collect())
    }

    pub fn cameras<'a, T: Scalar>(
        &self,
        arrays: &'a Arrays<'_, T>,
        intrinsics: &'a [T],
    ) -> Result<CameraSlices<'a, T>, Failed> {
        Ok(CameraSlices {
            viewmats: slice("viewmats", &arrays.0.6)?,
            intrinsics,
            background: slice("backgrounds", &arrays.0.8)?,
            width: self.width,
            height: self.height,
            model: Model::Pinhole,
        })
    }
}

/// Rules of drawing whose numbers mean something.
pub fn checked(settings: RasterSettings) -> Result<RasterSettings, Failed> {
    let RasterSettings { near, far, eps2d, alpha_max, .. } = settings;
    let rules = [
        ("near", near, "a number", near.is_finite()),
        ("far", far, "a number, or infinity", !far.is_nan()),
        ("eps2d", eps2d, "a number of at least 0", eps2d.is_finite() && eps2d >= 0.0),
        ("alpha_max", alpha_max, "a number above 0 and at most 1", alpha_max > 0.0 && alpha_max <= 1.0),
    ];
    match rules.into_iter().find(|(_, _, _, holds)| !holds) {
        Some((name, found, expected, _)) => Err(Failed::input(format!("{name}: expected {expected}, found {found}"))),
        None => Ok(settings),
    }
}

/// The memory of an array.
pub fn slice_mut<'a, T: Element>(name: &str, array: &'a mut PyReadwriteArrayDyn<'_, T>) -> Result<&'a mut [T], Failed> {
    array.as_slice_mut().map_err(|error| Failed::input(format!("{name}: {error}")))
}
