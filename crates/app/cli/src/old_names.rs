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

const fn renamed(command: &'static str, word: &'static str, now: &'static [&'static str]) -> OldName {
    OldName { command, word, value: None, now }
}

const fn replaced(
    command: &'static str,
    word: &'static str,
    value: &'static str,
    now: &'static [&'static str],
) -> OldName {
    OldName { command, word, value: Some(value), now }
}

const OLD: [OldName; 22] = [
    renamed("fit", "--size", &["--long-side"]),
    renamed("fit", "--views", &["--max-photos"]),
    renamed("fit", "--all", &["--hold-out", "none"]),
    replaced("fit", "--poses", "refine", &["--refine-cameras"]),
    replaced("fit", "--poses", "fixed", &["--set", "poses.refine=false"]),
    replaced("fit", "--init", "network", &["--init", "built-in"]),
    renamed("eval", "--look", &["--light-of"]),
    renamed("eval", "--plain", &["--as-taken"]),
    renamed("compare", "--size", &["--long-side"]),
    renamed("align", "--size", &["--long-side"]),
    renamed("align", "--refine-intrinsics", &["--refine-focal"]),
    renamed("infer", "--look", &["--light"]),
    renamed("dynamic train", "--size", &["--long-side"]),
    renamed("dynamic train", "--all", &["--hold-out", "none"]),
    renamed("dynamic distil", "--plain", &["--photos-alone"]),
    renamed("vad train", "--plain", &["--no-experts"]),
    renamed("lift", "--masks", &["--mask-dir"]),
    renamed("lift", "--gaussians", &["--demo-gaussians"]),
    renamed("query", "--features", &["--lifted"]),
    renamed("bench mixture", "--experts", &["--parts"]),
    replaced(SWITCH, "fit", "--focal", &["--refine-focal"]),
    replaced(SWITCH, "reconstruct", "--hold-out", &["--hold-out", "listed"]),
];

/// The command of a word that had no value, and has one now.
const SWITCH: &str = "";

/// All old names.
pub fn old_names() -> &'static [OldName] {
    &OLD
}

/// The words of a command line with today's names, and a line for each name that was another one.
pub fn current(mut words: Vec<OsString>) -> (Vec<OsString>, Vec<String>) {
    let mut notes = Vec::new();
    let text = |word: Option<&OsString>| word.and_then(|word| word.to_str()).unwrap_or_default().to_string();
    let (first, second) = (text(words.get(1)), text(words.get(2)));
    if first == "eval"
        && let Some(at) = words.iter().position(|word| word == "--scene" || text(Some(word)).starts_with("--scene="))
    {
        // The scene is the first argument of `compare`.
        words[1] = "compare".into();
        match text(words.get(at)).strip_prefix("--scene=") {
            Some(scene) => words[at] = scene.into(),
            None => drop(words.remove(at)),
        }
        notes.push("note: `eval --scene SCENE` is called `compare SCENE` now".to_string());
    }
    let command = text(words.get(1));
    let both = format!("{first} {second}");
    let mut out: Vec<OsString> = Vec::with_capacity(words.len());
    let mut rest = words.into_iter().peekable();
    while let Some(word) = rest.next() {
        let (name, value) = match word.to_str().and_then(|word| word.split_once('=')) {
            Some((name, value)) => (name.to_string(), Some(value.to_string())),
            None => (text(Some(&word)), None),
        };
        let next = value.clone().or_else(|| rest.peek().and_then(|next| next.to_str()).map(String::from));
        let old = OLD.iter().find(|old| match old {
            OldName { command: SWITCH, word, value: flag, .. } => {
                *word == command && Some(&*name) == *flag && value.is_none() && !next.as_deref().is_some_and(is_value)
            }
            OldName { command: of, word, value, .. } => {
                (*of == command || *of == both)
                    && *word == name
                    && value.is_none_or(|value| next.as_deref() == Some(value))
            }
        });
        let Some(OldName { command: of, now, value: expected, .. }) = old else {
            out.push(word);
            continue;
        };
        notes.push(format!("note: `{name}` is called `{}` now", now.join(" ")));
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

/// True if a word is a value of `--focal` or of `--hold-out`.
fn is_value(word: &str) -> bool {
    ["listed", "none"].contains(&word) || word.parse::<f64>().is_ok()
}
