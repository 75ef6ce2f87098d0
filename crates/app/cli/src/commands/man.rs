//! `splatweaver man`.

use clap::Args;
use weaver_command::{Console, Failure, Output, manual};

/// Prints a page of the manual, or writes all pages into a folder.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver man fit | man -l -
  splatweaver man --out ~/.local/share/man/man1")]
pub struct Manual {
    /// The command, in two words where it has two [default: the page of the program]
    pub command: Vec<String>,
    /// Folder that gets a file for each page
    #[arg(short, long, value_name = "DIR", conflicts_with = "command", value_parser = Output::folder())]
    pub out: Option<Output>,
}

pub fn run(arguments: &Manual, console: &mut Console) -> Result<(), Failure> {
    let pages = manual(crate::program());
    if let Some(folder) = &arguments.out {
        for (name, text) in &pages {
            weaver_io::write_text(folder.join(format!("{name}.1")), text)?;
        }
        return console.print(&format!("{} pages in {}", pages.len(), folder.display()));
    }
    let name = [&["splatweaver".to_string()], &arguments.command[..]].concat().join("-");
    let page = pages.iter().find(|page| page.0 == name);
    let missing = || Failure::Usage(format!("expected a command, found `{}`", arguments.command.join(" ")));
    console.print(&page.ok_or_else(missing)?.1)
}
