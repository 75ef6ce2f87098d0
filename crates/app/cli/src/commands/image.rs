//! `splatweaver image`.

mod bench;
mod draw;
mod fit;

use bench::ImageBench;
use clap::{Args, Subcommand};
use draw::ImageDraw;
use fit::ImageFit;
use std::path::Path;
use weaver_command::{Console, Failure, Interrupt, in_pool, memory};
use weaver_image::{ImageError, Picture};
use weaver_io::PhotoFile;

/// Writes pictures as sums of 2-D Gaussians (.wgi), draws them at any size, and measures both.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver image fit photo.jpg -o photo.wgi
  splatweaver image fit photo.jpg -o photo.wgi --bytes 20000
  splatweaver image draw photo.wgi -o thumbnail.png --scale 0.25
  splatweaver image bench photo.jpg")]
pub struct Pictures {
    #[command(subcommand)]
    pub command: ImageCommand,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum ImageCommand {
    Fit(ImageFit),
    Draw(ImageDraw),
    Bench(ImageBench),
}

pub fn run(arguments: &Pictures, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    match &arguments.command {
        ImageCommand::Fit(it) => in_pool(it.threads.count(), || fit::run(it, console, interrupt)),
        ImageCommand::Draw(it) => in_pool(it.threads.count(), || draw::run(it, console)),
        ImageCommand::Bench(it) => in_pool(it.threads.count(), || bench::run(it, console)),
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
