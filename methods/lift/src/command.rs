//! `splatweaver lift` and `splatweaver query`: features of photos for the Gaussians of a scene on disk, and their
//! similarity to prompts.
//!
//! The solvers are the library's; here are the files of features, masks and pictures around them, and a demonstration
//! on built-in scenes.
//!
//! ```no_run
//! use clap::Parser;
//! use weaver_command::Console;
//! use weaver_lift::command::{Lift, lift};
//!
//! #[derive(Parser)]
//! struct Line {
//!     #[command(flatten)]
//!     lift: Lift,
//! }
//!
//! let line = Line::parse_from(
//!     ["lift", "scene.ply", "--cameras", "transforms.json", "--features", "dino", "--out", "lifted.safetensors"],
//! );
//! let (mut out, mut notes) = (std::io::stdout(), std::io::stderr());
//! let mut console = Console::new(&mut out, &mut notes, false);
//! if let Err(failure) = lift(&line.lift, &mut console) {
//!     eprintln!("{}", failure.line().unwrap_or_default());
//! }
//! ```

mod arguments;
mod lift;
mod query;

pub use arguments::{DemoGaussians, Lift, Query, SolverName};

use weaver_command::{Console, Failure, in_pool};

/// Lifts features of photos to the Gaussians of a scene, and writes them with pictures of them.
///
/// Fails where files cannot be read or do not belong together, where memory would not do, and where results cannot be
/// written.
pub fn lift(arguments: &Lift, console: &mut Console) -> Result<(), Failure> {
    in_pool(arguments.threads.count(), || lift::run(arguments, console))
}

/// Draws the similarity of a scene's lifted features to prompts, from each camera.
///
/// Fails as [`lift`](fn@lift) does.
pub fn query(arguments: &Query, console: &mut Console) -> Result<(), Failure> {
    in_pool(arguments.threads.count(), || query::run(arguments, console))
}
