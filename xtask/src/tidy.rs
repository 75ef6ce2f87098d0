//! The invariants that no compiler checks: who may know whom, who may open files or print, where `unsafe` may stand.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The crates a crate may depend on, as drawn in docs/architecture.md (everything below it).
const EDGES: &[(&str, &[&str])] = &[
    ("weaver-kernels", &[]),
    ("weaver-geometry", &[]),
    ("weaver-autograd", &["weaver-kernels"]),
    ("weaver-scene", &["weaver-geometry"]),
    ("weaver-io", &["weaver-scene", "weaver-geometry"]),
    ("weaver-nn", &["weaver-autograd", "weaver-kernels"]),
    ("weaver-splat", &["weaver-scene", "weaver-pose", "weaver-autograd", "weaver-kernels", "weaver-geometry"]),
    ("weaver-wavelet", &["weaver-autograd", "weaver-kernels"]),
    ("weaver-router", &["weaver-nn", "weaver-autograd", "weaver-kernels"]),
    ("weaver-experts", &["weaver-router", "weaver-splat", "weaver-nn", "weaver-autograd", "weaver-kernels"]),
    ("weaver-vggt", &["weaver-pose", "weaver-nn", "weaver-autograd", "weaver-kernels"]),
    ("weaver-pose", &["weaver-autograd", "weaver-kernels", "weaver-geometry"]),
    ("weaver-losses", &["weaver-nn", "weaver-autograd", "weaver-kernels", "weaver-geometry"]),
    ("weaver-data", &["weaver-io", "weaver-scene", "weaver-geometry", "weaver-kernels"]),
    (
        "weaver-model",
        &[
            "weaver-experts",
            "weaver-router",
            "weaver-pose",
            "weaver-vggt",
            "weaver-wavelet",
            "weaver-splat",
            "weaver-nn",
            "weaver-autograd",
            "weaver-kernels",
            "weaver-geometry",
        ],
    ),
    ("weaver-trainer", &["*"]),
    ("weaver-cli", &["*"]),
];

/// Packages that are no part of the product: they may use anything.
const EXEMPT: &[&str] = &["xtask", "weaver-parity", "weaver-tests"];

/// What the crates below the formats may use from outside: embedding one of them brings in nothing else.
const OUTSIDE: &[&str] = &["rayon", "smallvec", "thiserror", "glam", "half", "libc"];

/// The crates above that line: formats, configuration and what is made of them.
const ABOVE: &[&str] = &["weaver-io", "weaver-data", "weaver-model", "weaver-trainer", "weaver-cli"];

/// Longest source file.
const LONGEST: usize = 500;

pub fn run() -> Result<(), String> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps"])
        .output()
        .map_err(|e| format!("cargo metadata could not be started: {e}"))?;
    if !output.status.success() {
        return Err(format!("cargo metadata failed: {}", String::from_utf8_lossy(&output.stderr)));
    }
    let metadata: Value = serde_json::from_slice(&output.stdout).map_err(|e| format!("cargo metadata: {e}"))?;
    let mut faults = Vec::new();
    let packages = metadata["packages"].as_array().ok_or("cargo metadata lists no packages")?;
    for package in packages {
        check_edges(package, text(package, "name"), &mut faults);
        check_package(package, text(package, "name"), &mut faults);
    }
    let root = PathBuf::from(text(&metadata, "workspace_root"));
    let lock = std::fs::read_to_string(root.join("Cargo.lock")).map_err(|e| format!("Cargo.lock: {e}"))?;
    for line in lock.lines().filter(|l| l.contains("\"git+")) {
        faults.push(format!("Cargo.lock: a dependency on a git revision: {line}"));
    }
    for package in packages {
        let manifest = PathBuf::from(text(package, "manifest_path"));
        let folder = manifest.parent().ok_or("a manifest lies in a folder")?;
        check_sources(&root, &folder.join("src"), text(package, "name"), &mut faults)?;
    }
    if faults.is_empty() { Ok(()) } else { Err(format!("tidy:\n  {}", faults.join("\n  "))) }
}

fn text<'a>(value: &'a Value, key: &str) -> &'a str {
    value[key].as_str().unwrap_or_default()
}

fn check_edges(package: &Value, name: &str, faults: &mut Vec<String>) {
    if EXEMPT.contains(&name) {
        return;
    }
    let Some((_, allowed)) = EDGES.iter().find(|(n, _)| *n == name) else {
        faults.push(format!("{name}: not in the drawing of docs/architecture.md"));
        return;
    };
    for dependency in package["dependencies"].as_array().into_iter().flatten() {
        let to = text(dependency, "name");
        let normal = dependency["kind"].is_null();
        if normal && to.starts_with("weaver-") && !allowed.contains(&to) && !allowed.contains(&"*") {
            faults.push(format!("{name} may not depend on {to}"));
        }
        if normal && !to.starts_with("weaver-") && !ABOVE.contains(&name) && !OUTSIDE.contains(&to) {
            faults.push(format!("{name} may not depend on {to}: below the formats there are only {OUTSIDE:?}"));
        }
    }
}

/// A crate can be published: it says what it is, has a README, and a library has an example.
fn check_package(package: &Value, name: &str, faults: &mut Vec<String>) {
    if EXEMPT.contains(&name) {
        return;
    }
    for key in ["description", "documentation", "license", "readme"] {
        if text(package, key).is_empty() {
            faults.push(format!("{name}: no {key} in Cargo.toml"));
        }
    }
    for key in ["keywords", "categories"] {
        if package[key].as_array().is_none_or(Vec::is_empty) {
            faults.push(format!("{name}: no {key} in Cargo.toml"));
        }
    }
    let targets = || package["targets"].as_array().into_iter().flatten();
    let any = |kind: &str| targets().any(|t| t["kind"].as_array().is_some_and(|k| k.iter().any(|k| k == kind)));
    if any("lib") && !any("bin") && !any("example") {
        faults.push(format!("{name}: a library without an example"));
    }
}

/// A rule on source text: a pattern, the crates that are free to use it, and what it is.
struct Rule {
    patterns: &'static [&'static str],
    free: &'static [&'static str],
    what: &'static str,
    /// Single files that are free as well.
    except: &'static [&'static str],
}

/// Where files are mapped into memory, which no safe function of the standard library does.
const MAPPED_FILE: &str = "crates/weaver-io/src/mapped_file.rs";

const RULES: &[Rule] = &[
    Rule {
        patterns: &["unsafe ", "unsafe{"],
        free: &["weaver-kernels", "xtask"],
        what: "unsafe code",
        except: &[MAPPED_FILE],
    },
    Rule {
        patterns: &["println!", "eprintln!", "print!(", "eprint!(", "dbg!("],
        free: &["weaver-cli", "xtask", "weaver-parity"],
        what: "printing",
        except: &[],
    },
    Rule {
        patterns: &["std::fs", "File::open", "File::create", "fs::read", "fs::write"],
        free: &["weaver-io", "weaver-cli", "xtask", "weaver-parity", "weaver-tests"],
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

fn check_sources(root: &Path, folder: &Path, package: &str, faults: &mut Vec<String>) -> Result<(), String> {
    let entries = std::fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut paths: Vec<PathBuf> = entries.filter_map(|e| e.ok().map(|e| e.path())).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            check_sources(root, &path, package, faults)?;
        } else if path.extension().is_some_and(|e| e == "rs") {
            let source = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
            let place = path.strip_prefix(root).unwrap_or(&path).display().to_string();
            check_file(&place, &source, package, faults);
        }
    }
    Ok(())
}

fn check_file(place: &str, source: &str, package: &str, faults: &mut Vec<String>) {
    let stem = place.rsplit('/').next().unwrap_or(place).trim_end_matches(".rs");
    if ["util", "utils", "helper", "helpers", "common", "misc"].contains(&stem) {
        faults.push(format!("{place}: a module is named after the thing it holds"));
    }
    let lines = source.lines().count();
    if lines > LONGEST {
        faults.push(format!("{place}: {lines} lines, more than {LONGEST}"));
    }
    // Unit tests may do what the product may not.
    let product = source.split("#[cfg(test)]").next().unwrap_or(source);
    for (number, line) in product.lines().enumerate() {
        let code = line.trim_start();
        if code.starts_with("//") {
            continue;
        }
        for rule in RULES.iter().filter(|r| !r.free.contains(&package) && !r.except.contains(&place)) {
            if rule.patterns.iter().any(|p| code.contains(p)) {
                faults.push(format!("{place}:{}: {} does not belong into {package}", number + 1, rule.what));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_found() {
        let mut faults = Vec::new();
        check_file(
            "crates/weaver-nn/src/utils.rs",
            "fn f() { println!(\"x\"); }\n// println! in a comment\n",
            "weaver-nn",
            &mut faults,
        );
        assert_eq!(faults.len(), 2, "{faults:?}");
        // Free in one file of the crate, not in the others.
        check_file(MAPPED_FILE, "unsafe { f() }", "weaver-io", &mut faults);
        assert_eq!(faults.len(), 2, "{faults:?}");
        check_file("crates/weaver-io/src/info.rs", "unsafe { f() }", "weaver-io", &mut faults);
        assert_eq!(
            faults.pop().as_deref(),
            Some("crates/weaver-io/src/info.rs:1: unsafe code does not belong into weaver-io")
        );
        let package = serde_json::json!({"dependencies": [{"name": "weaver-nn", "kind": null}]});
        check_edges(&package, "weaver-kernels", &mut faults);
        assert_eq!(faults.len(), 3, "{faults:?}");
        let package = serde_json::json!({"dependencies": [{"name": "image", "kind": null}]});
        check_edges(&package, "weaver-splat", &mut faults);
        assert_eq!(faults.len(), 4, "{faults:?}");
        let package = serde_json::json!({
            "description": "x", "documentation": "x", "license": "x", "readme": "x", "keywords": ["x"], "categories": [],
            "targets": [{"kind": ["lib"]}],
        });
        check_package(&package, "weaver-splat", &mut faults);
        assert_eq!(faults.len(), 6, "{faults:?}");
    }
}
