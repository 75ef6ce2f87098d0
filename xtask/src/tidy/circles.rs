//! Import circles between the files of one crate.
//!
//! Files that import each other can only be read together. A file and the files of its own folder are one unit and may
//! import each other; a re-export (`pub use`) is an address, not a use.

use super::Workspace;
use super::sources::{Source, product};
use std::collections::{BTreeMap, BTreeSet};

/// Circles that stay: the files, and why they belong together.
const STATED: &[(&[&str], &str)] = &[
    (
        &["crates/engine/autograd/src/tape.rs", "crates/engine/autograd/src/var.rs"],
        "a variable is an index into its tape, and the tape hands out variables",
    ),
    (
        &[
            "crates/engine/kernels/src/erf.rs",
            "crates/engine/kernels/src/exp.rs",
            "crates/engine/kernels/src/gemm/matrix.rs",
            "crates/engine/kernels/src/gemm/pack.rs",
            "crates/engine/kernels/src/gemm/pairs.rs",
            "crates/engine/kernels/src/gemm/tile.rs",
            "crates/engine/kernels/src/lanes.rs",
            "crates/engine/kernels/src/real.rs",
        ],
        "`Real` names the routines of each type, which are written in terms of `Real`",
    ),
    (
        &["methods/bench/src/dump.rs", "methods/bench/src/raster.rs"],
        "the dump is the frame that the bench has drawn, written by the bench",
    ),
    (
        &["methods/bench/src/engine/rows.rs", "methods/bench/src/engine/vit.rs"],
        "the table has rows of the network, and the network is made of the blocks in the table",
    ),
    (
        &[
            "crates/app/trainer/src/config.rs",
            "crates/app/trainer/src/example.rs",
            "crates/app/trainer/src/losses.rs",
            "crates/app/trainer/src/recipe.rs",
        ],
        "the traits that a model implements name configuration, example and losses, which are read through those traits",
    ),
];

pub fn check(workspace: &Workspace, faults: &mut Vec<String>) {
    let found: Vec<Vec<String>> = workspace.packages.iter().flat_map(|package| circles(&package.sources)).collect();
    for circle in found.iter().filter(|circle| STATED.iter().all(|(files, _)| circle != files)) {
        faults.push(format!("import circle without a reason: {}", circle.join(", ")));
    }
    for (files, _) in STATED.iter().filter(|(files, _)| found.iter().all(|circle| circle != files)) {
        faults.push(format!("xtask/src/tidy/circles.rs: a reason for a circle that is gone: {}", files.join(", ")));
    }
}

/// The names from the crate's root down to a module.
type Module = Vec<String>;

/// A crate's modules and their imports.
#[derive(Default)]
struct Crate {
    places: BTreeMap<Module, String>,
    /// Names that a module imports.
    imports: BTreeMap<Module, BTreeMap<String, Module>>,
}

/// The sets of files that import each other, each in order.
fn circles(sources: &[Source]) -> Vec<Vec<String>> {
    let mut found = Crate::default();
    let mut paths: Vec<(Module, Module)> = Vec::new();
    for source in sources {
        let Some(module) = module_of(&source.inside) else { continue };
        found.places.insert(module.clone(), source.place.clone());
    }
    for source in sources {
        let Some(module) = module_of(&source.inside) else { continue };
        for (path, name, public) in uses(product(&source.text)) {
            let path = absolute(&found, &module, &path);
            let Some(path) = path else { continue };
            if !public {
                paths.push((module.clone(), path.clone()));
            }
            found.imports.entry(module.clone()).or_default().insert(name, path);
        }
        for path in inline_paths(product(&source.text)) {
            paths.extend(absolute(&found, &module, &path).map(|path| (module.clone(), path)));
        }
    }
    let mut edges: BTreeMap<&Module, BTreeSet<Module>> = BTreeMap::new();
    for (from, path) in &paths {
        let to = found.file_of(path, 0);
        if !from.starts_with(&to) && !to.starts_with(from) {
            edges.entry(from).or_default().insert(to);
        }
    }
    let reached: BTreeMap<&Module, BTreeSet<&Module>> = edges.keys().map(|from| (*from, reach(&edges, from))).collect();
    let together = |a: &Module, b: &Module| {
        reached.get(a).is_some_and(|r| r.contains(b)) && reached.get(b).is_some_and(|r| r.contains(a))
    };
    let mut circles: BTreeSet<Vec<String>> = BTreeSet::new();
    for module in found.places.keys().filter(|module| together(module, module)) {
        let members = found.places.keys().filter(|other| together(module, other));
        circles.insert(members.map(|m| found.places[m].clone()).collect());
    }
    circles.into_iter().collect()
}

fn reach<'a>(edges: &'a BTreeMap<&Module, BTreeSet<Module>>, from: &Module) -> BTreeSet<&'a Module> {
    let mut reached = BTreeSet::new();
    let mut open: Vec<&Module> = edges.get(from).into_iter().flatten().collect();
    while let Some(module) = open.pop() {
        if reached.insert(module) {
            open.extend(edges.get(module).into_iter().flatten());
        }
    }
    reached
}

impl Crate {
    /// The module whose file defines the item of a path; re-exports are followed.
    fn file_of(&self, path: &[String], depth: usize) -> Module {
        let mut module = Module::new();
        for name in path {
            let mut child = module.clone();
            child.push(name.clone());
            if self.places.contains_key(&child) {
                module = child;
                continue;
            }
            return match self.imports.get(&module).and_then(|imports| imports.get(name)) {
                // A name that stands for itself is not understood here.
                Some(path) if depth < 8 => self.file_of(path, depth + 1),
                _ => module,
            };
        }
        module
    }
}

/// The module of a file in `src`; none for other binaries of the package.
fn module_of(inside: &str) -> Option<Module> {
    if inside.starts_with("bin/") {
        return None;
    }
    let path = inside.trim_end_matches(".rs").trim_end_matches("/mod");
    Some(if matches!(path, "lib" | "main") { Module::new() } else { path.split('/').map(String::from).collect() })
}

/// A path as seen from the crate's root; none if it leads out of the crate.
fn absolute(found: &Crate, module: &[String], path: &[String]) -> Option<Module> {
    let mut start = module.to_vec();
    let mut rest = path;
    match path.first()?.as_str() {
        "crate" => {
            start.clear();
            rest = &path[1..];
        }
        "self" => rest = &path[1..],
        "super" => {
            while rest.first().is_some_and(|name| name == "super") {
                start.pop();
                rest = &rest[1..];
            }
        }
        name => {
            let mut child = start.clone();
            child.push(name.into());
            if !found.places.contains_key(&child) {
                return None;
            }
        }
    }
    start.extend(rest.iter().cloned());
    Some(start)
}

/// Every path of every `use`, the name it brings, and whether others may see it.
fn uses(source: &str) -> Vec<(Vec<String>, String, bool)> {
    let mut found = Vec::new();
    let mut lines = source.lines();
    while let Some(line) = lines.next() {
        let line = line.trim_start();
        let public = line.starts_with("pub");
        let Some(start) =
            ["use ", "pub use ", "pub(crate) use ", "pub(super) use "].iter().find(|p| line.starts_with(**p))
        else {
            continue;
        };
        let mut statement = line[start.len()..].to_string();
        while !statement.contains(';') {
            let Some(next) = lines.next() else { break };
            statement.push_str(next);
        }
        let statement = statement.split(';').next().unwrap_or_default();
        let mut paths = Vec::new();
        expand("", statement, &mut paths);
        for path in paths {
            let (path, name) = match path.split_once(" as ") {
                Some((path, name)) => (path.to_string(), name.trim().to_string()),
                None => (path.clone(), path.rsplit("::").next().unwrap_or_default().trim().to_string()),
            };
            let mut parts: Vec<String> = path.split("::").map(|part| part.trim().to_string()).collect();
            let mut name = name;
            if parts.last().is_some_and(|last| last == "self") {
                parts.pop();
                name = parts.last().cloned().unwrap_or_default();
            }
            if parts.last().is_some_and(|last| last == "*") {
                parts.pop();
            }
            found.push((parts, name, public));
        }
    }
    found
}

/// The paths that a tree of a `use` stands for.
fn expand(prefix: &str, tree: &str, paths: &mut Vec<String>) {
    let tree = tree.trim();
    let Some(open) = tree.find('{') else {
        if !tree.is_empty() {
            paths.push(format!("{prefix}{tree}"));
        }
        return;
    };
    let prefix = format!("{prefix}{}", &tree[..open]);
    let inner = tree[open + 1..].trim_end().trim_end_matches('}');
    // The last brace closed this one; earlier braces belong to the branches.
    let closing = tree.trim_end().len() - tree.trim_end().trim_end_matches('}').len();
    let inner = format!("{inner}{}", "}".repeat(closing.saturating_sub(1)));
    let (mut depth, mut start) = (0, 0);
    for (i, character) in inner.char_indices() {
        match character {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                expand(&prefix, &inner[start..i], paths);
                start = i + 1;
            }
            _ => {}
        }
    }
    expand(&prefix, &inner[start..], paths);
}

/// Paths inside the code that begin with `crate::` or `super::`.
fn inline_paths(source: &str) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for line in source.lines().map(str::trim_start).filter(|line| !line.starts_with("//")) {
        if line.starts_with("use ")
            || line.starts_with("pub use ")
            || line.starts_with("pub(") && line.contains(" use ")
        {
            continue;
        }
        for start in ["crate::", "super::"] {
            for (at, _) in line.match_indices(start) {
                let before = line[..at].chars().next_back();
                // `$crate` of a macro is the crate as others name it.
                if before.is_some_and(|c| c.is_alphanumeric() || "_$:".contains(c)) {
                    continue;
                }
                let path: String =
                    line[at..].chars().take_while(|c| c.is_alphanumeric() || "_:".contains(*c)).collect();
                found.push(path.split("::").filter(|p| !p.is_empty()).map(String::from).collect());
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(inside: &str, text: &str) -> Source {
        Source { place: format!("src/{inside}"), inside: inside.into(), text: text.into() }
    }

    #[test]
    fn a_circle_is_found_through_a_re_export() {
        let root = source("lib.rs", "mod a;\nmod b;\npub use a::{A, deep::{Deep as Deeper}};\n");
        let a = source("a.rs", "use crate::b::B;\nmod deep;\npub struct A;\n");
        let deep = source("a/deep.rs", "use super::A;\npub struct Deep;");
        let b = source("b.rs", "fn f(a: crate::A) {}\n");
        assert_eq!(circles(&[root, a, deep, b]), [["src/a.rs", "src/b.rs"]]);
    }

    #[test]
    fn a_file_and_its_folder_are_one_unit() {
        let root = source("lib.rs", "mod a;\nuse a::A;\npub const C: u8 = 0;");
        let a = source("a.rs", "use crate::C;\nmod deep;\nuse deep::Deep;\npub struct A;\n");
        let deep = source("a/deep.rs", "use super::A;\npub struct Deep;");
        assert!(circles(&[root, a, deep]).is_empty());
    }
}
