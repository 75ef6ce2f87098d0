//! The page of flags: every command with its arguments, from the definition that the program parses by.

use crate::command_line::CommandLine;
use clap::CommandFactory;
use std::fmt::Write;

/// The page `docs/reference/flags.md`, Markdown.
pub fn reference() -> String {
    let mut page = String::from(
        "# Flags\n\nEvery command with what it takes; generated from the program's own definition. `splatweaver COMMAND --help` prints the same with examples. \
         [Conventions](conventions.md#flags) explain the flags that several commands have.\n",
    );
    for command in CommandLine::command().get_subcommands().filter(|command| !command.is_hide_set()) {
        add(command.get_name().to_string(), command, &mut page);
        for second in command.get_subcommands() {
            add(format!("{} {}", command.get_name(), second.get_name()), second, &mut page);
        }
    }
    page
}

fn add(name: String, command: &clap::Command, page: &mut String) {
    let about = command.get_about().map_or(String::new(), ToString::to_string);
    let _ = write!(page, "\n## {name}\n\n{}\n", cell(&about));
    let taken: Vec<&clap::Arg> = command.get_arguments().filter(|argument| !argument.is_hide_set()).collect();
    if taken.is_empty() {
        return;
    }
    page.push_str("\n| flag | |\n|---|---|\n");
    for argument in taken {
        let help = argument.get_help().map_or(String::new(), ToString::to_string);
        let default: Vec<_> = argument.get_default_values().iter().map(|value| value.to_string_lossy()).collect();
        let default = if default.is_empty() { String::new() } else { format!(" [default: {}]", default.join(" ")) };
        let _ = writeln!(page, "| `{}` | {}{default} |", cell(&form(argument)), cell(&help));
    }
}

/// An argument as it is typed.
fn form(argument: &clap::Arg) -> String {
    let values = argument.get_possible_values();
    let listed = values.iter().map(|value| value.get_name()).collect::<Vec<_>>().join("|");
    let named = argument.get_value_names().map_or(String::new(), |names| names.join(" "));
    let value = if listed.is_empty() { named } else { listed };
    let takes = argument.get_action().takes_values();
    match (argument.get_short(), argument.get_long()) {
        (_, None) => value,
        (short, Some(long)) => {
            let short = short.map_or(String::new(), |short| format!("-{short}, "));
            if takes { format!("{short}--{long} {value}") } else { format!("{short}--{long}") }
        }
    }
}

/// Text in a cell of a table.
fn cell(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|").replace('<', "&lt;")
}
