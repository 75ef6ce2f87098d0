//! A crate can be published: it has a description, its license is beside it, and its README begins with an example that
//! is compiled. A target that is not tested has no unit tests.

use super::sources::Source;
use super::{Package, text};
use serde_json::Value;
use std::path::Path;

pub fn check(package: &Package, faults: &mut Vec<String>) {
    check_unit_tests(package, faults);
    if package.exempt() {
        return;
    }
    let (name, metadata) = (&package.name, &package.metadata);
    for key in ["description", "documentation", "license", "readme", "rust_version"] {
        if text(metadata, key).is_empty() {
            faults.push(format!("{name}: no {key} in Cargo.toml"));
        }
    }
    for key in ["keywords", "categories"] {
        if metadata[key].as_array().is_none_or(Vec::is_empty) {
            faults.push(format!("{name}: no {key} in Cargo.toml"));
        }
    }
    check_registry(name, metadata, faults);
    // Files for `cargo package`: a link to the workspace's becomes a copy.
    if !Path::new(text(metadata, "manifest_path")).with_file_name("LICENSE").is_file() {
        faults.push(format!("{name}: no LICENSE beside Cargo.toml; expected a link to the workspace's"));
    }
    let targets = || metadata["targets"].as_array().into_iter().flatten();
    let any = |kind: &str| targets().any(|t| t["kind"].as_array().is_some_and(|k| k.iter().any(|k| k == kind)));
    // The library of a binary is not for embedding.
    if any("lib") && !any("bin") {
        if !any("example") {
            faults.push(format!("{name}: a library without an example"));
        }
        check_readme(package, faults);
    }
    // Every binary of tests links the whole crate.
    let tests = targets().filter(|t| t["kind"].as_array().is_some_and(|k| k.iter().any(|k| k == "test"))).count();
    if tests > 1 {
        faults.push(format!("{name}: {tests} binaries of integration tests; one, tests/it, compiles faster"));
    }
}

/// The rules of the registry: at most five keywords of at most twenty letters, and five categories. Crates that tests
/// need are named by their path alone, so that the registry never waits for one that comes later.
fn check_registry(name: &str, metadata: &Value, faults: &mut Vec<String>) {
    for key in ["keywords", "categories"] {
        let words: Vec<&str> = metadata[key].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        if words.len() > 5 || key == "keywords" && words.iter().any(|word| word.len() > 20) {
            faults.push(format!("{name}: {key} {words:?}; expected at most five, keywords of at most twenty letters"));
        }
    }
    let dependencies = metadata["dependencies"].as_array().into_iter().flatten();
    let own = dependencies.filter(|d| d["kind"] == "dev" && !d["path"].is_null() && text(d, "req") != "*");
    faults.extend(
        own.map(|d| format!("{name}: the dev-dependency {} has a version; expected its path alone", text(d, "name"))),
    );
}

/// Unit tests of targets that Cargo.toml leaves out with `test = false`: they would never run.
fn check_unit_tests(package: &Package, faults: &mut Vec<String>) {
    for target in package.metadata["targets"].as_array().into_iter().flatten().filter(|t| t["test"] == false) {
        let root = Path::new(text(target, "src_path"));
        // A library is all of src but the roots of binaries.
        let library = root.ends_with("src/lib.rs");
        let within = |inside: &str| {
            let of_binary = inside == "main.rs" || inside.starts_with("bin/");
            if library { !of_binary } else { root.ends_with(Path::new("src").join(inside)) }
        };
        let tested = |source: &&Source| within(&source.inside) && source.text.contains("#[cfg(test)]");
        faults.extend(package.sources.iter().filter(tested).map(|source| {
            format!("{}: unit tests in {}, which `test = false` in Cargo.toml leaves out", package.name, source.place)
        }));
    }
}

/// The README has an example in Rust, and the library's documentation tests include it.
fn check_readme(package: &Package, faults: &mut Vec<String>) {
    let name = &package.name;
    let included = package
        .sources
        .iter()
        .any(|source| source.inside == "lib.rs" && source.text.contains("include_str!(\"../README.md\")"));
    if !included {
        faults.push(format!("{name}: the README's example is not compiled: lib.rs does not include it"));
    }
    // Fences open and close in turn.
    let mut fences = package.readme.lines().filter_map(|line| line.strip_prefix("```")).step_by(2);
    let rust = |flags: &str| flags.is_empty() || flags.split(',').all(|flag| ["rust", "no_run"].contains(&flag.trim()));
    if !fences.any(rust) {
        faults.push(format!("{name}: no example in the README"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tidy::sources::Source;
    use serde_json::json;

    #[test]
    fn faults_are_found() {
        let lib = |text: &str| Source { place: "src/lib.rs".into(), inside: "lib.rs".into(), text: text.into() };
        let mut package = Package {
            name: "weaver-splat".into(),
            metadata: json!({
                "description": "x", "documentation": "x", "license": "x", "readme": "x", "rust_version": "1.95",
                "keywords": ["x"], "categories": [],
                "targets": [{"kind": ["lib"]}, {"kind": ["test"]}, {"kind": ["test"]}],
            }),
            sources: vec![lib("")],
            tests: Vec::new(),
            borrowed: Vec::new(),
            readme: "```text\nx\n```\n".into(),
        };
        let mut faults = Vec::new();
        check(&package, &mut faults);
        assert_eq!(faults.len(), 6, "{faults:?}");
        package.sources = vec![lib("#[doc = include_str!(\"../README.md\")]")];
        package.readme += "```rust\nassert!(true);\n```\n";
        check_readme(&package, &mut faults);
        assert_eq!(faults.len(), 6, "{faults:?}");
    }

    #[test]
    fn the_registry_takes_every_crate() {
        let metadata = json!({
            "keywords": ["gaussian-splatting", "a-word-of-many-letters"],
            "categories": ["science"],
            "dependencies": [
                {"name": "weaver-io", "kind": "dev", "path": "/w/io", "req": "^0.3.0"},
                {"name": "weaver-nn", "kind": "dev", "path": "/w/nn", "req": "*"},
                {"name": "weaver-scene", "kind": null, "path": "/w/scene", "req": "^0.3.0"},
                {"name": "tempfile", "kind": "dev", "req": "^3"},
            ],
        });
        let mut faults = Vec::new();
        check_registry("weaver-x", &metadata, &mut faults);
        assert_eq!(faults.len(), 2, "{faults:?}");
        assert!(faults[1].contains("weaver-io"), "{faults:?}");
    }

    #[test]
    fn no_unit_test_is_left_out() {
        let source = |inside: &str, text: &str| Source {
            place: format!("crates/x/src/{inside}"),
            inside: inside.into(),
            text: text.into(),
        };
        let faults = |lib: bool, bin: bool, sources: Vec<Source>| {
            let targets = json!([
                {"kind": ["lib"], "src_path": "/w/crates/x/src/lib.rs", "test": lib},
                {"kind": ["bin"], "src_path": "/w/crates/x/src/main.rs", "test": bin},
                {"kind": ["example"], "src_path": "/w/crates/x/examples/lib.rs", "test": false},
            ]);
            let package = Package {
                name: "weaver-x".into(),
                metadata: json!({ "targets": targets }),
                sources,
                tests: Vec::new(),
                borrowed: Vec::new(),
                readme: String::new(),
            };
            let mut faults = Vec::new();
            check_unit_tests(&package, &mut faults);
            faults
        };
        let tested = "#[cfg(test)]\nmod tests {}";
        let of = |inside: &str| vec![source("lib.rs", ""), source("main.rs", ""), source(inside, tested)];
        assert_eq!(faults(true, true, of("deep/part.rs")), Vec::<String>::new());
        assert_eq!(faults(true, false, of("deep/part.rs")), Vec::<String>::new());
        assert_eq!(
            faults(false, true, of("deep/part.rs")),
            ["weaver-x: unit tests in crates/x/src/deep/part.rs, which `test = false` in Cargo.toml leaves out"]
        );
        assert_eq!(faults(false, true, vec![source("main.rs", tested)]), Vec::<String>::new());
        assert_eq!(faults(true, false, vec![source("main.rs", tested)]).len(), 1);
    }
}
