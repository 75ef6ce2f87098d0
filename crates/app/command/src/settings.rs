//! Settings of a command by name, as a program without a command line has them.

use clap::{Arg, ArgAction};
use std::ffi::OsString;

/// The value of a setting that is given by name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Value {
    /// Yes or no.
    Flag(bool),
    /// A number, a word or a path, as text.
    Text(OsString),
    /// Several of them.
    List(Vec<OsString>),
}

/// The words of a command of a program with settings by name: a flag's long one with `_` for `-`, or a place's as the
/// struct of the command has it.
pub fn words_of(
    program: &clap::Command,
    command: &str,
    settings: impl IntoIterator<Item = (String, Value)>,
) -> Vec<OsString> {
    let known = program.find_subcommand(command);
    let arguments: Vec<&Arg> = known.into_iter().flat_map(|command| command.get_arguments()).collect();
    let mut words = vec![OsString::from(program.get_name()), command.into()];
    let mut places = vec![OsString::from("--")];
    for (name, value) in settings {
        let flag = name.replace('_', "-");
        let place = arguments.iter().find(|argument| argument.is_positional() && argument.get_id() == name.as_str());
        match (place, value) {
            (Some(_), Value::List(values)) => places.extend(values),
            (Some(_), Value::Text(value)) => places.push(value),
            (_, value) => {
                let argument = arguments.iter().find(|argument| argument.get_long() == Some(&flag));
                words.extend(flag_words(&flag, argument.copied(), value));
            }
        }
    }
    words.extend(places);
    words
}

/// The words of a flag with this value.
fn flag_words(flag: &str, argument: Option<&Arg>, value: Value) -> Vec<OsString> {
    let action = argument.map(Arg::get_action);
    let with = |value: OsString| {
        let mut word = OsString::from(format!("--{flag}="));
        word.push(value);
        word
    };
    // A flag whose value may be left out is a switch, too, unless the value is yes or no.
    let alone = |argument: &Arg| {
        let takes = argument.get_num_args().is_some_and(|number| number.min_values() == 0 && number.takes_values());
        takes && argument.get_value_names().is_some_and(|names| names[0] != "BOOL")
    };
    let switch = matches!(action, Some(ArgAction::SetTrue)) || argument.is_some_and(alone);
    match value {
        Value::Flag(false) if switch => vec![],
        Value::Flag(true) if switch => vec![format!("--{flag}").into()],
        Value::Flag(value) => vec![with(value.to_string().into())],
        Value::Text(value) => vec![with(value)],
        Value::List(values) if matches!(action, Some(ArgAction::Append)) => values.into_iter().map(with).collect(),
        Value::List(values) => vec![with(values.join(",".as_ref()))],
    }
}
