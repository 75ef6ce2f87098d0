//! Infrastructure shared by the commands of `splatweaver`: the console, progress, Ctrl-C, failures and exit codes,
//! threads, and the device that draws.
//!
//! A command is a struct of clap's and a function `run(&Arguments, &mut Console) -> Result<(), Failure>`.

pub mod camera_files;
mod console;
pub mod device;
mod drawing;
mod drawing_flags;
mod failure;
mod film_path;
mod flags;
mod interrupt;
mod lifted_file;
mod manual;
pub mod memory;
mod observer;
mod old_names;
mod output;
mod paths;
mod printable;
mod progress;
mod progress_form;
mod projection;
mod reference;
mod settings;
mod threads;

pub use console::Console;
pub use drawing::DrawingOptions;
pub use drawing_flags::{DrawingFlags, Rgb, background};
pub use failure::Failure;
pub use film_path::{FilmPath, film_path};
pub use flags::{
    DeviceFlag, LiveFlag, MOST_SEED, MOST_THREADS, Threads, choice, fraction, number, positive, rate, rows_and_columns,
};
pub use interrupt::Interrupt;
pub use lifted_file::LiftedFile;
pub use manual::manual;
pub use observer::ConsoleObserver;
pub use old_names::{OldName, current_names};
pub use output::Output;
pub use paths::Paths;
pub use printable::printable;
pub use progress::Progress;
pub use progress_form::ProgressForm;
pub use projection::{Projection, projection};
pub use reference::{Flag, asked_threads, flags, given_words, grouped, reference};
pub use settings::{Value, words_of};
pub use threads::{cores, fewer_threads, in_pool, pool_size};
pub use weaver_io::{Part, ShellCommand, duration};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
