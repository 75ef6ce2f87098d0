//! `splatweaver._splatweaver`, the compiled part of the Python package `splatweaver`.
//!
//! Python's side checks shapes and gives names their meaning; here arrays become slices, without a copy, and the lock
//! of the interpreter is released while anything is computed.

mod arrays;
mod camera;
mod command;
mod events;
mod failed;
mod failure_kind;
mod kept;
mod rasterize;
mod scene;
mod threads;

use pyo3::prelude::*;

/// The compiled part of the package.
#[pymodule]
mod _splatweaver {
    #[pymodule_export]
    use super::camera::{Camera, read_cameras, write_cameras};
    #[pymodule_export]
    use super::command::{flags, run_command, run_program};
    #[pymodule_export]
    use super::kept::Drawing;
    #[pymodule_export]
    use super::rasterize::{check_memory, rasterize};
    #[pymodule_export]
    use super::scene::{SceneData, formats, write_page};
    #[pymodule_export]
    use super::threads::{set_threads, threads};
    use super::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
