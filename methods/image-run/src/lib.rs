//! `splatweaver image`: pictures on disk as sums of 2-D Gaussians.
//!
//! Fits, drawing and format are weaver-image's; here are the files, the [`Run`](weaver_run::Run) of several pictures, and the comparison with
//! other codecs.

mod arguments;
mod bench;
mod draw;
mod fit;
mod info;
mod job;
mod measure;
mod others;
mod read;
mod report;
mod results;
mod search;
mod state;
mod trace;

pub use arguments::Pictures;
pub use info::info;

use arguments::ImageCommand;
use weaver_command::{Console, Failure, Interrupt, in_pool};

/// Runs one of the commands.
///
/// Fails where files cannot be read or are no pictures, where memory would not do, and where results cannot be written.
pub fn run(arguments: &Pictures, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    match &arguments.command {
        ImageCommand::Fit(arguments) => in_pool(arguments.threads.count(), || fit::run(arguments, console, interrupt)),
        ImageCommand::Draw(arguments) => in_pool(arguments.threads.count(), || draw::run(arguments, console)),
        ImageCommand::Bench(arguments) => in_pool(arguments.threads.count(), || bench::run(arguments, console)),
    }
}

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
