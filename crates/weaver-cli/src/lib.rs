//! The `splatweaver` command line: arguments in, exit code out.
//!
//! [`run`] is the whole program but for the process around it (signals, panics), so that tests can call it.

mod arguments;
mod cameras;
mod completions;
mod console;
mod failure;
mod info;
mod progress;
mod render;

pub use console::Console;

use arguments::{Command, CommandLine};
use clap::Parser;
use failure::Failure;
use std::ffi::OsString;
use std::sync::atomic::AtomicBool;

/// Runs one command line, the program's name first, and returns the exit code: 0 fine, 1 error, 2 usage.
///
/// `stop` asks a long job to save what it has and come back.
pub fn run(arguments: impl IntoIterator<Item = OsString>, console: &mut Console, stop: &AtomicBool) -> u8 {
    let result = match CommandLine::try_parse_from(arguments) {
        Ok(line) => dispatch(line.command, console, stop),
        Err(error) if error.use_stderr() => {
            console.note(error.render().to_string().trim_end());
            return 2;
        }
        // `--help` and `--version`.
        Err(error) => console.print(&error.render().to_string()),
    };
    let Err(failure) = result else { return 0 };
    if let Some(line) = failure.line() {
        console.note(&format!("error: {line}"));
    }
    failure.exit_code()
}

fn dispatch(command: Command, console: &mut Console, stop: &AtomicBool) -> Result<(), Failure> {
    match command {
        Command::Render(arguments) => in_pool(arguments.threads.threads, || render::run(&arguments, console, stop)),
        Command::Info(arguments) => info::run(&arguments, console),
        Command::Completions(arguments) => completions::run(&arguments, console),
    }
}

/// Runs `job` where parallel loops use `threads` threads; 0 takes one per core.
fn in_pool<R: Send>(threads: usize, job: impl FnOnce() -> Result<R, Failure> + Send) -> Result<R, Failure> {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build()?.install(job)
}
