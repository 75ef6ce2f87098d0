//! `splatweaver dynamic eval`.

use crate::run::{Evaluation, Run};
use clap::Args;
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure, Progress, Threads};

/// Judges experts, mixture, their uniform mean and the best expert at each pixel on photos that were held out, and
/// writes report.html anew.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver dynamic eval --run runs/film
  splatweaver dynamic eval --run runs/film --json")]
pub struct DynamicEval {
    /// Folder of the run
    #[arg(long, value_name = "RUN")]
    pub run: PathBuf,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub threads: Threads,
}

pub fn run(arguments: &DynamicEval, console: &mut Console) -> Result<(), Failure> {
    let run = Run::open(&arguments.run)?;
    run.film().remarks.iter().for_each(|remark| console.note(&format!("note: {remark}")));
    let evaluation = judge(&run, console)?;
    answer(&evaluation, &arguments.run, arguments.json, console)
}

/// Prints an evaluation whose report is in a folder.
pub fn answer(evaluation: &Evaluation, folder: &Path, json: bool, console: &mut Console) -> Result<(), Failure> {
    let report = folder.join("report.html");
    let text = format!("{}\nreport: {}", table(evaluation).trim_end(), report.display());
    console.answer(json, &[&report], evaluation, &text)
}

/// Evaluates a run and writes its report.
pub fn judge(run: &Run, console: &mut Console) -> Result<Evaluation, Failure> {
    let mut progress = Progress::new("eval", 0, run.film().shots.len(), console);
    let evaluation = run.evaluate(|done, all| progress.at(done, all, String::new, console))?;
    progress.finish();
    run.report(&evaluation)?;
    Ok(evaluation)
}

/// A table of an evaluation.
fn table(evaluation: &Evaluation) -> String {
    let groups = evaluation.groups();
    let titles = groups.iter().map(|(name, scores)| format!("{name} ({})", scores.shots));
    let header: Vec<String> = std::iter::once("PSNR, dB (SSIM)".into()).chain(titles).collect();
    let mut rows = vec![header];
    rows.extend(evaluation.rows());
    let right = groups.iter().map(|(_, scores)| format!("{:.1} %", 100.0 * scores.right));
    rows.push(std::iter::once("gate is right".into()).chain(right).collect());
    let widths: Vec<usize> =
        (0..rows[0].len()).map(|column| rows.iter().map(|row| row[column].len()).max().unwrap_or(0)).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).enumerate().map(|(i, (cell, width))| match i {
            0 => format!("{cell:<width$}"),
            _ => format!("{cell:>width$}"),
        });
        cells.collect::<Vec<_>>().join("  ")
    };
    let total: usize = evaluation.gaussians.iter().sum();
    let mut text: Vec<String> = rows.iter().map(line).collect();
    text.push(format!("{total} Gaussians"));
    text.join("\n")
}
