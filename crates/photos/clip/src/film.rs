//! Pictures one behind the other in one file.

use crate::Error;
use std::path::PathBuf;
use weaver_io::Image;

/// A file of moving pictures that is being written.
pub trait Film: Send {
    /// Adds a picture; all have one size.
    fn push(&mut self, image: &Image) -> Result<(), Error>;

    /// Completes the file, and returns its path.
    fn finish(self: Box<Self>) -> Result<PathBuf, Error>;
}
