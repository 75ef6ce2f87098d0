//! Clips to photos, and pictures to videos.
//!
//! - [`PhotoFiles`] lists photos, opens folders of them, converts HEIC and AVIF, and chooses frames of clips: sharp
//!   ones, evenly spread over the way of the camera. They are upright, without the combs of interlaced clips, and in
//!   sRGB, HDR clips as well.
//! - [`Film`] is a file of moving pictures that is being written: [`Video`], [`Gif`], [`WebP`].
//!
//! Clips and videos go through an ffmpeg on the PATH, HEIC and AVIF through a program that decodes them. Each is a
//! process of its own that ends no later than this one ([`end_all`]).

mod choice;
mod conversion;
mod decoder;
mod error;
mod film;
mod frames;
mod gif;
mod heif;
mod movement;
mod photo_files;
mod picture_sink;
mod pictures;
mod program;
mod spherical;
mod stream;
mod video;
mod webp;

pub use error::Error;
pub use film::Film;
pub use frames::{info, is_clip};
pub use gif::Gif;
pub use photo_files::PhotoFiles;
pub use picture_sink::PictureSink;
pub use program::end_all;
pub use video::{VIDEOS, Video};
pub use webp::WebP;

/// The example of the README, compiled.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
