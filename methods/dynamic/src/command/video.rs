//! Videos, which the program around the command writes.

use std::path::{Path, PathBuf};
use weaver_command::Failure;
use weaver_io::Image;

/// Endings of videos.
pub const VIDEOS: &[&str] = &["mp4", "m4v", "mov", "mkv", "webm", "avi"];

/// Begins a video: its file, its width and height, and its pictures per second.
pub type StartVideo<'a> = &'a (dyn Fn(&Path, (usize, usize), f64) -> Result<Box<dyn Video>, Failure> + Sync);

/// A video that is being written.
pub trait Video: Send {
    /// Adds a picture; all have one size.
    ///
    /// # Errors
    /// When it cannot be written.
    fn push(&mut self, image: &Image) -> Result<(), Failure>;

    /// Completes the file, and returns its path.
    ///
    /// # Errors
    /// When it cannot be completed.
    fn finish(self: Box<Self>) -> Result<PathBuf, Failure>;
}
