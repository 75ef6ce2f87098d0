//! The page of promises: each stands in the comment of the test that holds the program to it, and tidy keeps the page.
//!
//! A test promises with `/// Promise (section): text.`, or shares the promise of another with `/// Promise of
//! `other_test`.`, first looked for in the same file.

use super::sources::Source;
use super::{Workspace, required};
use std::collections::BTreeMap;

const PAGE: &str = "docs/contribute/tests.md";

/// Sections of the page in their order: the word in the comments of tests, and the heading.
const SECTIONS: &[(&str, &str)] = &[
    ("results", "Results that are right"),
    ("scenes", "Scenes to look at"),
    ("photos", "Your own photos"),
    ("figures", "Figures that a command reports"),
    ("options", "Options that take effect"),
    ("kept", "Nothing is lost"),
    ("files", "Outputs, inputs and units of work"),
    ("fits", "Fits, cameras and scans"),
    ("servers", "Servers, Python and files from elsewhere"),
];

const HEAD: &str = "# Promises and their tests

Promises to users, each with the tests that fail where it does not hold. The page is made from the lines
`/// Promise (section): ...` in the comments of tests: `UPDATE_PAGES=1 cargo xtask tidy` writes it, and
`cargo xtask tidy` checks it. Sweeps of many minutes run under `cargo xtask stress`
([contributing.md](contributing.md)); tries by hand on every command are in [hostile use](../results/hostile-use.md).
";

/// Checks the page, or writes it if the environment has `UPDATE_PAGES`.
pub fn check(workspace: &Workspace, faults: &mut Vec<String>) {
    let packages = workspace.packages.iter().flat_map(|package| package.sources.iter().chain(&package.tests));
    let mut marks: Vec<Mark> = packages.flat_map(marks).collect();
    marks.sort_by(|a, b| a.place.cmp(b.place));
    let page = page(&marks, faults);
    if std::env::var_os("UPDATE_PAGES").is_some() {
        if let Err(error) = std::fs::write(workspace.root.join(PAGE), page) {
            faults.push(format!("{PAGE}: {error}"));
        }
    } else if page != required(&workspace.root, PAGE, faults) {
        faults.push(format!("{PAGE} differs from the promises of the tests: UPDATE_PAGES=1 cargo xtask tidy"));
    }
}

/// A promise in the comment of a test.
struct Mark<'a> {
    place: &'a str,
    test: &'a str,
    text: String,
}

impl Mark<'_> {
    /// The section and the promise, if it is not another test's.
    fn own(&self) -> Option<(&str, &str)> {
        let (section, text) = self.text.strip_prefix("Promise (")?.split_once("): ")?;
        Some((section, text.strip_suffix('.').unwrap_or(text)))
    }

    /// The name of the test whose promise this one shares.
    fn shared(&self) -> Option<&str> {
        self.text.strip_prefix("Promise of `")?.strip_suffix("`.")
    }
}

/// The promises in the comments of a source, in Rust or Python.
fn marks(source: &Source) -> Vec<Mark<'_>> {
    let (mut marks, mut pending) = (Vec::new(), Vec::<String>::new());
    let mut inside = false;
    for line in source.text.lines().map(str::trim_start) {
        let comment = line.strip_prefix("///").or(line.strip_prefix("# ")).map(str::trim);
        let function = line.strip_prefix("fn ").or(line.strip_prefix("def ")).and_then(|line| line.split_once('('));
        match comment {
            Some(text) if text.starts_with("Promise (") || text.starts_with("Promise of `") => {
                pending.push(text.to_string());
                inside = true;
            }
            Some(text) if inside && !text.is_empty() => {
                if let Some(promise) = pending.last_mut() {
                    *promise += " ";
                    *promise += text;
                }
            }
            _ => inside = false,
        }
        if let Some((test, _)) = function {
            marks.extend(pending.drain(..).map(|text| Mark { place: &source.place, test, text }));
        }
    }
    marks
}

/// The page, a table for each section, its promises in the order of the files of their first tests.
fn page(marks: &[Mark], faults: &mut Vec<String>) -> String {
    let mut also: BTreeMap<_, Vec<&Mark>> = BTreeMap::new();
    for mark in marks.iter().filter(|mark| mark.own().is_none()) {
        match first_test(mark, marks) {
            Some(first) => also.entry((first.place, first.test)).or_default().push(mark),
            None => faults.push(format!("{}: {} shares no promise: {}", mark.place, mark.test, mark.text)),
        }
    }
    let mut page = HEAD.to_string();
    for (key, heading) in SECTIONS {
        page += &format!("\n## {heading}\n\n| promise | tests |\n|---|---|\n");
        for mark in marks {
            let Some((_, text)) = mark.own().filter(|(section, _)| section == key) else { continue };
            let also = also.get(&(mark.place, mark.test)).into_iter().flatten().copied();
            let tests: Vec<_> =
                std::iter::once(mark).chain(also).map(|m| format!("`{}::{}`", m.place, m.test)).collect();
            page += &format!("| {text} | {} |\n", tests.join(", "));
        }
    }
    for mark in marks {
        if let Some((section, _)) = mark.own().filter(|(section, _)| SECTIONS.iter().all(|(key, _)| key != section)) {
            faults.push(format!("{}: {}: no section of promises is named {section}", mark.place, mark.test));
        }
    }
    page
}

/// The test whose promise another shares: the test of this name in the same file, or the only one elsewhere.
fn first_test<'a>(mark: &Mark, marks: &'a [Mark<'a>]) -> Option<&'a Mark<'a>> {
    let name = mark.shared()?;
    let named = || marks.iter().filter(|other| other.test == name && other.own().is_some());
    if let Some(beside) = named().find(|other| other.place == mark.place) {
        return Some(beside);
    }
    let first = named().next()?;
    named().all(|other| other.place == first.place).then_some(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(place: &str, text: &str) -> Source {
        Source { place: place.into(), inside: String::new(), text: text.into() }
    }

    #[test]
    fn promises_and_their_tests_make_rows() {
        let rust = source(
            "a.rs",
            "/// A sentence.\n///\n/// Promise (photos): one\n/// and one.\n/// Promise (kept): two.\n#[test]\nfn a() {}\n",
        );
        let python = source("b.py", "# Promise of `a`.\ndef test_b():\n");
        let marks: Vec<_> = [&rust, &python].into_iter().flat_map(marks).collect();
        let mut faults = Vec::new();
        let page = page(&marks, &mut faults);
        assert!(page.contains("| one and one | `a.rs::a`, `b.py::test_b` |"), "{page}");
        assert!(page.contains("| two | `a.rs::a`, `b.py::test_b` |"), "{page}");
        assert!(faults.is_empty(), "{faults:?}");
    }

    #[test]
    fn what_leads_nowhere_is_a_fault() {
        let text = "/// Promise of `gone`.\nfn a() {}\n/// Promise (other): one.\nfn b() {}\n";
        let source = source("a.rs", text);
        let mut faults = Vec::new();
        page(&marks(&source), &mut faults);
        assert_eq!(faults.len(), 2, "{faults:?}");
    }
}
