//! A command with its settings, given as words or by name.

use crate::command_line::CommandLine;
use crate::units;
use clap::CommandFactory;
use std::ffi::OsString;
use weaver_command::{Console, Failure, Interrupt, Paths, Value, fewer_threads, words_of};
use weaver_kernels::simd;

/// A command and its settings, ready to run, as the command line and the Python package make them.
///
/// The settings are one struct for each command, which clap fills; so defaults, limits and messages are the same for
/// both callers.
#[derive(Debug)]
pub struct Request(CommandLine);

impl Request {
    /// Reads the words of a command line, whose first is the program's name.
    ///
    /// # Errors
    /// Wrong usage, and the texts of `--help` and `--version`.
    pub fn of_words(words: impl IntoIterator<Item = OsString>) -> Result<Self, clap::Error> {
        CommandLine::of(words).map(Self)
    }

    /// Takes settings by name: a flag's long one with `_` for `-`, or a place's as the struct of the command has it.
    ///
    /// A switch is given as yes or no, a flag that may be repeated or a place that takes several as a list; another
    /// list is one value with commas, as a color is.
    ///
    /// # Errors
    /// Wrong usage in the words of the command line, in one line and without the help.
    pub fn of_settings(command: &str, settings: impl IntoIterator<Item = (String, Value)>) -> Result<Self, String> {
        let words = words_of(&CommandLine::command(), command, settings);
        Self::of_words(words).map_err(|error| {
            let text = error.render().to_string();
            let told = text.split("\n\n").next().unwrap_or_default().trim_start_matches("error: ");
            told.split_whitespace().collect::<Vec<_>>().join(" ")
        })
    }

    /// Its paths.
    pub fn paths(&self) -> &Paths {
        &self.0.paths
    }

    /// Runs the command, with its output on the console.
    ///
    /// # Errors
    /// The reason that the program prints.
    pub fn run(&self, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
        console.progress = self.0.progress.unwrap_or(console.progress);
        simd::requested_level().map_err(Failure::Usage)?;
        self.0.paths.check()?;
        fewer_threads(self.0.threads).iter().for_each(|note| console.note(note));
        units::run(&self.0.command, &self.0.settings, console, interrupt)
    }
}
