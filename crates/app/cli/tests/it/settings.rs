//! Settings of a command by name.

use std::ffi::OsString;
use weaver_cli::{Request, Value};

fn named(command: &str, settings: Vec<(&str, Value)>) -> Result<Request, String> {
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
        (vec![("photos", text("a")), ("out", text("c")), ("masks", Value::Flag(true))], "cameras -o c --masks -- a"),
        (vec![("photos", text("a")), ("out", text("c")), ("masks", text("m"))], "cameras -o c --masks=m -- a"),
        (vec![("photos", text("a")), ("out", text("c")), ("masks", Value::Flag(false))], "cameras -o c -- a"),
        (vec![("capture", text("a")), ("background", list(&["1", "0.5", "0"]))], "fit --background 1,0.5,0 a"),
        (vec![("capture", text("a")), ("set", list(&["seed=1", "steps=2"]))], "fit --set seed=1 --set steps=2 a"),
        (vec![("photos", list(&["a", "b"])), ("out", text("c"))], "cameras a b -o c"),
        #[cfg(feature = "lift")]
        (vec![("demo", list(&["1", "2"]))], "lift --demo 1 2"),
    ] {
        let words: Vec<OsString> = std::iter::once("splatweaver").chain(words.split(' ')).map(OsString::from).collect();
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
        ("fit", vec![("gaussians", text("0"))], "invalid value '0' for '--gaussians <N>': 0 is not in 1..=100000000"),
        ("fit", vec![("masks", text("3"))], "unexpected value '3' for '--masks' found; no more were expected"),
        ("cameras", vec![("photos", text("a"))], "the following required arguments were not provided: --out <DIR>"),
        ("fly", vec![], "unrecognized subcommand 'fly'"),
    ] {
        let refusal = named(command, settings).unwrap_err();
        assert_eq!(refusal, expected);
    }
}
