//! Documents are true: versions agree, links lead somewhere, the index names every page.

use super::sources::Source;
use super::{Workspace, required, text};
use std::path::{Component, Path, PathBuf};

/// The most lines of a page by the beginning of its path, where that is not 400.
const LONGEST_PAGES: &[(&str, usize)] = &[
    ("docs/guide/", 200),
    ("docs/results/notebook/", usize::MAX),
    ("docs/changelog.md", usize::MAX),
    // Generated.
    ("docs/reference/flags.md", usize::MAX),
];

pub fn check(workspace: &Workspace, faults: &mut Vec<String>) {
    check_versions(workspace, faults);
    for source in &workspace.others {
        if source.place.ends_with(".md") {
            check_links(workspace, source, faults);
        }
        if source.place.starts_with("docs/") && source.place.ends_with(".md") {
            check_index(workspace, &source.place, faults);
            check_length(source, faults);
        }
    }
}

/// Each page is linked from the nearest README.md above it.
fn check_index(workspace: &Workspace, page: &str, faults: &mut Vec<String>) {
    let page = Path::new(page);
    let mut indices = page.ancestors().skip(1).map(|folder| folder.join("README.md")).filter(|index| index != page);
    let Some((text, index)) = indices.find_map(|index| text_of(workspace, &index).zip(Some(index))) else {
        return;
    };
    let inside = page.strip_prefix(index.parent().unwrap_or(Path::new(""))).unwrap_or(page).display();
    if ![')', '#'].iter().any(|end| text.contains(&format!("({inside}{end}"))) {
        faults.push(format!("{}: no link to {inside}", index.display()));
    }
}

/// Limits of pages: a page can be read in one sitting, a page of the guide sooner; the notebook is for looking up.
fn check_length(source: &Source, faults: &mut Vec<String>) {
    let longest = LONGEST_PAGES.iter().find(|(folder, _)| source.place.starts_with(folder)).map_or(400, |rule| rule.1);
    let lines = source.text.lines().count();
    if lines > longest {
        faults.push(format!("{}: {lines} lines, at most {longest}", source.place));
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
    // Crates used by tests alone are not published.
    let crates = manifest.lines().filter(|line| line.starts_with("weaver-") && line.contains("path = "));
    for line in crates.filter(|line| !line.contains("\"tests/")) {
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

/// Links to files of the repository lead to files, and to headings where they name one.
fn check_links(workspace: &Workspace, source: &Source, faults: &mut Vec<String>) {
    let folder = Path::new(&source.place).parent().unwrap_or(Path::new(""));
    for link in links(&source.text).into_iter().filter(|link| !link.contains("://")) {
        let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
        let target = if path.is_empty() { source.place.clone().into() } else { plain(&folder.join(path)) };
        if !workspace.root.join(&target).exists() {
            faults.push(format!("{}: a link to {path}, which does not exist", source.place));
        } else if let Some(page) = text_of(workspace, &target).filter(|_| !anchor.is_empty())
            && !page.lines().any(|line| line.starts_with('#') && slug(line) == anchor)
        {
            faults.push(format!("{}: a link to {link}, which has no such heading", source.place));
        }
    }
}

/// The text of a document of the workspace by its path.
fn text_of<'a>(workspace: &'a Workspace, path: &Path) -> Option<&'a str> {
    let place = path.to_string_lossy();
    workspace.others.iter().find(|source| source.place == place).map(|source| source.text.as_str())
}

/// A path without `..`.
pub fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        if part == Component::ParentDir {
            plain.pop();
        } else {
            plain.push(part);
        }
    }
    plain
}

/// The anchor of a heading: lower case, hyphens for spaces, no punctuation.
pub fn slug(heading: &str) -> String {
    let text = heading.trim_start_matches('#').trim().to_lowercase();
    let kept = text.chars().filter(|letter| letter.is_alphanumeric() || " -_".contains(*letter));
    kept.map(|letter| if letter == ' ' { '-' } else { letter }).collect()
}

/// The targets of `[text](target)`, without indented code and fences.
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
    fn headings_have_anchors() {
        assert_eq!(slug("### One, two, `five` and fifteen-minutes"), "one-two-five-and-fifteen-minutes");
        assert_eq!(plain(Path::new("docs/guide/../results/a.md")), Path::new("docs/results/a.md"));
    }

    #[test]
    fn links_are_found_outside_of_code() {
        let text = "See [a](a.md#part) and ![b](images/b.png).\n\n    code[0](x)\n\n```\n[c](c.md)\n```\n";
        assert_eq!(links(text), ["a.md#part", "images/b.png"]);
    }
}
