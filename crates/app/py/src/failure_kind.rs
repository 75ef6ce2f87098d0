//! Kinds of failures, for callers who treat them differently.

use std::error::Error;
use weaver_command::Failure;

/// Kind of a failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FailureKind {
    /// Arguments that mean nothing, or do not belong together.
    Input,
    /// A file that cannot be read or written, or has unexpected content.
    File,
    /// More memory than there is.
    Memory,
    /// Numbers that grew beyond all bounds.
    Numeric,
    /// Anything else.
    Other,
}

impl FailureKind {
    /// The kind of a command's failure.
    pub fn of(failure: &Failure) -> Self {
        match failure {
            Failure::Usage(_) => Self::Input,
            Failure::OutputClosed => Self::File,
            Failure::Error(error) => of_error(error.as_ref()),
        }
    }
}

/// The kind of an error, or of the first of its causes that has one.
fn of_error(error: &(dyn Error + 'static)) -> FailureKind {
    let kind = of_inference(error).or_else(|| of_run(error)).or_else(|| of_library(error));
    match (kind, error.source()) {
        (Some(kind), _) => kind,
        (None, Some(cause)) => of_error(cause),
        (None, None) => FailureKind::Other,
    }
}

/// Errors of the crates below, which stand for themselves.
fn of_library(error: &(dyn Error + 'static)) -> Option<FailureKind> {
    use weaver_data::Error as Data;
    use weaver_fit::FitError;
    use weaver_splat::RasterError;
    if error.is::<weaver_io::Error>() || error.is::<std::io::Error>() {
        Some(FailureKind::File)
    } else if error.is::<weaver_io::TooLittleMemory>() {
        Some(FailureKind::Memory)
    } else if let Some(error) = error.downcast_ref::<FitError>() {
        Some(if let FitError::Diverged { .. } = error { FailureKind::Numeric } else { FailureKind::Input })
    } else if let Some(error) = error.downcast_ref::<RasterError>() {
        Some(if let RasterError::TooMany(_) = error { FailureKind::Memory } else { FailureKind::Input })
    } else {
        error.downcast_ref::<Data>().map(|error| match error {
            Data::Views { .. } | Data::Scale { .. } => FailureKind::Input,
            _ => FailureKind::File,
        })
    }
}

/// Errors of runs, which may wrap errors of other crates.
fn of_run(error: &(dyn Error + 'static)) -> Option<FailureKind> {
    use weaver_reconstruct::Error as Fit;
    use weaver_run::Error as Run;
    if let Some(error) = error.downcast_ref::<Fit>() {
        return match error {
            Fit::Fit(inner) => of_library(inner),
            Fit::Raster(inner) => of_library(inner),
            Fit::Capture(inner) => of_library(inner),
            Fit::Run(inner) => of_run(inner),
            Fit::Clip(inner) => of_clip(inner),
            Fit::Given(inner) => Some(of_error(inner.as_ref())),
            Fit::Memory(_) => Some(FailureKind::Memory),
            Fit::AlreadyThere { .. } | Fit::View(_) | Fit::Photos { .. } | Fit::Blocks { .. } => {
                Some(FailureKind::Input)
            }
            Fit::Cameras(_)
            | Fit::Align { .. }
            | Fit::Nothing { .. }
            | Fit::Drawing { .. }
            | Fit::Compared { .. }
            | Fit::Page(_) => Some(FailureKind::Other),
            _ => Some(FailureKind::File),
        };
    }
    if let Some(error) = error.downcast_ref() {
        return of_clip(error);
    }
    match error.downcast_ref::<Run>()? {
        Run::File(_) => Some(FailureKind::File),
        Run::Unit { .. } => Some(FailureKind::Other),
        _ => Some(FailureKind::Input),
    }
}

/// Errors of photos and clips.
fn of_clip(error: &weaver_clip::Error) -> Option<FailureKind> {
    use weaver_clip::Error as Clip;
    match error {
        Clip::File(_) | Clip::Missing(_) => Some(FailureKind::File),
        Clip::Setting { .. } => Some(FailureKind::Input),
        _ => None,
    }
}

/// Errors of networks.
fn of_inference(error: &(dyn Error + 'static)) -> Option<FailureKind> {
    use weaver_inference::Error as Inference;
    match error.downcast_ref::<Inference>()? {
        Inference::Io(_) | Inference::Checkpoint { .. } => Some(FailureKind::File),
        Inference::Data(inner) => of_library(inner),
        Inference::Fit(inner) => of_library(inner),
        Inference::Numeric { .. } => Some(FailureKind::Numeric),
        Inference::Memory { .. } => Some(FailureKind::Memory),
        _ => Some(FailureKind::Input),
    }
}
