//! `splatweaver completions`.

use crate::Console;
use crate::arguments::{CommandLine, Completions};
use crate::failure::Failure;
use clap::CommandFactory;

pub fn run(arguments: &Completions, console: &mut Console) -> Result<(), Failure> {
    // Through memory: the generator panics when its output does not take the bytes.
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut CommandLine::command(), "splatweaver", &mut script);
    console.print(&String::from_utf8_lossy(&script))
}
