//! What can be wrong with settings.

/// Why settings could not be resolved.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A key or a value is wrong.
    #[error("{place}: {message}")]
    Invalid {
        /// The file or the setting.
        place: String,
        /// The key, what was expected and what was found.
        message: String,
    },
    /// A file could not be read.
    #[error(transparent)]
    Io(#[from] weaver_io::Error),
}

impl Error {
    /// A key or a value that is wrong, in a place as [`Error::Invalid`] has it.
    pub fn invalid(place: &str, message: impl Into<String>) -> Self {
        Self::Invalid { place: place.into(), message: message.into() }
    }
}
