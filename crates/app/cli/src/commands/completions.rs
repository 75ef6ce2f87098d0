//! `splatweaver completions`.

use crate::command_line::CommandLine;
use clap::{Args, CommandFactory};
use weaver_command::{Console, Failure};

/// Prints a completion script for a shell.
#[derive(Args, Debug)]
#[command(after_help = "Example:
  splatweaver completions bash > ~/.local/share/bash-completion/completions/splatweaver")]
pub struct Completions {
    /// The shell
    pub shell: clap_complete::Shell,
}

pub fn run(arguments: &Completions, console: &mut Console) -> Result<(), Failure> {
    // Written to memory first: the generator panics when writing fails.
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut CommandLine::command(), "splatweaver", &mut script);
    console.print(&String::from_utf8_lossy(&script))
}
