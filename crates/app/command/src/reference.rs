//! The definition of a command line: its help in groups, a list of flags, a page; and the words that were given.

use clap::ArgMatches;
use clap::parser::ValueSource;
use std::fmt::Write;

/// A flag of a command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Flag {
    /// The command, with a space before a second word.
    pub command: String,
    /// The long name, without dashes.
    pub name: String,
    /// Name of its value, alternatives with `|` between; `None` for a switch.
    pub value: Option<String>,
    /// Its value where it is not given, as on the command line; `None` where there is none.
    pub default: Option<String>,
}

/// The flags of all commands of a program.
pub fn flags(program: &clap::Command) -> Vec<Flag> {
    let mut found = Vec::new();
    for command in program.get_subcommands() {
        let inner: Vec<_> = command.get_subcommands().collect();
        if inner.is_empty() {
            add_flags(command.get_name().to_string(), command, &mut found);
        }
        for second in inner {
            add_flags(format!("{} {}", command.get_name(), second.get_name()), second, &mut found);
        }
    }
    found
}

fn add_flags(name: String, command: &clap::Command, found: &mut Vec<Flag>) {
    for argument in command.get_arguments() {
        let Some(long) = argument.get_long() else { continue };
        let values = argument.get_possible_values();
        let named = argument.get_value_names().map(|names| names.join(" "));
        let listed = values.iter().map(|value| value.get_name()).collect::<Vec<_>>().join("|");
        let takes = argument.get_action().takes_values();
        let value = match (takes, named) {
            (false, _) => None,
            (true, Some(named)) if values.is_empty() => Some(named),
            (true, None) if values.is_empty() => Some("N".into()),
            (true, _) => Some(listed),
        };
        let default = argument.get_default_values().first().filter(|_| takes);
        let default = default.map(|value| value.to_string_lossy().into_owned());
        found.push(Flag { command: name.clone(), name: long.to_string(), value, default });
    }
}

/// Every command of a program with its arguments: the page `docs/reference/flags.md`, Markdown.
pub fn reference(program: &clap::Command) -> String {
    let mut page = String::from(
        "# Flags\n\nEvery command with what it takes; generated from the program's own definition. `splatweaver COMMAND --help` prints the same with examples. \
         [Conventions](conventions.md#flags) explain the flags that several commands have.\n",
    );
    add("Every command".into(), program, &mut page);
    for command in program.get_subcommands().filter(|command| !command.is_hide_set()) {
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

/// A program whose help lists its commands in groups: titles, and how many commands are in each, in their order.
pub fn grouped<'a>(program: clap::Command, groups: impl Iterator<Item = &'a (&'a str, usize)>) -> clap::Command {
    let commands: Vec<_> = program.get_subcommands().collect();
    let width = commands.iter().map(|command| command.get_name().len()).max().unwrap_or(0);
    let line = |command: &&clap::Command| {
        let about = command.get_about().map_or(String::new(), ToString::to_string);
        format!("  {:<width$}  {about}\n", command.get_name())
    };
    let mut left = commands.iter();
    let group = |(title, count): &(&str, usize)| {
        let lines: String = left.by_ref().take(*count).map(line).collect();
        format!("{title}:\n{lines}\n")
    };
    let groups: String = groups.filter(|(_, count)| *count > 0).map(group).collect();
    let template =
        format!("{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{groups}Options:\n{{options}}{{after-help}}");
    program.help_template(template)
}

/// The name of the command and the arguments that were given on the command line but for `silent` ones, a line each.
pub fn given_words(matches: &ArgMatches, silent: &[&str]) -> String {
    let Some((name, arguments)) = matches.subcommand() else { return String::new() };
    let given = arguments.ids().filter(|id| !silent.contains(&id.as_str()));
    let given = given.filter(|id| arguments.value_source(id.as_str()) == Some(ValueSource::CommandLine));
    let line = |id: &clap::Id| {
        let values = arguments.try_get_raw(id.as_str()).ok().flatten().into_iter().flatten();
        format!("{id} {:?}\n", values.collect::<Vec<_>>())
    };
    given.fold(format!("{name}\n"), |text, id| text + &line(id))
}

/// The threads requested of a command or of its second word.
pub fn asked_threads(matches: &ArgMatches) -> Option<usize> {
    let asked = matches.try_get_one::<u16>("threads").ok().flatten().map(|count| usize::from(*count));
    asked.or_else(|| asked_threads(matches.subcommand()?.1))
}
