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
    if json {
        return console.print(&serde_json::to_string_pretty(outcome)?);
    }
    let path = |name: &str| folder.join(name).display().to_string();
    let look = if folder.join(VIEW).is_file() { format!("\nlook: {}", path(VIEW)) } else { String::new() };
    let (table, scene, report) = (outcome.table(), path("scene.ply"), path("report.html"));
    console.print(&format!("{table}{} Gaussians: {scene}\nreport: {report}{look}", outcome.gaussians))
}
