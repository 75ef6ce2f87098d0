//! Clips to photos, and pictures to videos.
//!
//! - [`PhotoFiles`] lists photos, opens folders of them, and chooses frames of clips: sharp ones, evenly spread over
//!   the way of the camera.
//! - [`Film`] is a file of moving pictures that is being written: [`Video`], [`Gif`], [`WebP`].
//!
//! Clips and videos go through an ffmpeg on the PATH, a process of its own that ends no later than this one
//! ([`end_all`]).

mod choice;
mod error;
mod ffmpeg;
mod film;
mod frames;
mod gif;
mod movement;
mod photo_files;
mod pictures;
mod video;
mod webp;

pub use error::Error;
pub use ffmpeg::end_all;
pub use film::Film;
pub use frames::{info, is_clip};
pub use gif::Gif;
pub use photo_files::PhotoFiles;
pub use video::{VIDEOS, Video};
pub use webp::WebP;

/// The example of the README, compiled.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
