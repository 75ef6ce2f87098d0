//! Dependencies and public interfaces, checked by programs of their own where these are installed.

use crate::{cargo, cargo_home, tidy};
use std::process::{Command, Stdio};

/// Crates whose interface keeps to Cargo's rules of compatible versions (docs/reference/stability.md).
const PROMISED: &[&str] = &["weaver-geometry", "weaver-scene", "weaver-splat", "weaver-codec"];

/// Checks licenses, sources and known weaknesses of all dependencies, and the promised interfaces against the release
/// before.
pub fn run() -> Result<(), String> {
    dependencies()?;
    interfaces()
}

fn dependencies() -> Result<(), String> {
    if !installed("deny") {
        println!("skipped: no cargo-deny (licenses and weaknesses of dependencies)");
        return Ok(());
    }
    let deny = ["deny", "--config", ".ci/deny.toml", "--workspace", "--all-features", "--offline", "check"];
    if cargo_home().is_some_and(|home| home.join("advisory-dbs").is_dir()) {
        return cargo(&deny, &[]);
    }
    println!("skipped: no stored advisories (cargo deny fetch)");
    cargo(&[&deny[..], &["bans", "licenses", "sources"]].concat(), &[])
}

fn interfaces() -> Result<(), String> {
    if !installed("semver-checks") {
        println!("skipped: no cargo-semver-checks (public interfaces against the release before)");
        return Ok(());
    }
    let Some(release) = release_before()? else {
        println!("skipped: no release before (public interfaces)");
        return Ok(());
    };
    for package in PROMISED {
        let manifest = format!("name = \"{package}\"");
        if git(&["grep", "--quiet", &manifest, &release, "--", "*Cargo.toml"]).is_ok() {
            cargo(&["semver-checks", "--package", package, "--baseline-rev", &release], &[])?;
        }
    }
    Ok(())
}

/// The commit by which the changelog got the newest version before this one; none in sources without their history.
fn release_before() -> Result<Option<String>, String> {
    let path = tidy::root()?.join("docs/changelog.md");
    let changelog = std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    let Some(heading) = heading_before(&changelog, &tidy::version()?) else { return Ok(None) };
    let commits = git(&["log", "--format=%H", "-S", heading, "--", "docs/changelog.md"]).unwrap_or_default();
    Ok(commits.lines().last().map(Into::into))
}

/// The heading of the newest version that was released, which is another than the version of the sources or has
/// unreleased changes above it.
fn heading_before<'a>(changelog: &'a str, version: &str) -> Option<&'a str> {
    let mut headings = changelog.lines().filter(|line| line.starts_with("## "));
    let first = headings.next()?;
    let unreleased = first == "## Unreleased" || first == format!("## {version}");
    if unreleased { headings.next() } else { Some(first) }
}

fn installed(command: &str) -> bool {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args([command, "--version"]).stdout(Stdio::null()).stderr(Stdio::null());
    cargo.status().is_ok_and(|status| status.success())
}

fn git(arguments: &[&str]) -> Result<String, String> {
    let done = Command::new("git").current_dir(tidy::root()?).args(arguments).output();
    let done = done.map_err(|error| format!("git could not be started: {error}"))?;
    if done.status.success() { Ok(String::from_utf8_lossy(&done.stdout).into_owned()) } else { Err(String::new()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_release_before_is_found_in_the_changelog() {
        let changelog = |first: &str| format!("# Changelog\n\n## {first}\n\n- New.\n\n## 0.3.0\n\n## 0.2.0\n");
        assert_eq!(heading_before(&changelog("Unreleased"), "0.3.0"), Some("## 0.3.0"));
        assert_eq!(heading_before(&changelog("1.0.0"), "1.0.0"), Some("## 0.3.0"));
        assert_eq!(heading_before(&changelog("1.0.0"), "1.1.0"), Some("## 1.0.0"));
        assert_eq!(heading_before("## 1.0.0\n", "1.0.0"), None);
    }
}
