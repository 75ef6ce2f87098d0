//! The crates' edges as docs/architecture.md draws them. The drawing is the rule: a crate may use what it points to, and
//! everything below that.

use super::{Workspace, required, short, text};
use std::collections::{BTreeMap, BTreeSet};

const DOCUMENT: &str = "docs/architecture.md";

/// What crates with these parts below them may not bring to who embeds them.
const CLOSED: &[(&str, &[&str])] = &[("inference", &["toml", "base64", "clap", "indicatif"])];

/// Edges by the short names of crates: `trainer --> model & io`.
type Edges = BTreeMap<String, BTreeSet<String>>;

pub fn check(workspace: &Workspace, faults: &mut Vec<String>) {
    let document = required(&workspace.root, DOCUMENT, faults);
    let drawn = edges(&document);
    let declared = declared(workspace);
    compare(&drawn, &declared, faults);
    for name in declared.keys().filter(|name| !document.contains(&format!("| weaver-{name} |"))) {
        faults.push(format!("{DOCUMENT}: weaver-{name} has no row in the table of crates"));
    }
    for (name, closed) in CLOSED {
        let within = below(&declared, name);
        for package in &workspace.packages {
            if package.short() == *name || within.contains(package.short()) {
                let brought = outside(package).filter(|outside| closed.contains(outside));
                faults.extend(brought.map(|o| format!("{}: {o} would come with weaver-{name}", package.name)));
            }
        }
    }
}

/// The dependencies of a package that are no part of the workspace, those of tests left out.
fn outside(package: &super::Package) -> impl Iterator<Item = &str> {
    let dependencies = package.metadata["dependencies"].as_array().into_iter().flatten();
    dependencies.filter(|d| d["kind"].is_null()).map(|d| text(d, "name")).filter(|name| !name.starts_with("weaver-"))
}

/// The edges that manifests declare, those of tests and of packages outside the product left out.
fn declared(workspace: &Workspace) -> Edges {
    let product = workspace.packages.iter().filter(|package| !package.exempt());
    let edges = product.map(|package| {
        let dependencies = package.metadata["dependencies"].as_array().into_iter().flatten();
        let names = dependencies.filter(|d| d["kind"].is_null()).map(|d| text(d, "name"));
        let to = names.filter(|name| name.starts_with("weaver-")).map(|name| short(name).to_string());
        (package.short().to_string(), to.collect())
    });
    edges.collect()
}

/// The edges of a Mermaid graph in a document.
fn edges(document: &str) -> Edges {
    let mut edges = Edges::new();
    let graph = document.lines().skip_while(|line| line.trim() != "```mermaid").skip(1);
    for line in graph.take_while(|line| line.trim() != "```") {
        let mut chain = line.split("-->").map(|names| names.split('&').map(|name| name.trim().to_string()));
        let Some(mut from) = chain.next().map(|names| names.collect::<Vec<_>>()) else { continue };
        for to in chain {
            let to: Vec<String> = to.collect();
            for name in from {
                edges.entry(name).or_default().extend(to.iter().cloned());
            }
            for name in &to {
                edges.entry(name.clone()).or_default();
            }
            from = to;
        }
    }
    edges
}

/// Everything that can be reached from a crate.
fn below(edges: &Edges, name: &str) -> BTreeSet<String> {
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

fn compare(drawn: &Edges, declared: &Edges, faults: &mut Vec<String>) {
    for (name, to) in declared {
        if !drawn.contains_key(name) {
            faults.push(format!("weaver-{name}: not in the drawing of {DOCUMENT}"));
            continue;
        }
        let allowed = below(drawn, name);
        for to in to.iter().filter(|to| !allowed.contains(*to)) {
            faults.push(format!("weaver-{name} may not depend on weaver-{to}: {DOCUMENT} does not draw that"));
        }
    }
    for (name, to) in drawn {
        let Some(declared) = declared.get(name) else {
            faults.push(format!("{DOCUMENT} draws weaver-{name}, which does not exist"));
            continue;
        };
        for to in to.iter().filter(|to| !declared.contains(*to)) {
            faults.push(format!("{DOCUMENT} draws weaver-{name} --> weaver-{to}, which its Cargo.toml does not have"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn graph(lines: &str) -> Edges {
        edges(&format!("Text --> text\n\n```mermaid\ngraph TD\n{lines}\n```\nMore --> text\n"))
    }

    #[test]
    fn edges_are_those_of_the_drawing_and_what_lies_below() {
        let drawn = graph("  model --> nn & splat\n  nn & splat --> autograd --> kernels");
        assert_eq!(drawn.len(), 5);
        let faults = |declared: &str| {
            let mut faults = Vec::new();
            compare(&drawn, &graph(declared), &mut faults);
            faults
        };
        let real = "model --> nn & splat & kernels\nnn & splat --> autograd --> kernels";
        assert_eq!(faults(real), [""; 0]);
        let upward = faults(&format!("{real}\nautograd --> nn"));
        assert_eq!(upward.len(), 1, "{upward:?}");
        assert!(upward[0].starts_with("weaver-autograd may not depend on weaver-nn"), "{upward:?}");
        let gone = faults("model --> nn\nnn & splat --> autograd --> kernels");
        assert_eq!(gone.len(), 1, "{gone:?}");
        assert!(gone[0].contains("draws weaver-model --> weaver-splat"), "{gone:?}");
    }
}
