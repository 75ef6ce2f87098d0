//! `splatweaver image`.

mod bench;
mod draw;
mod fit;

use crate::arguments::ImageCommand;
use crate::{Console, Interrupt, in_pool};
use std::path::Path;
use weaver_command::{Failure, memory};
use weaver_image::{ImageError, Picture};
use weaver_io::PhotoFile;

pub fn run(command: &ImageCommand, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    match command {
        ImageCommand::Fit(arguments) => in_pool(arguments.threads.count(), || fit::run(arguments, console, interrupt)),
        ImageCommand::Draw(arguments) => in_pool(arguments.threads.count(), || draw::run(arguments, console)),
        ImageCommand::Bench(arguments) => in_pool(arguments.threads.count(), || bench::run(arguments, console)),
    }
}

/// Bytes of memory that a fit takes for a pixel: the picture in several forms, sums for its quadtree, values of tiles.
const FIT_BYTES: u64 = 120;

/// The picture in a file, over black.
fn read(path: &Path, console: &mut Console) -> Result<Picture, Failure> {
    let file = PhotoFile::at(path)?.over([0.0; 3]);
    let (width, height) = file.size();
    memory::check(width as u64 * height as u64 * FIT_BYTES, "a smaller picture takes less")?;
    let image = file.read()?.to_image();
    if file.was_transparent() {
        console.note(&format!("{}: transparent parts are black in the result", path.display()));
    }
    Picture::new(width, height, image.pixels).map_err(|error| failure(path, &error))
}

/// A failure that names the file.
fn failure(path: &Path, error: &ImageError) -> Failure {
    Failure::message(format!("{}: {error}", path.display()))
}
