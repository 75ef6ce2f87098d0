//! Rules on the text of sources.

use std::path::{Path, PathBuf};

/// A text file of the repository.
pub struct Source {
    /// Its path from the root of the workspace.
    pub place: String,
    /// Its path from the folder that was read.
    pub inside: String,
    pub text: String,
}

/// Longest source file.
const LONGEST: usize = 500;

/// The files below a folder whose text is checked, in order; none where there is no such folder.
pub fn below(root: &Path, folder: &Path) -> Result<Vec<Source>, String> {
    let mut sources = Vec::new();
    collect(root, folder, folder, true, &mut sources)?;
    Ok(sources)
}

/// The files in a folder whose text is checked, without its subfolders.
pub fn directly_in(root: &Path, folder: &Path) -> Result<Vec<Source>, String> {
    let mut sources = Vec::new();
    collect(root, folder, folder, false, &mut sources)?;
    Ok(sources)
}

fn collect(root: &Path, base: &Path, folder: &Path, deep: bool, sources: &mut Vec<Source>) -> Result<(), String> {
    if !folder.is_dir() {
        return Ok(());
    }
    let entries = std::fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut paths: Vec<PathBuf> = entries.filter_map(|e| e.ok().map(|e| e.path())).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() && deep {
            collect(root, base, &path, deep, sources)?;
        } else if path.extension().is_some_and(|e| ["rs", "md", "toml", "wgsl", "py"].iter().any(|known| e == *known)) {
            let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
            let relative = |to: &Path| path.strip_prefix(to).unwrap_or(&path).to_string_lossy().replace('\\', "/");
            sources.push(Source { place: relative(root), inside: relative(base), text });
        }
    }
    Ok(())
}

/// The files that sources include by `#[path = "..."]`.
pub fn borrowed(root: &Path, sources: &[Source]) -> Result<Vec<Source>, String> {
    let mut borrowed = Vec::new();
    for source in sources {
        for line in source.text.lines() {
            let path = line.trim().strip_prefix("#[path = \"").and_then(|rest| rest.strip_suffix("\"]"));
            let folder = root.join(&source.place);
            let (Some(path), Some(folder)) = (path, folder.parent()) else { continue };
            let path = folder.join(path);
            let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
            let place = path.display().to_string();
            borrowed.push(Source { inside: place.clone(), place, text });
        }
    }
    Ok(borrowed)
}

/// A rule on source text: patterns, the crates that are free to use them, and a description.
struct Rule {
    patterns: &'static [&'static str],
    free: &'static [&'static str],
    what: &'static str,
    /// Single files that are free as well.
    except: &'static [&'static str],
}

/// The only source that maps files into memory, for which the standard library has no safe function.
const MAPPED_FILE: &str = "crates/scene/io/src/files/mapped_file.rs";

const RULES: &[Rule] = &[
    Rule {
        patterns: &["unsafe ", "unsafe{"],
        free: &["weaver-kernels", "xtask"],
        what: "unsafe code",
        except: &[MAPPED_FILE],
    },
    Rule {
        patterns: &["println!", "eprintln!", "print!(", "eprint!(", "dbg!("],
        free: &["weaver-cli", "xtask", "weaver-parity", "weaver-studies"],
        what: "printing",
        except: &[],
    },
    Rule {
        patterns: &["std::fs", "File::open", "File::create", "fs::read", "fs::write"],
        free: &[
            "weaver-io",
            "weaver-bench",
            "weaver-cli",
            "xtask",
            "weaver-parity",
            "weaver-studies",
            "weaver-compression",
            "weaver-tests",
            "weaver-fixtures",
        ],
        what: "opening files",
        except: &[],
    },
    Rule {
        patterns: &["todo!(", "unimplemented!(", "FIXME", "TODO"],
        free: &["xtask"],
        what: "unfinished work",
        except: &[],
    },
];

/// The text of a source without its unit tests, which are free of rules for the product.
pub fn product(text: &str) -> &str {
    text.split("#[cfg(test)]").next().unwrap_or(text)
}

pub fn check(source: &Source, package: &str, faults: &mut Vec<String>) {
    let place = source.place.as_str();
    let Some(stem) = place.rsplit('/').next().unwrap_or(place).strip_suffix(".rs") else { return };
    if ["util", "utils", "helper", "helpers", "common", "misc"].contains(&stem) {
        faults.push(format!("{place}: a module is named after the thing it holds"));
    }
    let lines = source.text.lines().count();
    if lines > LONGEST {
        faults.push(format!("{place}: {lines} lines, more than {LONGEST}"));
    }
    for (number, line) in product(&source.text).lines().enumerate() {
        let code = line.trim_start();
        if code.starts_with("//") {
            continue;
        }
        if package != "xtask" && is_command_with_holes(code) {
            let rule = "ShellCommand quotes the words of a command that is printed";
            faults.push(format!("{place}:{}: {rule}", number + 1));
        }
        for rule in RULES.iter().filter(|r| !r.free.contains(&package) && !r.except.contains(&place)) {
            if rule.patterns.iter().any(|p| code.contains(p)) {
                faults.push(format!("{place}:{}: {} does not belong into {package}", number + 1, rule.what));
            }
        }
    }
}

/// True if a line has a command of the program's within a text, and in it a place for a value.
fn is_command_with_holes(code: &str) -> bool {
    let mut commands = code.split("splatweaver ").skip(1);
    commands.any(|rest| !rest.starts_with('{') && rest.split(['"', '`', ';']).next().unwrap_or(rest).contains('{'))
}

/// Letters that the name of a test may have; a sentence is its doc comment.
const LONGEST_NAME: usize = 50;

/// Names of tests are short.
fn check_names(source: &Source, faults: &mut Vec<String>) {
    let mut test = false;
    for (number, line) in source.text.lines().enumerate() {
        let line = line.trim_start();
        if let Some((name, _)) = line.strip_prefix("fn ").and_then(|line| line.split_once('(')) {
            if test && name.len() > LONGEST_NAME {
                let found = format!("a name of {} letters, more than {LONGEST_NAME}", name.len());
                faults.push(format!("{}:{}: {found}", source.place, number + 1));
            }
            test = false;
        }
        test |= line == "#[test]";
    }
}

/// Tests have short names, and property tests draw a part of proptest's configured cases, so that `cargo xtask stress`
/// can set more.
pub fn check_test(source: &Source, faults: &mut Vec<String>) {
    check_names(source, faults);
    for (number, line) in source.text.lines().enumerate() {
        let fixed = ["with_cases(", "ProptestConfig { cases: "].iter().any(|start| {
            let count = line.split_once(start).map(|(_, count)| count);
            count.is_some_and(|count| count.starts_with(|c: char| c.is_ascii_digit()))
        });
        if fixed {
            let rule = "write a part of `ProptestConfig::default().cases`";
            faults.push(format!("{}:{}: a fixed number of random cases; {rule}", source.place, number + 1));
        }
    }
}

/// Words that begin a question and not the name of a thing.
const QUESTIONS: [&str; 4] = ["What ", "How ", "Whether ", "Whose "];

/// Doc comments begin with a noun or a verb.
pub fn check_comments(source: &Source, faults: &mut Vec<String>) {
    let mut inside = false;
    for (number, line) in source.text.lines().enumerate() {
        let comment = line.trim_start().strip_prefix("///").map(str::trim_start);
        if let Some(word) = comment.filter(|_| !inside).and_then(|text| QUESTIONS.iter().find(|q| text.starts_with(*q)))
        {
            let place = &source.place;
            faults.push(format!(
                "{place}:{}: a doc comment begins with a noun or a verb, not {}",
                number + 1,
                word.trim()
            ));
        }
        inside = comment.is_some();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Promise of `commands_to_go_on_can_be_pasted`.
    #[test]
    fn printed_commands_have_no_holes() {
        for code in [r#"format!("to go on: splatweaver fit --resume {folder}")"#, "\"`splatweaver info {}` tells\""] {
            assert!(is_command_with_holes(code), "{code}");
        }
        for code in [r#"format!("{file}: `splatweaver view` needs {n}")"#, r#"format!("  splatweaver {example}")"#] {
            assert!(!is_command_with_holes(code), "{code}");
        }
    }

    #[test]
    fn comments_begin_with_a_noun_or_a_verb() {
        let text =
            "/// The number.\n/// How many is another sentence.\nfn f() {}\n    /// Whether it is.\n    fn g() {}";
        let mut faults = Vec::new();
        check_comments(&Source { place: "t.rs".into(), inside: String::new(), text: text.into() }, &mut faults);
        assert_eq!(faults, ["t.rs:4: a doc comment begins with a noun or a verb, not Whether"]);
    }

    #[test]
    fn names_of_tests_are_short() {
        let long = "x".repeat(LONGEST_NAME + 1);
        let text = format!("fn {long}() {{}}\n#[test]\n#[cfg(unix)]\nfn {long}() {{}}\n#[test]\nfn short() {{}}\n");
        let mut faults = Vec::new();
        check_names(&Source { place: "t.rs".into(), inside: String::new(), text }, &mut faults);
        assert_eq!(faults, ["t.rs:4: a name of 51 letters, more than 50"]);
    }

    #[test]
    fn faults_are_found() {
        let faults_in = |place: &str, text: &str, package: &str| {
            let mut faults = Vec::new();
            check(&Source { place: place.into(), inside: String::new(), text: text.into() }, package, &mut faults);
            faults
        };
        let text = "fn f() { println!(\"x\"); }\n// println! in a comment\n";
        assert_eq!(faults_in("crates/engine/nn/src/utils.rs", text, "weaver-nn").len(), 2);
        let fixed =
            "#![proptest_config(ProptestConfig::with_cases(24))]\n#![proptest_config(ProptestConfig::with_cases(n))]";
        let mut faults = Vec::new();
        check_test(&Source { place: "t.rs".into(), inside: String::new(), text: fixed.into() }, &mut faults);
        assert_eq!(faults.len(), 1, "{faults:?}");
        // Free in one file of the crate, not in the others.
        assert!(faults_in(MAPPED_FILE, "unsafe { f() }", "weaver-io").is_empty());
        assert_eq!(
            faults_in("crates/scene/io/src/info.rs", "unsafe { f() }", "weaver-io"),
            ["crates/scene/io/src/info.rs:1: unsafe code does not belong into weaver-io"]
        );
    }
}
