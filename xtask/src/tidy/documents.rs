//! Documents say what is so: versions agree, links lead somewhere, the index names every page.

use super::sources::Source;
use super::{Workspace, required, text};
use std::path::Path;

/// The page of what is promised, with the tests that hold it to that.
const PROMISES: &str = "docs/tests.md";

pub fn check(workspace: &Workspace, faults: &mut Vec<String>) {
    check_versions(workspace, faults);
    check_promises(workspace, faults);
    let index = required(&workspace.root, "docs/README.md", faults);
    for source in &workspace.others {
        if let Some(page) =
            source.place.strip_prefix("docs/").filter(|page| page.ends_with(".md") && *page != "README.md")
            && !index.contains(&format!("({page})"))
        {
            faults.push(format!("docs/README.md: no link to {page}"));
        }
        if source.place.ends_with(".md") {
            check_links(&workspace.root, source, faults);
        }
    }
}

/// One version everywhere, with a section in the changelog; the toolchain is the oldest one promised.
fn check_versions(workspace: &Workspace, faults: &mut Vec<String>) {
    let changelog = required(&workspace.root, "docs/changelog.md", faults);
    let manifest = required(&workspace.root, "Cargo.toml", faults);
    let toolchain = required(&workspace.root, "rust-toolchain.toml", faults);
    let Some(first) = workspace.packages.first() else { return };
    let version = text(&first.metadata, "version");
    for package in &workspace.packages {
        let own = text(&package.metadata, "version");
        if own != version {
            faults.push(format!("{}: version {own}, the others have {version}", package.name));
        }
    }
    for line in manifest.lines().filter(|line| line.starts_with("weaver-")) {
        if !line.contains(&format!("version = \"{version}\"")) {
            faults.push(format!("Cargo.toml: expected version {version}: {line}"));
        }
    }
    if !changelog.contains(&format!("## {version}")) {
        faults.push(format!("docs/changelog.md: no section for {version}"));
    }
    let oldest = text(&first.metadata, "rust_version");
    if !toolchain.contains(&format!("channel = \"{oldest}")) {
        faults.push(format!("rust-toolchain.toml: not the oldest toolchain promised, rust-version = {oldest}"));
    }
}

/// Each promise names a test, and each test that is named exists.
fn check_promises(workspace: &Workspace, faults: &mut Vec<String>) {
    let page = required(&workspace.root, PROMISES, faults);
    let files = || workspace.packages.iter().flat_map(|package| package.sources.iter().chain(&package.tests));
    for row in rows(&page) {
        if tests(row).is_empty() {
            faults.push(format!("{PROMISES}: no test is named: {row}"));
        }
        for (place, name) in tests(row) {
            let function = format!("fn {name}(");
            if !files().any(|file| file.place == place && file.text.contains(&function)) {
                faults.push(format!("{PROMISES}: {place} has no test {name}"));
            }
        }
    }
}

/// The rows of tables without their heads.
fn rows(text: &str) -> impl Iterator<Item = &str> {
    let mut lines = text.lines().peekable();
    std::iter::from_fn(move || {
        loop {
            let line = lines.next()?;
            let head = lines.peek().is_some_and(|next| next.starts_with("|---"));
            if line.starts_with("| ") && !head {
                return Some(line);
            }
        }
    })
}

/// The tests that a row names as `path::name`, in code.
fn tests(row: &str) -> Vec<(&str, &str)> {
    row.split('`').skip(1).step_by(2).filter_map(|code| code.split_once("::")).collect()
}

/// Links to files of the repository lead to files.
fn check_links(root: &Path, source: &Source, faults: &mut Vec<String>) {
    let folder = root.join(&source.place);
    let folder = folder.parent().unwrap_or(root);
    for link in links(&source.text) {
        let path = link.split('#').next().unwrap_or_default();
        if !path.is_empty() && !path.contains("://") && !folder.join(path).exists() {
            faults.push(format!("{}: a link to {path}, which does not exist", source.place));
        }
    }
}

/// The targets of `[text](target)`, those in indented code and in fences left out.
fn links(text: &str) -> Vec<&str> {
    let mut fenced = false;
    let mut links = Vec::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        }
        if fenced || line.starts_with("    ") {
            continue;
        }
        for (at, _) in line.match_indices("](") {
            links.extend(line[at + 2..].split(')').next());
        }
    }
    links
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tests_are_found_in_the_rows_of_tables() {
        let text =
            "`a.rs::b`\n\n| promise | test |\n|---|---|\n| `--flag` does | `a.rs::b`, `c/d.rs::e` |\n| none | |\n";
        let found: Vec<_> = rows(text).map(tests).collect();
        assert_eq!(found, [vec![("a.rs", "b"), ("c/d.rs", "e")], vec![]]);
    }

    #[test]
    fn links_are_found_outside_of_code() {
        let text = "See [a](a.md#part) and ![b](images/b.png).\n\n    code[0](x)\n\n```\n[c](c.md)\n```\n";
        assert_eq!(links(text), ["a.md#part", "images/b.png"]);
    }
}
