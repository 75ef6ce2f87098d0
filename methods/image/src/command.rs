//! `splatweaver image`: pictures on disk as sums of 2-D Gaussians.
//!
//! Fits, drawing and format are the library's; here are the files, the [`Run`](weaver_run::Run) of several pictures,
//! and the comparison with other codecs.
//!
//! ```no_run
//! use clap::Parser;
//! use weaver_command::{Console, Interrupt};
//! use weaver_image::command::{Pictures, run};
//!
//! #[derive(Parser)]
//! struct Line {
//!     #[command(flatten)]
//!     pictures: Pictures,
//! }
//!
//! let line = Line::parse_from(["image", "fit", "photo.jpg", "-o", "photo.wgi"]);
//! let (mut out, mut notes) = (std::io::stdout(), std::io::stderr());
//! let mut console = Console::new(&mut out, &mut notes, false);
//! if let Err(failure) = run(&line.pictures, &mut console, &Interrupt::new()) {
//!     eprintln!("{}", failure.line().unwrap_or_default());
//! }
//! ```

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
