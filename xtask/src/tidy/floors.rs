//! The floors of the workspace: a folder of `crates/` each, one above the other, and beside them `methods/`. A crate
//! may use crates of its own floor and of the floors below. A method may use any crate and other methods; no crate uses
//! a method, but for the command line's table.

use super::{Package, Workspace, required, short, text};
use std::collections::{BTreeMap, BTreeSet};

const DOCUMENT: &str = "docs/architecture.md";

/// The folders, from the lowest.
const FLOORS: &[&str] = &["engine", "scene", "photos", "fit", "nets", "app", METHODS];

/// The folder of the published methods, behind the wall.
pub const METHODS: &str = "methods";

/// The only crate that may use methods: it has the table of their commands.
const DOOR: &str = "cli";

/// Outside crates that may not come with crates above these parts.
const CLOSED: &[(&str, &[&str])] = &[("inference", &["toml", "clap", "indicatif"])];

/// Crates without the tape; feature unification by other crates does not count.
const TAPELESS: &[&str] = &[
    "kernels", "geometry", "scene", "codec", "io", "mesh", "surfel", "sfm", "data", "fit", "align", "gpu", "view",
    "lidar", "lift", "image",
];

/// Dependencies by the short names of crates.
pub type Edges = BTreeMap<String, BTreeSet<String>>;

pub fn check(workspace: &Workspace, faults: &mut Vec<String>) {
    let document = required(&workspace.root, DOCUMENT, faults);
    let edges = declared(workspace);
    let floors: BTreeMap<&str, &str> = workspace
        .packages
        .iter()
        .filter(|package| !package.exempt())
        .map(|package| (package.short(), of(package)))
        .collect();
    check_downward(&floors, &edges, faults);
    check_wall(&floors, &edges, faults);
    check_drawn(&floors, &document, faults);
    for name in TAPELESS.iter().filter(|name| brings_tape(workspace, name)) {
        faults.push(format!("weaver-{name} knows no tape, and would bring weaver-autograd"));
    }
    for name in edges.keys().filter(|name| !document.contains(&format!("| weaver-{name} |"))) {
        faults.push(format!("{DOCUMENT}: weaver-{name} has no row in the table of crates"));
    }
    for (name, closed) in CLOSED {
        let within = below(&edges, name);
        for package in &workspace.packages {
            if package.short() == *name || within.contains(package.short()) {
                let brought = outside(package).filter(|outside| closed.contains(outside));
                faults.extend(brought.map(|o| format!("{}: {o} would come with weaver-{name}", package.name)));
            }
        }
    }
}

/// The floor of a package.
pub fn of(package: &Package) -> &str {
    floor(text(&package.metadata, "manifest_path"))
}

/// The folder of `crates/` that the folder of a manifest lies in, or `methods`.
fn floor(manifest: &str) -> &str {
    let mut parents = manifest.rsplit('/').skip(2);
    parents.next().unwrap_or_default()
}

/// The dependencies of a package from outside the workspace, without dev-dependencies.
fn outside(package: &Package) -> impl Iterator<Item = &str> {
    let dependencies = package.metadata["dependencies"].as_array().into_iter().flatten();
    dependencies.filter(|d| d["kind"].is_null()).map(|d| text(d, "name")).filter(|name| !name.starts_with("weaver-"))
}

/// The edges that manifests declare, without dev-dependencies and packages outside the product.
pub fn declared(workspace: &Workspace) -> Edges {
    let product = workspace.packages.iter().filter(|package| !package.exempt());
    let edges = product.map(|package| {
        let dependencies = package.metadata["dependencies"].as_array().into_iter().flatten();
        let names = dependencies.filter(|d| d["kind"].is_null()).map(|d| text(d, "name"));
        let to = names.filter(|name| name.starts_with("weaver-")).map(|name| short(name).to_string());
        (package.short().to_string(), to.collect())
    });
    edges.collect()
}

/// Everything that can be reached from a crate.
pub fn below(edges: &Edges, name: &str) -> BTreeSet<String> {
    let mut reached = BTreeSet::new();
    let mut open = vec![name];
    while let Some(name) = open.pop() {
        for to in edges.get(name).into_iter().flatten() {
            if reached.insert(to.clone()) {
                open.push(to);
            }
        }
    }
    reached
}

/// True if a crate that is built alone, with no feature of its own, links the tape.
fn brings_tape(workspace: &Workspace, name: &str) -> bool {
    let named = |name: &str| workspace.packages.iter().find(|package| package.name == name);
    let lists = |list: &serde_json::Value| list.as_array().into_iter().flatten().any(|name| *name == "tape");
    let mut reached = BTreeSet::new();
    let mut open = vec![(format!("weaver-{name}"), false)];
    while let Some((name, with_tape)) = open.pop() {
        let Some(package) = named(&name) else { continue };
        let dependencies = package.metadata["dependencies"].as_array().into_iter().flatten();
        for to in dependencies.filter(|d| d["kind"].is_null() && (with_tape || d["optional"] != true)) {
            let name = text(to, "name");
            let by_default = to["uses_default_features"] == true
                && named(name).is_some_and(|package| lists(&package.metadata["features"]["default"]));
            let node = (name.to_string(), by_default || lists(&to["features"]));
            if reached.insert(node.clone()) {
                open.push(node);
            }
        }
    }
    reached.iter().any(|(name, _)| name == "weaver-autograd")
}

fn check_downward(floors: &BTreeMap<&str, &str>, edges: &Edges, faults: &mut Vec<String>) {
    let height = |name: &str| FLOORS.iter().position(|floor| floors.get(name) == Some(floor));
    for (name, to) in edges {
        let Some(own) = height(name) else {
            faults.push(format!("weaver-{name}: expected in a folder of crates/ out of {}", FLOORS.join(", ")));
            continue;
        };
        for to in to.iter().filter(|to| floors.get(to.as_str()) != Some(&METHODS)) {
            if height(to).is_none_or(|other| other <= own) {
                continue;
            }
            faults.push(format!("weaver-{name} ({}) may not depend on weaver-{to}, which is above it", FLOORS[own]));
        }
    }
}

/// No crate but the command line depends on a method.
fn check_wall(floors: &BTreeMap<&str, &str>, edges: &Edges, faults: &mut Vec<String>) {
    let method = |name: &str| floors.get(name) == Some(&METHODS);
    for (name, to) in edges.iter().filter(|(name, _)| !method(name) && *name != DOOR) {
        for to in to.iter().filter(|to| method(to)) {
            faults
                .push(format!("weaver-{name} may not depend on weaver-{to}: methods are known to weaver-{DOOR} alone"));
        }
    }
}

/// The drawing has a box for each floor with the names of its crates: `app["app: bench, cli"]`.
fn check_drawn(floors: &BTreeMap<&str, &str>, document: &str, faults: &mut Vec<String>) {
    for floor in FLOORS {
        let crates: Vec<&str> = floors.iter().filter(|(_, f)| *f == floor).map(|(name, _)| *name).collect();
        let drawn = format!("{floor}[\"{floor}: {}\"]", crates.join(", "));
        if !document.contains(&drawn) {
            faults.push(format!("{DOCUMENT}: expected the box {drawn} in the drawing"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edges(all: &[(&str, &[&str])]) -> Edges {
        let to = |to: &[&str]| to.iter().map(|name| name.to_string()).collect();
        all.iter().map(|(name, names)| (name.to_string(), to(names))).collect()
    }

    #[test]
    fn edges_go_down_or_stay_on_a_floor() {
        assert_eq!(floor("/x/crates/engine/nn/Cargo.toml"), "engine");
        let floors = BTreeMap::from([("nn", "engine"), ("kernels", "engine"), ("fit", "fit"), ("new", "cellar")]);
        let faults = |all: &[(&str, &[&str])]| {
            let mut faults = Vec::new();
            check_downward(&floors, &edges(all), &mut faults);
            faults
        };
        assert_eq!(faults(&[("fit", &["nn"]), ("nn", &["kernels"]), ("kernels", &[])]), [""; 0]);
        let upward = faults(&[("nn", &["fit"])]);
        assert_eq!(upward, ["weaver-nn (engine) may not depend on weaver-fit, which is above it"]);
        assert!(faults(&[("new", &[])])[0].starts_with("weaver-new: expected in a folder"));
    }

    #[test]
    fn the_drawing_names_every_crate_in_its_box() {
        let floors = BTreeMap::from([("nn", "engine"), ("kernels", "engine")]);
        let mut faults = Vec::new();
        check_drawn(&floors, "    engine[\"engine: kernels, nn\"]\n", &mut faults);
        assert_eq!(faults.len(), FLOORS.len() - 1, "{faults:?}");
        faults.clear();
        check_drawn(&floors, "    engine[\"engine: kernels\"]\n", &mut faults);
        assert!(faults[0].contains("expected the box engine[\"engine: kernels, nn\"]"), "{faults:?}");
    }

    #[test]
    fn below_is_everything_that_can_be_reached() {
        let edges = edges(&[("io", &["scene"]), ("scene", &["geometry"]), ("geometry", &[])]);
        assert_eq!(below(&edges, "io"), BTreeSet::from(["geometry".to_string(), "scene".to_string()]));
    }
}
