//! Names of flags and commands of the version before.

use std::ffi::OsString;
use weaver_cli::Request;
use weaver_command::OldName;

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
        let words = |line: &str| std::iter::once("splatweaver").chain(line.split(' ')).map(OsString::from).collect();
        let (found, notes) = weaver_cli::current(words(before));
        assert_eq!(found, words(today) as Vec<OsString>, "{before}");
        assert_eq!(notes.is_empty(), before == today, "{notes:?}");
        assert!(Request::of_words(found).is_ok(), "{before}");
    }
}

/// An old name is no flag of today's, and stands for one that the command has.
///
/// Promise (files): an old name of a flag stands for one that the command has, and is none of today's.
#[test]
fn old_names_stand_for_flags_that_there_are() {
    let flags = weaver_command::flags(&weaver_cli::program());
    let has = |command: &str, word: &str| {
        flags.iter().any(|flag| flag.command == command && word.strip_prefix("--") == Some(&flag.name))
    };
    for OldName { command, word, value, now } in weaver_cli::OLD {
        let (command, word) = if command.is_empty() { (word, None) } else { (command, Some(word)) };
        assert!(now.first().is_none_or(|now| has(command, now)), "{command} {now:?}");
        if let Some(word) = word {
            assert!(value.is_some() || !has(command, word), "{command} {word} is a flag of today's");
        }
    }
}
