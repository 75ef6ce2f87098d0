//! The error type of this crate.

use crate::Advice;
use std::fmt::Display;
use std::io;
use std::path::{Path, PathBuf};

/// Result with [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

/// A file that could not be read or written; the message names the file and the place in it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused an operation on the file.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The content is not as the format or the caller expects.
    #[error("{}: {place}: expected {expected}, found {found}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// The key, byte offset, line or record.
        place: String,
        /// The expected value.
        expected: String,
        /// The value found.
        found: String,
    },
    /// A photo of a format that another program decodes.
    #[error("{}: image: expected a JPEG, PNG, TIFF or WebP image, found {kind}: {}", path.display(), Self::CONVERSION)]
    ToConvert {
        /// The file.
        path: PathBuf,
        /// Name of the format.
        kind: &'static str,
    },
    /// A compressed scene does not follow its format.
    #[error("{}: {source}", path.display())]
    Codec {
        /// The file.
        path: PathBuf,
        /// The place in it, the expected and the found content.
        source: weaver_codec::CodecError,
    },
    /// Results cannot be written at the requested place: something would be lost.
    #[error("{}: output: expected {expected}, found {found}", path.display())]
    Output {
        /// The file or folder.
        path: PathBuf,
        /// The expected value.
        expected: String,
        /// The value found.
        found: String,
        /// The remedy, [`Advice::OtherOutput`].
        source: Advice,
    },
}

impl Error {
    /// Conversion of photos whose format needs a program of its own.
    pub const CONVERSION: &str = if cfg!(target_os = "macos") {
        "convert it to JPEG, for instance with `sips -s format jpeg IN --out OUT.jpg`; where cameras are estimated, this \
         is done for you"
    } else if cfg!(windows) {
        "convert it to JPEG, for instance with `magick IN OUT.jpg` (to install it: winget install \
         ImageMagick.ImageMagick); where cameras are estimated, this is done for you once it is installed"
    } else {
        "convert it to JPEG, for instance with `heif-convert IN OUT.jpg` (to install it: sudo apt install \
         libheif-examples, or sudo dnf install libheif-tools); where cameras are estimated, this is done for you once it \
         is installed"
    };

    /// For `map_err` on operations on `path`.
    pub(crate) fn io(path: &Path) -> impl FnOnce(io::Error) -> Self + use<> {
        let path = path.to_path_buf();
        |source| Self::Io { path, source }
    }

    /// Content that is not as it should be.
    pub(crate) fn invalid(path: &Path, place: impl Display, expected: impl Display, found: impl Display) -> Self {
        Self::Invalid {
            path: path.to_path_buf(),
            place: place.to_string(),
            expected: expected.to_string(),
            found: found.to_string(),
        }
    }
}
