//! The packages that a program links, by `cargo tree` and `cargo metadata`.

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::process::Command;

/// A package that is linked.
#[derive(Debug, Default)]
pub struct Package {
    pub name: String,
    pub version: String,
    pub description: String,
    /// The license as an expression, as the package has it.
    pub license: String,
    pub repository: String,
    /// Folder of its sources.
    pub folder: PathBuf,
    /// SHA-256 of the package in the registry; empty for this workspace's.
    pub checksum: String,
    /// Names and versions of packages that it links itself.
    pub uses: BTreeSet<Key>,
}

/// Name and version.
pub type Key = (String, String);

/// The packages that `roots` link on a target, with their features as they are built; macros and build scripts run at
/// compile time and are left out.
pub fn linked(roots: &[&str], target: &str) -> Result<BTreeMap<Key, Package>, String> {
    let mut tree = vec!["tree", "--locked", "--edges", "normal,no-proc-macro", "--target", target];
    tree.extend(["--prefix", "depth", "--format", "|{p}"]);
    roots.iter().for_each(|root| tree.extend(["--package", root]));
    let edges = edges(&cargo(&tree)?)?;
    let metadata = cargo(&["metadata", "--locked", "--format-version", "1"])?;
    let metadata: Value = serde_json::from_str(&metadata).map_err(|error| format!("cargo metadata: {error}"))?;
    let lock =
        std::fs::read_to_string(crate::tidy::root()?.join("Cargo.lock")).map_err(|e| format!("Cargo.lock: {e}"))?;
    let checksums = checksums(&lock);
    let mut packages = BTreeMap::new();
    for package in metadata["packages"].as_array().ok_or("cargo metadata lists no packages")? {
        let text = |name: &str| package[name].as_str().unwrap_or_default().to_string();
        let key = (text("name"), text("version"));
        let Some(uses) = edges.get(&key).cloned() else { continue };
        let checksum = checksums.get(&key).cloned().unwrap_or_default();
        let folder = PathBuf::from(text("manifest_path")).parent().ok_or("a manifest lies in a folder")?.to_path_buf();
        let (name, version) = key.clone();
        let [description, license, repository] = ["description", "license", "repository"].map(text);
        packages.insert(key, Package { name, version, description, license, repository, folder, checksum, uses });
    }
    match edges.keys().find(|key| !packages.contains_key(*key)) {
        Some((name, version)) => Err(format!("cargo metadata: expected {name} {version}, which cargo tree names")),
        None => Ok(packages),
    }
}

/// Uses by package, from lines of a depth and a name: `1|rayon v1.2.3`.
fn edges(tree: &str) -> Result<BTreeMap<Key, BTreeSet<Key>>, String> {
    let mut edges = BTreeMap::<Key, BTreeSet<Key>>::new();
    let mut above: Vec<Key> = Vec::new();
    for line in tree.lines().filter(|line| !line.is_empty()) {
        let unknown = || format!("cargo tree: expected a depth, a name and a version, found {line}");
        let (depth, package) = line.split_once('|').ok_or_else(unknown)?;
        let depth: usize = depth.parse().map_err(|_| unknown())?;
        let mut words = package.split_whitespace();
        let (name, version) = words.next().zip(words.next()).ok_or_else(unknown)?;
        let key = (name.to_string(), version.trim_start_matches('v').to_string());
        above.truncate(depth);
        if let Some(user) = above.last() {
            edges.entry(user.clone()).or_default().insert(key.clone());
        }
        edges.entry(key.clone()).or_default();
        above.push(key);
    }
    Ok(edges)
}

/// Checksums of packages in `Cargo.lock`.
fn checksums(lock: &str) -> BTreeMap<Key, String> {
    let blocks = lock.split("[[package]]").skip(1);
    let checksum = |block: &str| {
        let value = |key: &str| {
            let line = block.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(" = "))?;
            Some(line.trim_matches('"').to_string())
        };
        Some(((value("name")?, value("version")?), value("checksum")?))
    };
    blocks.filter_map(checksum).collect()
}

fn cargo(arguments: &[&str]) -> Result<String, String> {
    let output = Command::new(env!("CARGO")).args(arguments).output();
    let output = output.map_err(|error| format!("cargo could not be started: {error}"))?;
    if !output.status.success() {
        return Err(format!("cargo {}: {}", arguments.join(" "), String::from_utf8_lossy(&output.stderr)));
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tree_becomes_edges() {
        let tree = "0|weaver-cli v0.3.0 (/w/crates/app/cli)\n1|rayon v1.12.0\n2|either v1.19.0\n1|either v1.19.0 (*)\n";
        let key = |name: &str, version: &str| (name.to_string(), version.to_string());
        let edges = edges(tree).unwrap();
        let (rayon, either) = (key("rayon", "1.12.0"), key("either", "1.19.0"));
        assert_eq!(edges[&key("weaver-cli", "0.3.0")], [rayon.clone(), either.clone()].into());
        assert_eq!(edges[&rayon], [either.clone()].into());
        assert!(edges[&either].is_empty() && edges.len() == 3);
        assert!(super::edges("rayon").is_err());
    }

    #[test]
    fn checksums_are_found() {
        let lock = "version = 4\n\n[[package]]\nname = \"a\"\nversion = \"1.0.0\"\nchecksum = \"12ab\"\n\n[[package]]\nname = \"b\"\nversion = \"2.0.0\"\n";
        assert_eq!(checksums(lock), [(("a".into(), "1.0.0".into()), "12ab".to_string())].into());
    }
}
