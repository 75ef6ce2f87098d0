//! Dependencies: none unused, none on a git revision, none from outside in the lower crates, and each one explained in
//! docs/contribute/dependencies.md.

use super::sources::{Source, product};
use super::{Package, Workspace, floors, required, short, text};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

const DOCUMENT: &str = "docs/contribute/dependencies.md";

/// Outside crates that the crates below the formats may use: embedding one of them brings in nothing else.
const OUTSIDE: &[&str] = &["rayon", "smallvec", "thiserror", "glam", "half", "libc", "crc32c"];

/// Crates by which weaver-gpu reaches a device; no crate below has them, so that only users of the GPU get them.
const DEVICE: &[&str] = &["wgpu", "pollster", "bytemuck"];

pub fn check(workspace: &Workspace, faults: &mut Vec<String>) {
    let lock = required(&workspace.root, "Cargo.lock", faults);
    for line in lock.lines().filter(|l| l.contains("\"git+")) {
        faults.push(format!("Cargo.lock: a dependency on a git revision: {line}"));
    }
    let edges = floors::declared(workspace);
    for package in &workspace.packages {
        check_unused(package, &workspace.others, faults);
        // Configurations and files are formats: a matter of the upper floors, and of crates above weaver-io.
        let upper = ["nets", "app", "methods"].contains(&floors::of(package));
        let formats = upper || package.short() == "io" || floors::below(&edges, package.short()).contains("io");
        if !package.exempt() && !formats {
            let device = |name: &str| package.name == "weaver-gpu" && DEVICE.contains(&name);
            for name in outside(package).filter(|name| !OUTSIDE.contains(name) && !device(name)) {
                let rule = format!("below the formats there are only {OUTSIDE:?}");
                faults.push(format!("{} may not depend on {name}: {rule}", package.name));
            }
        }
    }
    let users = users(&workspace.packages);
    check_explained(&users, &required(&workspace.root, DOCUMENT, faults), faults);
}

fn dependencies(package: &Package) -> impl Iterator<Item = &Value> {
    package.metadata["dependencies"].as_array().into_iter().flatten()
}

/// Crates from outside that come with a crate without any feature.
fn outside(package: &Package) -> impl Iterator<Item = &str> {
    let normal = dependencies(package).filter(|d| d["kind"].is_null() && d["optional"] != true);
    normal.map(|d| text(d, "name")).filter(|name| !name.starts_with("weaver-"))
}

fn check_unused(package: &Package, others: &[Source], faults: &mut Vec<String>) {
    // Documents whose examples are compiled as tests of this package.
    let included = |document: &&Source| package.sources.iter().any(|s| s.text.contains(&document.place));
    let documents: Vec<&Source> = others.iter().filter(|o| o.place.starts_with("docs/")).filter(included).collect();
    for dependency in dependencies(package) {
        let name = dependency["rename"].as_str().unwrap_or_else(|| text(dependency, "name")).replace('-', "_");
        // A binary that tests start is found through the environment.
        let started = dependency["kind"] == "dev" && name == "weaver_cli";
        let used = if dependency["kind"].is_null() {
            package.sources.iter().any(|source| uses(&code(product(&source.text)), &name))
        } else {
            let here = |source: &Source| uses(&source.text, &name);
            let own =
                package.tests.iter().chain(&package.borrowed).chain(&package.sources).chain(documents.iter().copied());
            own.into_iter().any(here) || uses(&package.readme, &name)
        };
        if !used && !started {
            let kind = if dependency["kind"] == "dev" { "a dev-dependency" } else { "a dependency" };
            faults.push(format!("{}: {} is {kind} that nothing uses", package.name, text(dependency, "name")));
        }
    }
}

/// A source without its comments.
fn code(source: &str) -> String {
    source.lines().filter(|line| !line.trim_start().starts_with("//")).flat_map(|line| [line, "\n"]).collect()
}

/// True if a source names a crate: in a path or alone in a `use`.
fn uses(source: &str, name: &str) -> bool {
    source.match_indices(name).any(|(at, _)| {
        let before = source[..at].chars().next_back();
        let after = &source[at + name.len()..];
        let begins =
            before.is_none_or(|c| !c.is_alphanumeric() && c != '_' && c != ':') || source[..at].ends_with(" ::");
        let imported = source[..at].ends_with("use ") && after.starts_with([';', ' ']);
        begins && (after.starts_with("::") || imported)
    })
}

/// The crates that use each dependency from outside, by short names.
fn users(packages: &[Package]) -> BTreeMap<&str, BTreeSet<&str>> {
    let mut users: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for package in packages {
        for name in outside(package) {
            users.entry(name).or_default().insert(short(&package.name));
        }
        for dependency in dependencies(package).filter(|d| d["kind"] == "dev") {
            let name = text(dependency, "name");
            if !name.starts_with("weaver-") {
                users.entry(name).or_default();
            }
        }
    }
    users
}

/// Every dependency has a row in the table, which names the crates that use it, or says `most`.
fn check_explained(users: &BTreeMap<&str, BTreeSet<&str>>, document: &str, faults: &mut Vec<String>) {
    let mut rows: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for row in document.lines().filter(|line| line.starts_with("| ")) {
        let mut cells = row.trim_matches('|').split('|').map(str::trim);
        let (names, used) = (cells.next().unwrap_or_default(), cells.next().unwrap_or_default());
        // "image (png, jpeg)" and "libc (Linux)" say more than the name.
        let names = names.split('(').next().unwrap_or_default();
        for name in names.split(',').map(str::trim) {
            rows.insert(name, used.split(',').map(str::trim).collect());
        }
    }
    for (name, users) in users {
        let Some(row) = rows.get(name) else {
            faults.push(format!("{DOCUMENT}: no row for {name}"));
            continue;
        };
        if row.contains(&"most") {
            continue;
        }
        for user in users.iter().filter(|user| !row.contains(user)) {
            faults.push(format!("{DOCUMENT}: {name} is used by {user}, too"));
        }
        let real = |user: &&&str| users.contains(*user) || ["tests", "benches"].contains(*user);
        for user in row.iter().filter(|user| !real(user)) {
            faults.push(format!("{DOCUMENT}: {name} is not used by {user}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn package(dependencies: Value, source: &str, test: &str) -> Package {
        let file = |text: &str| Source { place: "x.rs".into(), inside: "x.rs".into(), text: text.into() };
        Package {
            name: "weaver-splat".into(),
            metadata: json!({"dependencies": dependencies}),
            sources: vec![file(source)],
            tests: vec![file(test)],
            borrowed: Vec::new(),
            readme: String::new(),
        }
    }

    #[test]
    fn an_unused_dependency_is_found() {
        let dependencies = json!([
            {"name": "weaver-nn", "kind": null}, {"name": "half", "kind": null}, {"name": "proptest", "kind": "dev"},
        ]);
        let faults = |source: &str, test: &str| {
            let mut faults = Vec::new();
            check_unused(&package(dependencies.clone(), source, test), &[], &mut faults);
            faults
        };
        assert_eq!(faults("use weaver_nn::Linear;\nfn f(x: half::f16) {}", "use proptest::prelude::*;"), [""; 0]);
        let unused =
            faults("// weaver_nn::Linear\nuse half;\n#[cfg(test)] use weaver_nn::Linear;", "let proptest = 1;");
        assert_eq!(
            unused,
            [
                "weaver-splat: weaver-nn is a dependency that nothing uses",
                "weaver-splat: proptest is a dev-dependency that nothing uses"
            ]
        );
    }

    #[test]
    fn the_table_names_every_dependency_and_who_uses_it() {
        let packages = [package(json!([{"name": "half", "kind": null}, {"name": "proptest", "kind": "dev"}]), "", "")];
        let faults = |document: &str| {
            let mut faults = Vec::new();
            check_explained(&users(&packages), document, &mut faults);
            faults
        };
        assert_eq!(faults("| half (f16) | splat | why |\n| proptest, criterion | tests | why |"), [""; 0]);
        assert_eq!(faults("| half | io | why |").len(), 3);
    }
}
