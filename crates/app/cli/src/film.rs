//! Pictures one behind the other in one file.

use std::path::PathBuf;
use weaver_command::Failure;
use weaver_io::Image;

/// A file of moving pictures that is being written.
pub trait Film: Send {
    /// Adds a picture; all have one size.
    fn push(&mut self, image: &Image) -> Result<(), Failure>;

    /// Completes the file, and returns its path.
    fn finish(self: Box<Self>) -> Result<PathBuf, Failure>;
}
