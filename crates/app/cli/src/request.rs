//! A command with its settings, given as words or by name.

use crate::command_line::CommandLine;
use crate::{FailureKind, Refusal, units};
use clap::{Arg, ArgAction, CommandFactory};
use std::ffi::OsString;
use weaver_command::{Console, Failure, Interrupt, fewer_threads};
use weaver_kernels::simd;

/// A command and its settings, ready to run, as the command line and the Python package make them.
///
/// The settings are one struct for each command, which clap fills; so defaults, limits and messages are the same for
/// both callers.
#[derive(Debug)]
pub struct Request(CommandLine);

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
    pub fn of_settings(command: &str, settings: impl IntoIterator<Item = (String, Value)>) -> Result<Self, Refusal> {
        let program = CommandLine::command();
        let known = program.find_subcommand(command);
        let arguments: Vec<&Arg> = known.into_iter().flat_map(|command| command.get_arguments()).collect();
        let mut words = vec![OsString::from("splatweaver"), command.into()];
        let mut places = vec![OsString::from("--")];
        for (name, value) in settings {
            let flag = name.replace('_', "-");
            let place =
                arguments.iter().find(|argument| argument.is_positional() && argument.get_id() == name.as_str());
            match (place, value) {
                (Some(_), Value::List(values)) => places.extend(values),
                (Some(_), Value::Text(value)) => places.push(value),
                (_, value) => {
                    let argument = arguments.iter().find(|argument| argument.get_long() == Some(&flag));
                    words.extend(flag_words(&flag, argument.copied(), value));
                }
            }
        }
        Self::of_words(words.into_iter().chain(places)).map_err(|error| {
            let text = error.render().to_string();
            let told = text.split("\n\n").next().unwrap_or_default().trim_start_matches("error: ");
            let line = told.split_whitespace().collect::<Vec<_>>().join(" ");
            Refusal { kind: FailureKind::Input, line: Some(line) }
        })
    }

    /// Runs the command, with its output on the console.
    pub(crate) fn carry_out(&self, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
        simd::requested_level().map_err(Failure::Usage)?;
        self.0.paths.check()?;
        fewer_threads(self.0.threads).iter().for_each(|note| console.note(note));
        units::run(&self.0.command, &self.0.settings, console, interrupt)
    }

    /// Runs the command, for programs that have no exit code.
    ///
    /// # Errors
    /// The reason that the program prints.
    pub fn run(&self, console: &mut Console, interrupt: &Interrupt) -> Result<(), Refusal> {
        self.carry_out(console, interrupt).map_err(|failure| Refusal::of(&failure))
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn named(command: &str, settings: Vec<(&str, Value)>) -> Result<Request, Refusal> {
        Request::of_settings(command, settings.into_iter().map(|(name, value)| (name.to_string(), value)))
    }

    fn text(value: &str) -> Value {
        Value::Text(value.into())
    }

    fn list(values: &[&str]) -> Value {
        Value::List(values.iter().map(OsString::from).collect())
    }

    #[test]
    fn settings_by_name_are_those_in_words() {
        for (settings, words) in [
            (vec![("capture", text("-x")), ("steps", text("5"))], "fit --steps 5 -- -x"),
            (vec![("capture", text("a")), ("refine_cameras", Value::Flag(true))], "fit --refine-cameras a"),
            (vec![("capture", text("a")), ("masks", Value::Flag(false))], "fit a"),
            (vec![("capture", text("a")), ("exposure", Value::Flag(false))], "fit --exposure=false a"),
            (
                vec![("photos", text("a")), ("out", text("c")), ("masks", Value::Flag(true))],
                "cameras -o c --masks -- a",
            ),
            (vec![("photos", text("a")), ("out", text("c")), ("masks", text("m"))], "cameras -o c --masks=m -- a"),
            (vec![("photos", text("a")), ("out", text("c")), ("masks", Value::Flag(false))], "cameras -o c -- a"),
            (vec![("capture", text("a")), ("background", list(&["1", "0.5", "0"]))], "fit --background 1,0.5,0 a"),
            (vec![("capture", text("a")), ("set", list(&["seed=1", "steps=2"]))], "fit --set seed=1 --set steps=2 a"),
            (vec![("photos", list(&["a", "b"])), ("out", text("c"))], "cameras a b -o c"),
            #[cfg(feature = "lift")]
            (vec![("demo", list(&["1", "2"]))], "lift --demo 1 2"),
        ] {
            let words: Vec<OsString> =
                std::iter::once("splatweaver").chain(words.split(' ')).map(OsString::from).collect();
            let command = words[1].to_str().unwrap().to_string();
            let expected = Request::of_words(words).unwrap();
            let found = named(&command, settings).unwrap();
            assert_eq!(format!("{found:?}"), format!("{expected:?}"));
        }
    }

    #[test]
    fn wrong_settings_are_told_in_one_line() {
        for (command, settings, expected) in [
            ("fit", vec![("nonsense", text("1"))], "unexpected argument '--nonsense' found"),
            (
                "fit",
                vec![("gaussians", text("0"))],
                "invalid value '0' for '--gaussians <N>': 0 is not in 1..=100000000",
            ),
            ("fit", vec![("masks", text("3"))], "unexpected value '3' for '--masks' found; no more were expected"),
            ("cameras", vec![("photos", text("a"))], "the following required arguments were not provided: --out <DIR>"),
            ("fly", vec![], "unrecognized subcommand 'fly'"),
        ] {
            let refusal = named(command, settings).unwrap_err();
            assert_eq!((refusal.kind, refusal.line.as_deref()), (FailureKind::Input, Some(expected)));
        }
    }
}
