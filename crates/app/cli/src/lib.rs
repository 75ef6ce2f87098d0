//! The `splatweaver` command line: arguments in, exit code out.
//!
//! [`run`] is the whole program except for signals and panics, so that tests can call it.

mod command_line;
mod commands;
mod failure_kind;
mod flags;
mod methods;
mod old_names;
mod processes;
mod request;
mod table;
mod units;

pub use weaver_command::{Console, Flag, Interrupt, OldName, Paths, Value, printable};

pub use failure_kind::FailureKind;
pub use methods::models;
pub use old_names::{OLD, current};
pub use request::Request;

use clap::CommandFactory;
use command_line::CommandLine;
use std::ffi::OsString;
use weaver_command::Failure;

/// Runs one command line, whose first argument is the program's name, and returns the exit code: 0 for success, 1 for
/// an error, 2 for wrong usage.
pub fn run(arguments: impl IntoIterator<Item = OsString>, console: &mut Console, interrupt: &Interrupt) -> u8 {
    let (arguments, notes) = old_names::current(arguments.into_iter().collect());
    notes.iter().for_each(|note| console.note(note));
    let result = match Request::of_words(arguments) {
        Ok(request) => request.carry_out(console, interrupt),
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

/// Ends programs that were started and removes files that were begun: to be called before the process ends without
/// unwinding.
pub fn leave() {
    weaver_clip::end_all();
    weaver_io::remove_unfinished();
}

/// Reason why a request was not carried out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Kind of the failure.
    pub kind: FailureKind,
    /// The message in one line; `None` where standard output was closed.
    pub line: Option<String>,
}

impl Refusal {
    fn of(failure: &Failure) -> Self {
        Self { kind: FailureKind::of(failure), line: failure.line() }
    }
}

/// Checks the words of one command line, whose first is the program's name, without running it.
///
/// Returns the message of wrong usage otherwise. `--help` and `--version` are accepted.
pub fn parses(arguments: impl IntoIterator<Item = OsString>) -> Result<(), String> {
    match CommandLine::of(arguments) {
        Err(error) if error.use_stderr() => Err(error.render().to_string()),
        _ => Ok(()),
    }
}

/// Paths of one command line, whose first word is the program's name.
///
/// # Errors
/// The message of wrong usage, and the texts of `--help` and `--version`.
pub fn paths(arguments: impl IntoIterator<Item = OsString>) -> Result<Paths, String> {
    CommandLine::of(arguments).map(|line| line.paths).map_err(|error| error.to_string())
}

/// The definition that the command line is parsed by.
pub fn program() -> clap::Command {
    CommandLine::command()
}

/// The flags of all commands.
pub fn flags() -> Vec<Flag> {
    weaver_command::flags(&program())
}

/// The page `docs/reference/flags.md`, Markdown.
pub fn reference() -> String {
    weaver_command::reference(&program())
}
