//! Scenes of Gaussians in their stored form.

use crate::arrays::{checked, slice};
use crate::camera::Camera;
use crate::failed::{Failed, check_ending};
use crate::failure_kind::FailureKind;
use crate::kept::shaped;
use crate::rasterize::check_memory;
use crate::threads::compute;
use numpy::{PyArrayDyn, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::path::PathBuf;
use weaver_command::{DrawingOptions, memory::of_picture};
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Similarity, sh};
use weaver_io::{Drawing, SCENE_FORMATS, read_scene, write_scene, write_text};
use weaver_scene::{Gaussians, Region};
use weaver_splat::{RasterSettings, Workspace, render};
use weaver_view::{HtmlOptions, Look, Shot, Subject, html};

/// Gaussians, and how they are to be drawn.
#[pyclass(frozen, module = "splatweaver._splatweaver")]
#[derive(Debug)]
pub struct SceneData {
    gaussians: Gaussians,
    settings: RasterSettings,
    background: [f32; 3],
}

/// Formats of scenes: name, end of file names, and the kept attributes.
#[pyfunction]
pub fn formats() -> Vec<(String, String, String)> {
    let row = |format: &weaver_io::SceneFormat| {
        (format.name.to_string(), format.file_name_end().to_string(), format.keeps.to_string())
    };
    SCENE_FORMATS.iter().map(row).collect()
}

/// Writes an HTML page, whole or not at all.
#[pyfunction]
pub fn write_page(py: Python<'_>, path: PathBuf, page: &str) -> Result<(), Failed> {
    check_ending(&path, "html")?;
    Ok(py.detach(|| write_text(path, page))?)
}

type Array<'py> = PyReadonlyArrayDyn<'py, f32>;
type Out<'py> = PyResult<Bound<'py, PyArrayDyn<f32>>>;

#[pymethods]
impl SceneData {
    /// A scene of arrays: means `[N, 3]`, log_scales `[N, 3]`, quats `[N, 4]`, opacity_logits `[N]`, sh `[N, K, 3]`.
    #[new]
    fn new(
        means: Array<'_>,
        log_scales: Array<'_>,
        quats: Array<'_>,
        opacity_logits: Array<'_>,
        sh: Array<'_>,
        antialiased: bool,
    ) -> Result<Self, Failed> {
        let n = opacity_logits.len();
        let k = sh.shape().get(1).copied().unwrap_or(0);
        let degree = (0..=sh::MAX_DEGREE).find(|degree| sh::coefficients(*degree) == k);
        let degree = degree.ok_or_else(|| {
            Failed::input(format!("sh: expected [N, K, 3] with K of 1, 4, 9, 16 or 25, found {:?}", sh.shape()))
        })?;
        for (name, array, shape) in [
            ("means", &means, &[n, 3][..]),
            ("log_scales", &log_scales, &[n, 3]),
            ("quats", &quats, &[n, 4]),
            ("opacity_logits", &opacity_logits, &[n]),
            ("sh", &sh, &[n, k, 3]),
        ] {
            if array.shape() != shape {
                return Err(Failed::input(format!("{name}: expected {shape:?}, found {:?}", array.shape())));
            }
        }
        let gaussians = Gaussians {
            means: slice("means", &means)?.as_chunks().0.to_vec(),
            log_scales: slice("log_scales", &log_scales)?.as_chunks().0.to_vec(),
            quats: slice("quats", &quats)?.as_chunks().0.to_vec(),
            opacity_logits: slice("opacity_logits", &opacity_logits)?.to_vec(),
            sh: slice("sh", &sh)?.to_vec(),
            degree,
        };
        Ok(Self {
            gaussians,
            settings: RasterSettings { antialiased, ..RasterSettings::default() },
            background: [1.0; 3],
        })
    }

    /// Reads a file, with the settings of drawing from a summary.json beside it, as on the command line.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> Result<Self, Failed> {
        compute(py, || {
            let file = read_scene(&path)?;
            let beside = DrawingOptions::default().beside(&path, file.drawing);
            let (background, settings) =
                beside.map_err(|failure| Failed::new(FailureKind::File, failure.line().unwrap_or_default()))?;
            Ok(Self { gaussians: file.gaussians, settings, background })
        })
    }

    /// Writes a file; its name selects the format.
    fn save(&self, py: Python<'_>, path: PathBuf) -> Result<(), Failed> {
        compute(py, || Ok(write_scene(&path, &self.gaussians, Drawing::antialiased(self.settings.antialiased))?))
    }

    #[getter]
    fn means<'py>(&self, py: Python<'py>) -> Out<'py> {
        shaped(py, self.gaussians.means.as_flattened().to_vec(), &[self.len(), 3])
    }

    #[getter]
    fn log_scales<'py>(&self, py: Python<'py>) -> Out<'py> {
        shaped(py, self.gaussians.log_scales.as_flattened().to_vec(), &[self.len(), 3])
    }

    #[getter]
    fn quats<'py>(&self, py: Python<'py>) -> Out<'py> {
        shaped(py, self.gaussians.quats.as_flattened().to_vec(), &[self.len(), 4])
    }

    #[getter]
    fn opacity_logits<'py>(&self, py: Python<'py>) -> Out<'py> {
        shaped(py, self.gaussians.opacity_logits.clone(), &[self.len()])
    }

    #[getter]
    fn sh<'py>(&self, py: Python<'py>) -> Out<'py> {
        shaped(py, self.gaussians.sh.clone(), &[self.len(), self.gaussians.coefficients(), 3])
    }

    /// Standard deviations `[N, 3]` and opacities `[N]`.
    fn activated<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let activated = self.gaussians.to_activated();
        let scales = shaped(py, activated.scales, &[self.len(), 3])?;
        (scales, shaped(py, activated.opacities, &[self.len()])?).into_pyobject(py)
    }

    #[getter]
    fn degree(&self) -> usize {
        self.gaussians.degree
    }

    #[getter]
    fn background(&self) -> [f32; 3] {
        self.background
    }

    /// Near plane, largest alpha, and whether opacities are lowered where a Gaussian is widened.
    #[getter]
    fn drawing(&self) -> (f64, f64, bool) {
        (self.settings.near, self.settings.alpha_max, self.settings.antialiased)
    }

    fn with_degree(&self, degree: usize) -> Result<Self, Failed> {
        if degree > sh::MAX_DEGREE {
            return Err(Failed::input(format!("degree: expected 0 to {}, found {degree}", sh::MAX_DEGREE)));
        }
        Ok(self.with(self.gaussians.with_degree(degree)))
    }

    /// The scene in the world that `scale * rotation * x + translation` leads to.
    fn transformed(
        &self,
        py: Python<'_>,
        scale: f64,
        rotation: [[f64; 3]; 3],
        translation: [f64; 3],
    ) -> Result<Self, Failed> {
        let rotation = DMat3::from_cols_array_2d(&rotation).transpose();
        let off = (rotation * rotation.transpose() - DMat3::IDENTITY).to_cols_array();
        if rotation.determinant() < 0.0 || off.iter().any(|x| x.is_nan() || x.abs() > 1e-5) {
            return Err(Failed::input("rotation: expected an orthogonal matrix [3, 3] of determinant 1"));
        }
        if !(scale > 0.0 && scale.is_finite()) {
            return Err(Failed::input(format!("scale: expected a positive number, found {scale}")));
        }
        if !translation.iter().all(|x| x.is_finite()) {
            return Err(Failed::input(format!("translation: expected finite numbers, found {translation:?}")));
        }
        let to = Similarity { scale, rotation, translation: DVec3::from(translation) };
        compute(py, || Ok(self.with(self.gaussians.transformed(&to))))
    }

    /// The Gaussians with their centers between two corners.
    fn in_box(&self, min: [f32; 3], max: [f32; 3]) -> Self {
        self.within(&Region::Box { min, max })
    }

    /// The Gaussians with their centers at most a radius away from a point.
    fn in_sphere(&self, center: [f32; 3], radius: f32) -> Self {
        self.within(&Region::Sphere { center, radius })
    }

    /// The Gaussians of this scene and of others.
    fn merged(&self, others: Vec<Py<SceneData>>) -> Self {
        let parts: Vec<Gaussians> = std::iter::once(&self.gaussians)
            .chain(others.iter().map(|other| &other.get().gaussians))
            .cloned()
            .collect();
        self.with(Gaussians::joined(&parts))
    }

    /// Pictures `[H, W, 3]` from cameras.
    fn render<'py>(
        &self,
        py: Python<'py>,
        cameras: Vec<Py<Camera>>,
        background: [f32; 3],
        drawing: (f64, f64, bool),
    ) -> PyResult<Vec<Bound<'py, PyArrayDyn<f32>>>> {
        let (near, alpha_max, antialiased) = drawing;
        let cameras: Vec<_> = cameras.iter().map(|camera| camera.get().0.camera).collect();
        let settings = checked(RasterSettings { near, alpha_max, antialiased, ..self.settings })?;
        let drawn = cameras.iter().map(|camera| of_picture(camera, 1)).fold(0, u64::saturating_add);
        check_memory(drawn)?;
        let pictures = compute(py, || {
            let (activated, mut workspace) = (self.gaussians.to_activated(), Workspace::new());
            let draw = |camera| render(&activated, &[camera], background, &settings, &mut workspace);
            let pictures = cameras.iter().copied().map(draw).collect::<Result<Vec<_>, _>>()?;
            Ok(pictures.into_iter().flatten().collect::<Vec<_>>())
        })?;
        let sizes = cameras.iter().map(|camera| [camera.height, camera.width, 3]);
        pictures.into_iter().zip(sizes).map(|(picture, size)| shaped(py, picture, &size)).collect()
    }

    /// One HTML file that shows the scene.
    fn html(&self, py: Python<'_>, title: &str, cameras: Vec<Py<Camera>>, lossless: bool) -> Result<String, Failed> {
        let shot = |camera: &Py<Camera>| {
            let frame = &camera.get().0;
            Shot::new(frame.name.clone(), frame.camera)
        };
        let shots: Vec<Shot> = cameras.iter().map(shot).collect();
        let look = Look { background: self.background, settings: self.settings, ..Look::default() };
        let subject = Subject { title, gaussians: &self.gaussians, look, notes: None, second: None };
        compute(py, || html(&subject, &shots, HtmlOptions { lossless }).map_err(Failed::input))
    }

    fn __len__(&self) -> usize {
        self.len()
    }
}

impl SceneData {
    fn len(&self) -> usize {
        self.gaussians.len()
    }

    fn with(&self, gaussians: Gaussians) -> Self {
        Self { gaussians, ..*self }
    }

    fn within(&self, region: &Region) -> Self {
        self.with(self.gaussians.select(&self.gaussians.inside(region)))
    }
}
