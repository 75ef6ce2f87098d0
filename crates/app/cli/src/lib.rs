//! The `splatweaver` command line: arguments in, exit code out.
//!
//! [`run`] is the whole program except for signals and panics, so that tests can call it; [`process`] is all of it.

mod command_line;
mod commands;
mod flags;
mod methods;
mod old_names;
mod process;
mod processes;
mod request;
mod table;
mod units;

pub use weaver_command::{Console, Interrupt, Value, printable};

pub use methods::models;
pub use old_names::{OLD, current};
pub use process::process;
pub use request::Request;

use clap::CommandFactory;
use command_line::CommandLine;
use std::ffi::OsString;

/// Runs one command line, whose first argument is the program's name, and returns the exit code: 0 for success, 1 for
/// an error, 2 for wrong usage.
pub fn run(arguments: impl IntoIterator<Item = OsString>, console: &mut Console, interrupt: &Interrupt) -> u8 {
    let (arguments, notes) = old_names::current(arguments.into_iter().collect());
    notes.iter().for_each(|note| console.note(note));
    let result = match Request::of_words(arguments) {
        Ok(request) => request.run(console, interrupt),
        Err(error) if error.use_stderr() => {
            console.note(error.render().to_string().trim_end());
            return 2;
        }
        // `--help` and `--version`.
        Err(error) => console.print(&error.render().to_string()),
    };
    let Err(failure) = result else { return 0 };
    if let Some(line) = failure.line() {
        console.error(&line);
    }
    failure.exit_code()
}

/// Ends programs that were started and removes files that were begun: to be called before the process ends without
/// unwinding.
pub fn leave() {
    weaver_clip::end_all();
    weaver_io::remove_unfinished();
}

/// The definition that the command line is parsed by.
pub fn program() -> clap::Command {
    CommandLine::command()
}
