//! Failures of showing scenes.

/// Failure of showing a scene.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file that cannot be read or written.
    #[error(transparent)]
    Io(#[from] weaver_io::Error),
    /// Cameras or photos that cannot be loaded.
    #[error(transparent)]
    Data(#[from] weaver_data::Error),
    /// A page that cannot be made.
    #[error(transparent)]
    View(#[from] weaver_view::ViewError),
    /// A log that cannot be read.
    #[error(transparent)]
    Run(#[from] weaver_run::Error),
    /// A server that cannot begin.
    #[error("serving on {address}: {message}")]
    Bind {
        /// Where it was to listen.
        address: String,
        /// The system's message.
        message: String,
    },
    /// No random numbers from the system.
    #[error("random numbers for the server's token: {0}")]
    Random(getrandom::Error),
}
