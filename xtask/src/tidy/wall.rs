//! The wall between the product and the published methods: no source below `crates/` names a method's crate, but for
//! the table of the command line.

use super::sources::Source;
use super::{Workspace, floors};

/// Files that may name methods.
const DOORS: &[&str] = &["crates/app/cli/Cargo.toml", "crates/app/cli/src/methods.rs"];

pub fn check(workspace: &Workspace, faults: &mut Vec<String>) {
    let methods = workspace.packages.iter().filter(|package| floors::of(package) == floors::METHODS);
    let names: Vec<&str> = methods.map(|package| package.name.as_str()).collect();
    let inside = workspace.packages.iter().flat_map(|package| package.sources.iter().chain(&package.tests));
    for source in inside.chain(&workspace.others) {
        check_source(source, &names, faults);
    }
}

fn check_source(source: &Source, methods: &[&str], faults: &mut Vec<String>) {
    let place = &source.place;
    let is_code = place.ends_with(".rs") || place.ends_with("Cargo.toml");
    if !place.starts_with("crates/") || !is_code || DOORS.iter().any(|door| place.starts_with(door)) {
        return;
    }
    for (number, line) in source.text.lines().enumerate() {
        if let Some(method) = methods.iter().find(|method| names(line, method)) {
            faults.push(format!("{place}:{}: {method} is a method, which the product does not know", number + 1));
        }
    }
}

/// True if a line has the name of a crate, as manifests or as sources write it.
fn names(line: &str, name: &str) -> bool {
    let is_of_name = |letter: char| letter.is_alphanumeric() || "-_".contains(letter);
    [name.to_string(), name.replace('-', "_")].iter().any(|name| {
        line.match_indices(name.as_str())
            .any(|(at, _)| !line[..at].ends_with(is_of_name) && !line[at + name.len()..].starts_with(is_of_name))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_are_named_at_the_door_alone() {
        let faults = |place: &str, text: &str| {
            let mut faults = Vec::new();
            let source = Source { place: place.into(), inside: String::new(), text: text.into() };
            check_source(&source, &["weaver-vad", "weaver-two-experts"], &mut faults);
            faults
        };
        let text = "use weaver_view::Look;\nuse weaver_vad::Detector;\n";
        assert_eq!(
            faults("crates/app/cli/src/commands/info.rs", text),
            ["crates/app/cli/src/commands/info.rs:2: weaver-vad is a method, which the product does not know"]
        );
        assert_eq!(faults("crates/nets/model/Cargo.toml", "weaver-two-experts = { workspace = true }").len(), 1);
        for (place, text) in [
            ("crates/app/cli/src/methods.rs", text),
            ("methods/vad/src/command.rs", text),
            ("crates/app/cli/README.md", "weaver-vad"),
            ("crates/engine/nn/src/lib.rs", "use weaver_vader::Helmet;"),
        ] {
            assert_eq!(faults(place, text), [""; 0], "{place}");
        }
    }
}
