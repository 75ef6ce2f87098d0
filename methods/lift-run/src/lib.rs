//! `splatweaver lift` and `splatweaver query`: features of photos for the Gaussians of a scene on disk, and where they are like a prompt.
//!
//! The solvers are weaver-lift's; here are the files of features, masks and pictures around them, and a demonstration on built-in scenes.

mod arguments;
mod file;
mod lift;
mod query;

pub use arguments::{DemoGaussians, Lift, Query, SolverName};
pub use file::LiftedFile;

use weaver_command::{Console, Failure, in_pool};

/// Lifts features of photos to the Gaussians of a scene, and writes them with pictures of them.
///
/// Fails where files cannot be read or do not belong together, where memory would not do, and where results cannot be written.
pub fn lift(arguments: &Lift, console: &mut Console) -> Result<(), Failure> {
    in_pool(arguments.threads.count(), || lift::run(arguments, console))
}

/// Draws how like prompts the lifted features of a scene are, from each camera.
///
/// Fails as [`lift`](fn@lift) does.
pub fn query(arguments: &Query, console: &mut Console) -> Result<(), Failure> {
    in_pool(arguments.threads.count(), || query::run(arguments, console))
}

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
