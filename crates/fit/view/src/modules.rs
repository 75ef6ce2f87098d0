//! The viewer's ES modules, joined to one script without a bundler.

use std::fmt::Write;

/// Modules of the page, each after its imports.
const PAGE: &[(&str, &str)] = &[
    ("status", include_str!("../web/status.js")),
    ("background", include_str!("../web/background.js")),
    ("original", include_str!("../web/original.js")),
    ("history", include_str!("../web/history.js")),
    ("notes", include_str!("../web/notes.js")),
    ("address", include_str!("../web/address.js")),
    ("units", include_str!("../web/units.js")),
    ("vectors", include_str!("../web/vectors.js")),
    ("viewpoint", include_str!("../web/viewpoint.js")),
    ("shaders", include_str!("../web/shaders.js")),
    ("renderer", include_str!("../web/renderer.js")),
    ("order", include_str!("../web/order.js")),
    ("controls", include_str!("../web/controls.js")),
    ("points", include_str!("../web/points.js")),
    ("overlay", include_str!("../web/overlay.js")),
    ("selection", include_str!("../web/selection.js")),
    ("scale_bar", include_str!("../web/scale_bar.js")),
    ("alike", include_str!("../web/alike.js")),
    ("measure", include_str!("../web/measure.js")),
    ("tour", include_str!("../web/tour.js")),
    ("path", include_str!("../web/path.js")),
    ("keyframes", include_str!("../web/keyframes.js")),
    ("clean", include_str!("../web/clean.js")),
    ("second", include_str!("../web/second.js")),
    ("difference", include_str!("../web/difference.js")),
    ("shots", include_str!("../web/shots.js")),
    ("panel", include_str!("../web/panel.js")),
    ("live", include_str!("../web/live.js")),
    ("moment", include_str!("../web/moment.js")),
    ("main", include_str!("../web/main.js")),
];

/// Modules of the page about a run without a scene.
const RUN: &[(&str, &str)] = &[
    ("status", include_str!("../web/status.js")),
    ("live", include_str!("../web/live.js")),
    ("run", include_str!("../web/run.js")),
];

/// Modules of the worker.
const WORKER: &[(&str, &str)] = &[
    ("scene", include_str!("../web/scene.js")),
    ("sort", include_str!("../web/sort.js")),
    ("floaters", include_str!("../web/floaters.js")),
    ("upright", include_str!("../web/upright.js")),
    ("worker", include_str!("../web/worker.js")),
];

pub(crate) fn page() -> String {
    joined(PAGE)
}

pub(crate) fn run() -> String {
    joined(RUN)
}

pub(crate) fn worker() -> String {
    joined(WORKER)
}

/// One script: each module is a function that returns its exports, so that names of modules do not meet.
fn joined(modules: &[(&str, &str)]) -> String {
    let mut script = String::from("\"use strict\";\n");
    for (name, source) in modules {
        let (mut body, mut exports) = (String::new(), Vec::new());
        for line in source.lines() {
            if let Some((names, from)) = line.strip_prefix("import ").and_then(|rest| rest.split_once(" from \"./")) {
                let _ = writeln!(body, "const {names} = {}_module;", from.trim_end_matches(".js\";"));
            } else if let Some(declaration) = line.strip_prefix("export ") {
                exports.push(declared(declaration));
                let _ = writeln!(body, "{declaration}");
            } else {
                let _ = writeln!(body, "{line}");
            }
        }
        let _ = writeln!(script, "const {name}_module = (() => {{\n{body}return {{ {} }};\n}})();", exports.join(", "));
    }
    script
}

/// The name that a declaration gives.
fn declared(declaration: &str) -> &str {
    let words = declaration.trim_start_matches("async ");
    let name = words.split_once(' ').map_or("", |(_, rest)| rest);
    name.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn imports_and_exports_become_values() {
        let modules = [
            ("a", "export const one = 1;\nexport class Two {}\nexport function three() {}\n"),
            ("b", "import { one, Two } from \"./a.js\";\nconsole.log(one);\n"),
        ];
        let script = joined(&modules);
        assert!(script.contains("return { one, Two, three };"), "{script}");
        assert!(script.contains("const { one, Two } = a_module;"), "{script}");
    }

    /// Every import is of an earlier module that exports it.
    #[test]
    fn imports_are_of_earlier_modules() {
        for modules in [PAGE, RUN, WORKER] {
            for (i, (name, source)) in modules.iter().enumerate() {
                for line in source.lines().filter(|line| line.starts_with("import ")) {
                    let (names, from) = line.strip_prefix("import { ").unwrap().split_once(" } from \"./").unwrap();
                    let from = from.trim_end_matches(".js\";");
                    let (_, other) = modules[..i].iter().find(|(other, _)| *other == from).expect(name);
                    let exports: Vec<&str> =
                        other.lines().filter_map(|l| l.strip_prefix("export ")).map(declared).collect();
                    names.split(", ").for_each(|name| assert!(exports.contains(&name), "{name} of {from}"));
                }
            }
        }
    }

    #[test]
    fn text_never_becomes_markup_or_code() {
        for (name, source) in PAGE.iter().chain(RUN).chain(WORKER) {
            // The page reads its own markup to save it.
            for word in ["innerHTML", "outerHTML =", "insertAdjacentHTML", "document.write", "eval(", "new Function"] {
                assert!(!source.contains(word), "{word} in {name}.js");
            }
        }
    }

    #[test]
    fn nothing_ends_the_script_element_early() {
        for script in [page(), run(), worker()] {
            assert!(!script.contains("</script") && !script.contains("<!--"));
        }
    }
}
