//! Cameras with the names of their photos.

use crate::failed::{Failed, check_ending};
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use std::path::PathBuf;
use weaver_geometry::{Camera as Pinhole, Intrinsics, Pose, Undistortion};
use weaver_io::Transforms;
use weaver_scene::Frame;

/// A camera as a file describes it.
#[pyclass(frozen, module = "splatweaver._splatweaver")]
#[derive(Clone, Debug)]
pub struct Camera(pub Frame);

#[pymethods]
impl Camera {
    #[new]
    fn new(
        viewmat: PyReadonlyArray2<'_, f64>,
        intrinsics: PyReadonlyArray2<'_, f64>,
        size: [usize; 2],
        name: String,
    ) -> Result<Self, Failed> {
        let (m, k) = (viewmat.as_array(), intrinsics.as_array());
        if viewmat.shape() != [4, 4] {
            return Err(Failed::input(format!("viewmat: expected [4, 4], found {:?}", viewmat.shape())));
        }
        if intrinsics.shape() != [3, 3] {
            return Err(Failed::input(format!("K: expected [3, 3], found {:?}", intrinsics.shape())));
        }
        let [width, height] = checked_size(size)?;
        let rows = std::array::from_fn(|i| std::array::from_fn(|j| m[[i, j]]));
        let pose = Pose::from_rows(&rows).map_err(|error| Failed::input(format!("viewmat: {error}")))?;
        let [fx, fy, cx, cy] = [k[[0, 0]], k[[1, 1]], k[[0, 2]], k[[1, 2]]];
        if !(fx > 0.0 && fy > 0.0 && [fx, fy, cx, cy].iter().all(|x| x.is_finite())) {
            return Err(Failed::input(format!(
                "K: expected positive focal lengths and finite numbers, found fx {fx}, fy {fy}, cx {cx}, cy {cy}"
            )));
        }
        let intrinsics = Intrinsics { fx, fy, cx, cy };
        Ok(Self(Frame::new(name, Pinhole { pose, intrinsics, width, height })))
    }

    /// World to camera, `[4, 4]`.
    #[getter]
    fn viewmat<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let pose = &self.0.camera.pose;
        let (r, t) = (pose.rotation.to_cols_array_2d(), pose.translation.to_array());
        let entry = |at: usize| match (at / 4, at % 4) {
            (3, j) => f64::from(u8::from(j == 3)),
            (i, 3) => t[i],
            (i, j) => r[j][i],
        };
        matrix(py, (0..16).map(entry).collect(), 4)
    }

    /// Intrinsics in pixels, `[3, 3]`.
    #[getter]
    fn intrinsics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let Intrinsics { fx, fy, cx, cy } = self.0.camera.intrinsics;
        matrix(py, vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0], 3)
    }

    #[getter]
    fn size(&self) -> [usize; 2] {
        [self.0.camera.width, self.0.camera.height]
    }

    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    /// Path of the photo, as given in the file.
    #[getter]
    fn path(&self) -> PathBuf {
        self.0.path.clone()
    }

    /// True if the photo has a distortion, which drawing leaves out.
    #[getter]
    fn distorted(&self) -> bool {
        self.0.distortion.is_some()
    }

    /// The camera of the photo whose distortion is undone.
    fn undistorted(&self) -> Result<Self, Failed> {
        let Some(distortion) = self.0.distortion else { return Ok(self.clone()) };
        let undone = Undistortion::new(self.0.camera, distortion)
            .ok_or_else(|| Failed::input(format!("{}: the distortion leaves nothing of the photo", self.0.name)))?;
        Ok(Self(Frame { camera: undone.to, distortion: None, ..self.0.clone() }))
    }

    /// The same camera with an image of another size.
    fn resized(&self, width: usize, height: usize) -> Result<Self, Failed> {
        let [width, height] = checked_size([width, height])?;
        let camera = self.0.camera;
        let [sx, sy] = [width as f64 / camera.width as f64, height as f64 / camera.height as f64];
        let camera = Pinhole { intrinsics: camera.intrinsics.resized(sx, sy), width, height, ..camera };
        Ok(Self(Frame { camera, ..self.0.clone() }))
    }
}

/// The longest side of a picture, as `rasterization` has it.
const LONGEST: usize = 1 << 20;

/// Width and height of a picture that can be drawn.
fn checked_size([width, height]: [usize; 2]) -> Result<[usize; 2], Failed> {
    if [width, height].iter().all(|side| (1..=LONGEST).contains(side)) {
        return Ok([width, height]);
    }
    Err(Failed::input(format!("width, height: expected 1 to {LONGEST} pixels, found {width} x {height}")))
}

fn matrix(py: Python<'_>, values: Vec<f64>, side: usize) -> PyResult<Bound<'_, PyArray2<f64>>> {
    numpy::PyArrayMethods::reshape(&values.into_pyarray(py), [side, side])
}

/// Reads a transforms.json, a folder with a COLMAP model, or a RealEstate10K file.
#[pyfunction]
pub fn read_cameras(py: Python<'_>, path: PathBuf) -> Result<Vec<Camera>, Failed> {
    let frames = py.detach(|| weaver_io::read_cameras(path))?;
    Ok(frames.into_iter().map(Camera).collect())
}

/// Writes a transforms.json.
#[pyfunction]
pub fn write_cameras(py: Python<'_>, path: PathBuf, cameras: Vec<Py<Camera>>) -> Result<(), Failed> {
    check_ending(&path, "json")?;
    let frames = cameras.iter().map(|camera| camera.get().0.clone()).collect();
    Ok(py.detach(|| Transforms { frames, ..Transforms::default() }.write(path))?)
}
