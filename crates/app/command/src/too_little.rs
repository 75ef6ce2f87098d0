//! Too little memory, an error.

use std::fmt;

/// Less memory than something would take.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TooLittle {
    /// Bytes that it would take.
    pub needed: u64,
    /// Bytes that there are.
    pub available: u64,
    /// Advice how it would take less.
    pub advice: String,
}

impl fmt::Display for TooLittle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [needed, available] = [self.needed, self.available].map(|bytes| bytes as f64 / 1e9);
        write!(f, "memory: expected {needed:.1} GB, found {available:.1} GB available; {}", self.advice)
    }
}

impl std::error::Error for TooLittle {}
