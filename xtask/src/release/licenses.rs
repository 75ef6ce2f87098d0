//! The licenses of what a release links: checked against those that it may have, and their texts in one file.

use super::packages::{Key, Package};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// Licenses that linked packages may have: each asks for its text beside the program at most.
const ALLOWED: &[&str] = &[
    "0BSD",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "ISC",
    "MIT",
    "Unicode-3.0",
    "Unlicense",
    "Zlib",
];

/// Beginnings of names of files with licenses, in small letters, in both spellings.
const FILES: &[&str] = &["licen", "copying", "copyright", "notice", "unlicen"];

/// The texts of the licenses of all packages, each text once, after the packages that have it. `ours` is the text of
/// Apache-2.0, for packages of that license without a file of their own.
///
/// # Errors
/// Packages whose license is not allowed. Where a package comes without a text, its line says so.
pub fn texts(packages: &BTreeMap<Key, Package>, ours: &str) -> Result<String, String> {
    let mut faults = Vec::new();
    let mut by_text = BTreeMap::<String, BTreeSet<String>>::new();
    for package in packages.values().filter(|package| !package.checksum.is_empty()) {
        let name = format!("{} {} ({})", package.name, package.version, package.license);
        match is_allowed(&package.license, ALLOWED) {
            Ok(true) => {}
            Ok(false) => faults.push(format!("{name}: expected one of {ALLOWED:?}")),
            Err(error) => faults.push(format!("{name}: {error}")),
        }
        let mut found = files_of(package)?;
        if found.is_empty() && is_allowed(&package.license, &["Apache-2.0"]) == Ok(true) {
            found.push(ours.into());
        }
        if found.is_empty() {
            // The license is named in its manifest, and the registry has it there.
            found.push(format!("No file of a license comes with the package; its manifest names {}.", package.license));
        }
        for text in found {
            by_text.entry(text).or_default().insert(name.clone());
        }
    }
    if !faults.is_empty() {
        return Err(format!("licenses:\n  {}", faults.join("\n  ")));
    }
    let mut page = String::from("Licenses of the packages that this program links. Its own is in LICENSE.\n");
    // In the order of the packages, not of the texts.
    let mut texts: Vec<_> = by_text.into_iter().map(|(text, names)| (names, text)).collect();
    texts.sort();
    for (names, text) in texts {
        let names: Vec<String> = names.into_iter().collect();
        let _ = write!(page, "\n{}\n\n{}\n\n{}\n", "=".repeat(80), names.join("\n"), text.trim_end());
    }
    Ok(page)
}

/// The texts of the licenses beside a package's manifest, with plain ends of lines.
fn files_of(package: &Package) -> Result<Vec<String>, String> {
    let mut texts = Vec::new();
    for path in super::entries(&package.folder)? {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        if !FILES.iter().any(|begin| name.starts_with(begin)) {
            continue;
        }
        let inside = if path.is_dir() { super::archive::files(&path)? } else { vec![path] };
        for path in inside {
            let text = std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
            texts.push(text.replace("\r\n", "\n"));
        }
    }
    Ok(texts)
}

/// True if an expression of licenses can be met by those in a list: by one of the parts between `OR`, by all between
/// `AND`.
fn is_allowed(expression: &str, allowed: &[&str]) -> Result<bool, String> {
    let plain = expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ");
    let words: Vec<&str> = plain.split_whitespace().collect();
    let mut rest = words.as_slice();
    let met = alternatives(&mut rest, allowed);
    met.filter(|_| rest.is_empty()).ok_or_else(|| format!("expected an expression of licenses, found `{expression}`"))
}

fn alternatives(words: &mut &[&str], allowed: &[&str]) -> Option<bool> {
    let mut met = together(words, allowed)?;
    while take(words, "OR") {
        met |= together(words, allowed)?;
    }
    Some(met)
}

fn together(words: &mut &[&str], allowed: &[&str]) -> Option<bool> {
    let mut met = one(words, allowed)?;
    while take(words, "AND") {
        met &= one(words, allowed)?;
    }
    Some(met)
}

fn one(words: &mut &[&str], allowed: &[&str]) -> Option<bool> {
    if take(words, "(") {
        let met = alternatives(words, allowed)?;
        return take(words, ")").then_some(met);
    }
    let (name, rest) = words.split_first()?;
    *words = rest;
    if take(words, "WITH") {
        let (exception, rest) = words.split_first()?;
        *words = rest;
        let name = format!("{name} WITH {exception}");
        return Some(allowed.contains(&name.as_str()));
    }
    (!["OR", "AND", "WITH", ")"].contains(name)).then(|| allowed.contains(name))
}

fn take(words: &mut &[&str], word: &str) -> bool {
    let found = words.first() == Some(&word);
    if found {
        *words = &words[1..];
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn expressions_are_met_or_not() {
        let met = |expression: &str| is_allowed(expression, ALLOWED);
        for fine in ["MIT", "GPL-3.0 OR MIT", "MIT/Apache-2.0", "(MIT OR GPL-3.0) AND Unicode-3.0"] {
            assert_eq!(met(fine), Ok(true), "{fine}");
        }
        for bad in ["GPL-3.0", "MIT AND GPL-3.0", "Apache-2.0 WITH Other-exception", "(MIT AND GPL-3.0) OR MPL-2.0"] {
            assert_eq!(met(bad), Ok(false), "{bad}");
        }
        for wrong in ["", "MIT OR", "(MIT", "MIT MIT", "OR"] {
            assert!(met(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn cargo_deny_has_the_same_list() {
        let config = include_str!("../../../.ci/deny.toml");
        let list = config.split_once("allow = [").and_then(|(_, rest)| rest.split_once(']')).unwrap().0;
        let named: Vec<&str> = list.split(',').map(|name| name.trim().trim_matches('"')).collect();
        assert_eq!(named.iter().filter(|name| !name.is_empty()).copied().collect::<Vec<_>>(), ALLOWED);
    }

    #[test]
    fn a_license_that_is_not_allowed_is_named() {
        let package = |license: &str| {
            let folder = std::path::PathBuf::from(env!("CARGO_MANIFEST_DIR"));
            let (checksum, license) = ("12".into(), license.into());
            let package =
                Package { name: "a".into(), version: "1.0".into(), license, folder, checksum, ..Package::default() };
            [(("a".to_string(), "1.0".to_string()), package)].into()
        };
        assert!(texts(&package("GPL-3.0"), "").unwrap_err().contains("a 1.0 (GPL-3.0)"));
        assert!(texts(&package("Apache-2.0"), "Text of it").unwrap().contains("a 1.0 (Apache-2.0)\n\nText of it"));
    }
}
