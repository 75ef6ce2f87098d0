//! What the commands of `splatweaver` share: the console, progress, Ctrl-C, failures and exit codes, threads, and the device that draws.
//!
//! A command is a struct of clap's and a function `run(&Arguments, &mut Console) -> Result<(), Failure>`.

mod console;
pub mod device;
mod failure;
mod flags;
mod interrupt;
mod progress;
mod threads;

pub use console::Console;
pub use failure::Failure;
pub use flags::{DeviceFlag, MOST_THREADS, Threads};
pub use interrupt::Interrupt;
pub use progress::{Progress, duration};
pub use threads::in_pool;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
