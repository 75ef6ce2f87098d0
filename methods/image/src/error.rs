//! Errors of drawing, fitting and coding pictures.

/// An error of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// A length that does not fit.
    #[error("{what}: expected {expected} numbers, found {found}")]
    Length {
        /// Name of the list.
        what: &'static str,
        /// The expected length.
        expected: usize,
        /// The length found.
        found: usize,
    },
    /// A number out of its range.
    #[error("{what}: expected {expected}, found {found}")]
    Range {
        /// The number's name.
        what: &'static str,
        /// Its range.
        expected: String,
        /// The number.
        found: String,
    },
    /// More tiles under Gaussians than the limit of a drawing.
    #[error("Gaussians: expected at most {most} tiles under all of them, found {found}; draw a smaller region")]
    TooMany {
        /// The limit.
        most: usize,
        /// The count.
        found: usize,
    },
    /// Bytes of a file that could not be read.
    #[error("reading the file: {0}")]
    Read(#[from] std::io::Error),
    /// A file that is no picture, or damaged.
    #[error(transparent)]
    File(#[from] weaver_codec::CodecError),
    /// A refusal of the solver of colors.
    #[error(transparent)]
    Colors(#[from] weaver_lift::LiftError),
}

/// Returns an error about `what` unless `found == expected`.
pub(crate) fn expect_len(what: &'static str, found: usize, expected: usize) -> Result<(), ImageError> {
    if found == expected { Ok(()) } else { Err(ImageError::Length { what, expected, found }) }
}

/// An error about a number out of its range.
pub(crate) fn range(what: &'static str, expected: impl ToString, found: impl ToString) -> ImageError {
    ImageError::Range { what, expected: expected.to_string(), found: found.to_string() }
}

/// An error about invalid content of a file.
pub(crate) fn invalid(place: &str, expected: impl ToString, found: impl ToString) -> ImageError {
    weaver_codec::CodecError::Invalid {
        place: place.to_string(),
        expected: expected.to_string(),
        found: found.to_string(),
    }
    .into()
}
