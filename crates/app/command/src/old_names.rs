//! Names of flags and commands of the version before, which are read for one more release.

use std::ffi::OsString;

/// An old word and its reading.
#[derive(Clone, Copy, Debug)]
pub struct OldName {
    /// The command, and its second word where it has one. Empty for a flag that had no value and has one now: `word` is
    /// then the command, `value` the flag.
    pub command: &'static str,
    /// The word.
    pub word: &'static str,
    /// The value that it must have; `None` for any value or none.
    pub value: Option<&'static str>,
    /// The words in its place; with `value`, in place of both.
    pub now: &'static [&'static str],
}

impl OldName {
    /// A word with another name now; without one it says what is the default.
    pub const fn renamed(command: &'static str, word: &'static str, now: &'static [&'static str]) -> Self {
        Self { command, word, value: None, now }
    }

    /// A word that is another one now where it has this value.
    pub const fn replaced(
        command: &'static str,
        word: &'static str,
        value: &'static str,
        now: &'static [&'static str],
    ) -> Self {
        Self { command, word, value: Some(value), now }
    }

    /// A flag of a command that had no value, and has one now.
    pub const fn valued(command: &'static str, flag: &'static str, now: &'static [&'static str]) -> Self {
        Self::replaced(SWITCH, command, flag, now)
    }
}

/// The command of a word that had no value, and has one now.
const SWITCH: &str = "";

/// The words of a command line with today's names in place of `old` ones, and a line for each name that was another
/// one.
pub fn current_names(words: Vec<OsString>, old: &[OldName]) -> (Vec<OsString>, Vec<String>) {
    let mut notes = Vec::new();
    let text = |word: Option<&OsString>| word.and_then(|word| word.to_str()).unwrap_or_default().to_string();
    let command = text(words.get(1));
    let both = format!("{command} {}", text(words.get(2)));
    let mut out: Vec<OsString> = Vec::with_capacity(words.len());
    let mut rest = words.into_iter().peekable();
    while let Some(word) = rest.next() {
        let (name, value) = match word.to_str().and_then(|word| word.split_once('=')) {
            Some((name, value)) => (name.to_string(), Some(value.to_string())),
            None => (text(Some(&word)), None),
        };
        let next = value.clone().or_else(|| rest.peek().and_then(|next| next.to_str()).map(String::from));
        let found = old.iter().find(|old| match old {
            OldName { command: SWITCH, word, value: flag, .. } => {
                *word == command && Some(&*name) == *flag && value.is_none() && !next.as_deref().is_some_and(is_value)
            }
            OldName { command: of, word, value, .. } => {
                (*of == command || *of == both)
                    && *word == name
                    && value.is_none_or(|value| next.as_deref() == Some(value))
            }
        });
        let Some(OldName { command: of, now, value: expected, .. }) = found else {
            out.push(word);
            continue;
        };
        notes.push(match now.is_empty() {
            true => format!("note: `{name}` is what happens without it now"),
            false => format!("note: `{name}` is called `{}` now", now.join(" ")),
        });
        out.extend(now.iter().map(OsString::from));
        if *of != SWITCH && expected.is_some() {
            // The value is among the new words.
            if value.is_none() {
                rest.next();
            }
        } else {
            out.extend(value.map(OsString::from));
        }
    }
    (out, notes)
}

/// True if a word is a value of a flag that had none before: a number, `listed` or `none`.
fn is_value(word: &str) -> bool {
    ["listed", "none"].contains(&word) || word.parse::<f64>().is_ok()
}
