//! Names of flags and commands of the version before, which are read for one more release.

use std::ffi::OsString;

/// An old word and its reading.
struct Old {
    /// The command, and its second word where it has one.
    command: &'static str,
    /// The word.
    word: &'static str,
    /// The value that it must have; `None` for any value or none.
    value: Option<&'static str>,
    /// The words in its place; with `value`, in place of both.
    now: &'static [&'static str],
}

const fn renamed(command: &'static str, word: &'static str, now: &'static [&'static str]) -> Old {
    Old { command, word, value: None, now }
}

const fn replaced(command: &'static str, word: &'static str, value: &'static str, now: &'static [&'static str]) -> Old {
    Old { command, word, value: Some(value), now }
}

const OLD: [Old; 22] = [
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

/// In place of a command: a word that had no value, and has one now. `word` is the command, `value` the word.
const SWITCH: &str = "";

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
            Old { command: SWITCH, word, value: flag, .. } => {
                *word == command && Some(&*name) == *flag && value.is_none() && !next.as_deref().is_some_and(is_value)
            }
            Old { command: of, word, value, .. } => {
                (*of == command || *of == both)
                    && *word == name
                    && value.is_none_or(|value| next.as_deref() == Some(value))
            }
        });
        let Some(Old { command: of, now, value: expected, .. }) = old else {
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

#[cfg(test)]
#[cfg(feature = "methods")]
mod tests {
    use super::*;

    #[test]
    fn names_of_before_become_those_of_today() {
        for (before, today) in [
            (
                "fit a --size 640 --all --poses refine --focal",
                "fit a --long-side 640 --hold-out none --refine-cameras --refine-focal",
            ),
            (
                "fit a --size=640 --poses=fixed --init network",
                "fit a --long-side 640 --set poses.refine=false --init built-in",
            ),
            ("fit a --focal 1.2 --cameras estimated", "fit a --focal 1.2 --cameras estimated"),
            ("reconstruct a --hold-out -o b", "reconstruct a --hold-out listed -o b"),
            ("reconstruct a --hold-out 8 -o b", "reconstruct a --hold-out 8 -o b"),
            ("eval --scene x.ply --data y --size 5", "compare x.ply --data y --long-side 5"),
            ("eval --data y --scene=x.ply", "compare --data y x.ply"),
            ("dynamic train --size 64 --all", "dynamic train --long-side 64 --hold-out none"),
            ("vad train --plain --steps 5", "vad train --no-experts --steps 5"),
            ("fit a --views 3", "fit a --max-photos 3"),
            ("bench mixture --experts 4", "bench mixture --parts 4"),
            ("cameras a -o b --match-size 300", "cameras a -o b --match-size 300"),
        ] {
            let words =
                |line: &str| std::iter::once("splatweaver").chain(line.split(' ')).map(OsString::from).collect();
            let (found, notes) = current(words(before));
            assert_eq!(found, words(today) as Vec<OsString>, "{before}");
            assert_eq!(notes.is_empty(), before == today, "{notes:?}");
            assert!(crate::parses(found).is_ok(), "{before}");
        }
    }

    /// An old name is no flag of today's, and stands for one that the command has.
    ///
    /// Promise (files): an old name of a flag stands for one that the command has, and is none of today's.
    #[test]
    fn old_names_stand_for_flags_that_there_are() {
        let flags = crate::flags();
        let has = |command: &str, word: &str| {
            flags.iter().any(|flag| flag.command == command && word.strip_prefix("--") == Some(&flag.name))
        };
        for Old { command, word, value, now } in OLD.iter().filter(|old| old.command != SWITCH) {
            assert!(has(command, now[0]), "{command} {}", now[0]);
            assert!(value.is_some() || !has(command, word), "{command} {word} is a flag of today's");
        }
        for Old { word: command, now, .. } in OLD.iter().filter(|old| old.command == SWITCH) {
            assert!(has(command, now[0]), "{command} {}", now[0]);
        }
    }
}
