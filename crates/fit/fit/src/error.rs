//! Errors of photos, scenes and settings of a fit.

/// Why a scene cannot be fitted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// A photo and its camera do not fit together, or hold numbers that mean nothing.
    #[error("photo {name}: expected {expected}, found {found}")]
    Photo {
        /// The photo.
        name: String,
        /// The expected value.
        expected: String,
        /// The value found.
        found: String,
    },
    /// A setting, or a requirement of a setting, is out of range.
    #[error("{key}: expected {expected}, found {found}")]
    Setting {
        /// The setting.
        key: &'static str,
        /// The expected form.
        expected: String,
        /// The form found.
        found: String,
    },
    /// Numbers grew beyond all bounds.
    #[error("step {step}, photo {photo}: the loss is {loss}")]
    Diverged {
        /// The step.
        step: usize,
        /// The photo it looked at.
        photo: String,
        /// The loss.
        loss: f64,
    },
    /// Gaussians that cannot be rounded.
    #[error("step {step}: {source}")]
    Rounding {
        /// The step.
        step: usize,
        /// The Gaussian, the expected and the found value.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A process that shares the steps holds another fit.
    #[error("process {process}: {key}: expected that of process 0, found another")]
    Process {
        /// Number of the process.
        process: usize,
        /// The part that differs.
        key: &'static str,
    },
    /// The rasterizer refused.
    #[error(transparent)]
    Raster(#[from] weaver_splat::RasterError),
}

impl FitError {
    pub(crate) fn setting(key: &'static str, expected: impl Into<String>, found: impl ToString) -> Self {
        Self::Setting { key, expected: expected.into(), found: found.to_string() }
    }
}
