//! Errors of streams and scenes.

/// Why something could not be encoded or decoded.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CodecError {
    /// Bytes of another format.
    #[error("byte 0: expected {}, found {}", expected.escape_ascii(), found.escape_ascii())]
    Foreign {
        /// The magic number.
        expected: [u8; 4],
        /// The first bytes.
        found: Vec<u8>,
    },
    /// A version that is not known here.
    #[error("version: expected {expected}, found {found}")]
    Version {
        /// The one that is known.
        expected: u8,
        /// The stream's version.
        found: u8,
    },
    /// Bytes that end too early.
    #[error("{place}: expected {expected} bytes, found {found}")]
    Ended {
        /// The part that is cut.
        place: String,
        /// Bytes that it should have.
        expected: u64,
        /// Bytes that are left.
        found: u64,
    },
    /// Bytes that changed.
    #[error("{place}: expected the checksum {expected:08x}, found {found:08x}")]
    Checksum {
        /// The part that changed.
        place: String,
        /// The checksum that is written there.
        expected: u32,
        /// The checksum of the bytes.
        found: u32,
    },
    /// Content that does not make sense.
    #[error("{place}: expected {expected}, found {found}")]
    Invalid {
        /// The key, stream or Gaussian.
        place: String,
        /// The expected value.
        expected: String,
        /// The value found.
        found: String,
    },
}

impl CodecError {
    pub(crate) fn invalid(
        place: impl std::fmt::Display,
        expected: impl std::fmt::Display,
        found: impl std::fmt::Display,
    ) -> Self {
        Self::Invalid { place: place.to_string(), expected: expected.to_string(), found: found.to_string() }
    }
}
