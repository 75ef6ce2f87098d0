//! Errors of settings.

/// Why settings could not be resolved.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A key or a value is wrong.
    #[error("{place}: {message}")]
    Invalid {
        /// The file or the setting.
        place: String,
        /// The key, the expected value and the value found.
        message: String,
    },
    /// A file could not be read.
    #[error(transparent)]
    Io(#[from] weaver_io::Error),
}

impl Error {
    /// An [`Error::Invalid`] about a key or a value.
    pub fn invalid(place: &str, message: impl Into<String>) -> Self {
        Self::Invalid { place: place.into(), message: message.into() }
    }
}
