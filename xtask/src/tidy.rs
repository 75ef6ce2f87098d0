//! The invariants that no compiler checks: dependencies between crates, the crates that may open files or print, the
//! places of `unsafe`, spelling and sentences, and the truth of documents.

mod circles;
mod dependencies;
mod documents;
mod english;
mod floors;
mod packages;
mod promises;
mod sources;
mod spelling;
mod wall;

pub use documents::{plain, slug};

use serde_json::Value;
use sources::Source;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Packages that are no part of the product: they may use anything.
const EXEMPT: &[&str] = &["xtask", "weaver-parity", "weaver-studies", "weaver-tests", "weaver-fixtures"];

/// All that is checked, read once.
#[derive(Default)]
struct Workspace {
    root: PathBuf,
    packages: Vec<Package>,
    /// Documents, manifests and sources outside of any package's `src`.
    others: Vec<Source>,
}

struct Package {
    name: String,
    /// Its entry in `cargo metadata`.
    metadata: Value,
    /// The files below `src`.
    sources: Vec<Source>,
    /// The files below `tests`, `benches` and `examples`.
    tests: Vec<Source>,
    /// Files from elsewhere that the package's sources include by `#[path]`.
    borrowed: Vec<Source>,
    readme: String,
}

impl Package {
    fn exempt(&self) -> bool {
        EXEMPT.contains(&self.name.as_str())
    }

    /// The name without the common prefix, as documents use it.
    fn short(&self) -> &str {
        short(&self.name)
    }
}

fn short(name: &str) -> &str {
    name.strip_prefix("weaver-").unwrap_or(name)
}

pub fn run() -> Result<(), String> {
    let workspace = read()?;
    let mut faults = Vec::new();
    floors::check(&workspace, &mut faults);
    wall::check(&workspace, &mut faults);
    dependencies::check(&workspace, &mut faults);
    for package in &workspace.packages {
        packages::check(package, &mut faults);
        for source in &package.sources {
            sources::check(source, &package.name, &mut faults);
        }
        for source in package.sources.iter().chain(&package.tests).filter(|_| package.name != "xtask") {
            sources::check_test(source, &mut faults);
        }
        for source in package.sources.iter().chain(&package.tests) {
            sources::check_comments(source, &mut faults);
        }
    }
    circles::check(&workspace, &mut faults);
    promises::check(&workspace, &mut faults);
    documents::check(&workspace, &mut faults);
    let inside = workspace.packages.iter().flat_map(|package| package.sources.iter().chain(&package.tests));
    let all = inside.chain(&workspace.others);
    for source in all.clone() {
        spelling::check(source, &mut faults);
    }
    english::check(all, &mut faults);
    if faults.is_empty() { Ok(()) } else { Err(format!("tidy:\n  {}", faults.join("\n  "))) }
}

/// The folders of the workspace's packages, by their names.
pub fn folders() -> Result<BTreeMap<String, PathBuf>, String> {
    let metadata = metadata()?;
    let packages = metadata["packages"].as_array().ok_or("cargo metadata lists no packages")?;
    let folder = |package: &Value| {
        let manifest = PathBuf::from(text(package, "manifest_path"));
        Some((text(package, "name").to_string(), manifest.parent()?.to_path_buf()))
    };
    Ok(packages.iter().filter_map(folder).collect())
}

/// The folder of the workspace.
pub fn root() -> Result<PathBuf, String> {
    Ok(PathBuf::from(text(&metadata()?, "workspace_root")))
}

/// The version of all packages.
pub fn version() -> Result<String, String> {
    Ok(text(&metadata()?["packages"][0], "version").into())
}

fn metadata() -> Result<Value, String> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps"])
        .output()
        .map_err(|e| format!("cargo metadata could not be started: {e}"))?;
    if !output.status.success() {
        return Err(format!("cargo metadata failed: {}", String::from_utf8_lossy(&output.stderr)));
    }
    serde_json::from_slice(&output.stdout).map_err(|e| format!("cargo metadata: {e}"))
}

fn read() -> Result<Workspace, String> {
    let metadata = metadata()?;
    let root = PathBuf::from(text(&metadata, "workspace_root"));
    let mut workspace = Workspace { root: root.clone(), ..Workspace::default() };
    for package in metadata["packages"].as_array().ok_or("cargo metadata lists no packages")? {
        let manifest = PathBuf::from(text(package, "manifest_path"));
        let folder = manifest.parent().ok_or("a manifest lies in a folder")?;
        let mut tests = Vec::new();
        for part in ["tests", "it", "benches", "examples"] {
            tests.extend(sources::below(&root, &folder.join(part))?);
        }
        let borrowed = sources::borrowed(&root, &tests)?;
        workspace.packages.push(Package {
            borrowed,
            name: text(package, "name").into(),
            sources: sources::below(&root, &folder.join("src"))?,
            tests,
            readme: std::fs::read_to_string(folder.join("README.md")).unwrap_or_default(),
            metadata: package.clone(),
        });
        workspace.others.extend(sources::directly_in(&root, folder)?);
    }
    workspace.others.extend(sources::directly_in(&root, &root)?);
    workspace.others.extend(sources::directly_in(&root, &root.join("methods"))?);
    for folder in [".github", "docs", "shaders", "tests/fixtures", "tests/embedding"] {
        workspace.others.extend(sources::below(&root, &root.join(folder))?);
    }
    Ok(workspace)
}

fn text<'a>(value: &'a Value, key: &str) -> &'a str {
    value[key].as_str().unwrap_or_default()
}

/// The text of a file of the repository, with a fault where it is missing.
fn required(root: &Path, place: &str, faults: &mut Vec<String>) -> String {
    std::fs::read_to_string(root.join(place)).unwrap_or_else(|e| {
        faults.push(format!("{place}: {e}"));
        String::new()
    })
}
