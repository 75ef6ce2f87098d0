//! `splatweaver completions`.

use crate::arguments::{CommandLine, Completions};
use clap::CommandFactory;
use weaver_command::{Console, Failure};

pub fn run(arguments: &Completions, console: &mut Console) -> Result<(), Failure> {
    // Written to memory first: the generator panics when writing fails.
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut CommandLine::command(), "splatweaver", &mut script);
    console.print(&String::from_utf8_lossy(&script))
}
