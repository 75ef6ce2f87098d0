//! The end of a fit, as it is printed.

use std::path::Path;
use weaver_command::{Console, Failure, Interrupt};
use weaver_reconstruct::{Outcome, VIEW};

/// Notes that a fit was stopped, as by its page: a stopped fit is no complete unit of work.
pub fn conclude(outcome: &Outcome, interrupt: &Interrupt) {
    if outcome.steps < outcome.planned {
        interrupt.request();
    }
}

/// Prints the quality of a scene, for people or as JSON.
pub fn print(outcome: &Outcome, folder: &Path, json: bool, console: &mut Console) -> Result<(), Failure> {
    let mut outputs = vec![folder.join("scene.ply"), folder.join("report.html")];
    outputs.extend(Some(folder.join(VIEW)).filter(|view| view.is_file()));
    let look = outputs.get(2).map_or(String::new(), |view| format!("\nlook: {}", view.display()));
    let (table, scene, report) = (outcome.table(), outputs[0].display(), outputs[1].display());
    let text = format!("{table}{} Gaussians: {scene}\nreport: {report}{look}", outcome.gaussians);
    console.answer(json, &outputs, outcome, &text)
}
