//! Failures as exceptions of the package.

use crate::failure_kind::FailureKind;
use pyo3::prelude::*;
use pyo3::types::PyType;
use std::fmt::Display;
use std::path::Path;
use weaver_command::Failure;
use weaver_splat::RasterError;

/// A failure that becomes an exception of `splatweaver`.
#[derive(Debug)]
pub struct Failed {
    kind: FailureKind,
    message: String,
}

impl Failed {
    pub fn new(kind: FailureKind, message: impl Display) -> Self {
        Self { kind, message: message.to_string() }
    }

    /// Arguments that mean nothing.
    pub fn input(message: impl Display) -> Self {
        Self::new(FailureKind::Input, message)
    }
}

/// Refuses a file to write whose name ends otherwise.
pub fn check_ending(path: &Path, ending: &str) -> Result<(), Failed> {
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(ending)) {
        return Ok(());
    }
    let message = format!("{}: expected a name that ends with .{ending}", path.display());
    Err(Failed::new(FailureKind::File, message))
}

impl From<RasterError> for Failed {
    fn from(error: RasterError) -> Self {
        let kind = if let RasterError::TooMany(_) = error { FailureKind::Memory } else { FailureKind::Input };
        Self::new(kind, error)
    }
}

impl From<Failure> for Failed {
    fn from(failure: Failure) -> Self {
        Self { kind: FailureKind::of(&failure), message: failure.line().unwrap_or_default() }
    }
}

impl From<weaver_io::Error> for Failed {
    fn from(error: weaver_io::Error) -> Self {
        Self::new(FailureKind::File, error)
    }
}

impl From<Failed> for PyErr {
    fn from(Failed { kind, message }: Failed) -> Self {
        let name = match kind {
            FailureKind::Input => "InputError",
            FailureKind::File => "FileError",
            FailureKind::Memory => "MemoryPlanError",
            FailureKind::Numeric => "NumericError",
            _ => "Error",
        };
        Python::attach(|py| {
            let class = py.import("splatweaver._errors").and_then(|module| module.getattr(name));
            match class.and_then(|class| Ok(class.cast_into::<PyType>()?)) {
                Ok(class) => PyErr::from_type(class, (message,)),
                Err(error) => error,
            }
        })
    }
}
