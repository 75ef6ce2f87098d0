//! Syntax of the scripts of pages, by node where there is one.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Checks the modules in the folders `web` of all crates.
pub fn check(root: &Path) -> Result<(), String> {
    if Command::new("node").arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_err() {
        println!("skipped: no node (scripts of pages)");
        return Ok(());
    }
    for path in scripts(root)? {
        let file = File::open(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        let checked = Command::new("node").args(["--input-type=module", "--check", "-"]).stdin(file).output();
        let checked = checked.map_err(|error| format!("node: {error}"))?;
        if !checked.status.success() {
            return Err(format!("{}: {}", path.display(), String::from_utf8_lossy(&checked.stderr).trim()));
        }
    }
    Ok(())
}

fn scripts(root: &Path) -> Result<Vec<PathBuf>, String> {
    let entries = |folder: &Path| -> Result<Vec<PathBuf>, String> {
        let entries = std::fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        Ok(entries.filter_map(|entry| entry.ok().map(|entry| entry.path())).collect())
    };
    let mut found = Vec::new();
    for floor in entries(&root.join("crates"))? {
        for package in entries(&floor)? {
            let folder = package.join("web");
            if folder.is_dir() {
                found.extend(entries(&folder)?.into_iter().filter(|path| path.extension().is_some_and(|e| e == "js")));
            }
        }
    }
    found.sort();
    Ok(found)
}
