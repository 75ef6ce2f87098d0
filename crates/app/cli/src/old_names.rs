//! Names of flags and commands of the version before.

use std::ffi::OsString;
use weaver_command::{OldName, current_names};

/// All old names.
pub const OLD: [OldName; 24] = [
    OldName::renamed("fit", "--clean", &[]),
    OldName::renamed("reconstruct", "--clean", &[]),
    OldName::renamed("fit", "--size", &["--long-side"]),
    OldName::renamed("fit", "--views", &["--max-photos"]),
    OldName::renamed("fit", "--all", &["--hold-out", "none"]),
    OldName::replaced("fit", "--poses", "refine", &["--refine-cameras"]),
    OldName::replaced("fit", "--poses", "fixed", &["--set", "poses.refine=false"]),
    OldName::replaced("fit", "--init", "network", &["--init", "built-in"]),
    OldName::renamed("eval", "--look", &["--light-of"]),
    OldName::renamed("eval", "--plain", &["--as-taken"]),
    OldName::renamed("compare", "--size", &["--long-side"]),
    OldName::renamed("align", "--size", &["--long-side"]),
    OldName::renamed("align", "--refine-intrinsics", &["--refine-focal"]),
    OldName::renamed("infer", "--look", &["--light"]),
    OldName::renamed("dynamic train", "--size", &["--long-side"]),
    OldName::renamed("dynamic train", "--all", &["--hold-out", "none"]),
    OldName::renamed("dynamic distil", "--plain", &["--photos-alone"]),
    OldName::renamed("vad train", "--plain", &["--no-experts"]),
    OldName::renamed("lift", "--masks", &["--mask-dir"]),
    OldName::renamed("lift", "--gaussians", &["--demo-gaussians"]),
    OldName::renamed("query", "--features", &["--lifted"]),
    OldName::renamed("bench mixture", "--experts", &["--parts"]),
    OldName::valued("fit", "--focal", &["--refine-focal"]),
    OldName::valued("reconstruct", "--hold-out", &["--hold-out", "listed"]),
];

/// The words of a command line with today's names, and a line for each name that was another one.
pub fn current(mut words: Vec<OsString>) -> (Vec<OsString>, Vec<String>) {
    let mut notes = Vec::new();
    let text = |word: Option<&OsString>| word.and_then(|word| word.to_str()).unwrap_or_default().to_string();
    if text(words.get(1)) == "eval"
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
    let (words, renamed) = current_names(words, &OLD);
    notes.extend(renamed);
    (words, notes)
}
