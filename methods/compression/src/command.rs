//! `splatweaver bench compress`: methods of compression on the same pictures.

mod arguments;
mod peers;
mod run;
mod settings;
mod table;
#[cfg(test)]
mod tests;
mod views;

pub use arguments::BenchCompress;

use run::{Comparison, Inputs, KIND};
use serde_json::{Value, json};
use settings::Settings;
use std::path::PathBuf;
use table::{Coded, Row, page, table};
use weaver_command::{Console, Failure, Interrupt, Progress, ShellCommand, in_pool};
use weaver_io::check_output_file;
use weaver_run::{Folder, Job, Run};

/// Compares methods on scenes, and prints a table or JSON. With a folder, it saves when it is interrupted.
///
/// Fails on unreadable scenes, cameras or photos, on a failing method, and on results that cannot be written.
pub fn run(arguments: &BenchCompress, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    in_pool(arguments.threads.count(), || compare(arguments, console, interrupt))
}

fn compare(arguments: &BenchCompress, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let settings = match &arguments.resume {
        Some(path) => Folder::settings(path, KIND, "a comparison of methods")?,
        None => asked(arguments)?,
    };
    let read = || settings.scenes.iter().chain(&settings.peer).chain(&settings.cameras).chain(&settings.data);
    arguments.html.as_ref().map_or(Ok(()), |page| check_output_file(page, read()))?;
    // Claimed before any work.
    let claimed = arguments.out.as_ref().map(|out| Folder::claim(out, KIND, read())).transpose()?;
    let inputs = Inputs::read(settings)?;
    let tasks = inputs.tasks();
    let mut job = Comparison::new(&inputs, &tasks);
    let folder = match (&arguments.resume, claimed) {
        (Some(path), _) => Folder::reopen_with(path, KIND, inputs.names()?)?,
        (None, Some(folder)) => {
            folder.out().check(inputs.names()?)?;
            folder.store(inputs.settings())?;
            folder
        }
        (None, None) => {
            let [_, all] = job.steps();
            let mut progress = Progress::new("bench", 0, all, console);
            for _ in 0..all {
                let report = job.step()?;
                progress.at(report.step, all, || report.stage, console);
            }
            progress.finish();
            return show(arguments, &inputs, job.rows(), console);
        }
    };
    let path = folder.path().to_path_buf();
    let mut run = Run::resume(folder, job)?;
    run.job.write(&run.folder)?;
    let ([done, all], stop) = (run.job.steps(), interrupt.watch_after("this step"));
    let mut progress = Progress::new("bench", done, all, console);
    let complete = run.advance(stop, |report| {
        progress.at(report.step, report.of, || report.stage.clone(), console);
        Ok(())
    });
    progress.finish();
    if !complete? {
        let resume = ShellCommand::new("splatweaver bench compress --resume").path(path);
        return console.print(&format!("saved; to go on: {resume}"));
    }
    run.folder.report(&page(run.job.rows()))?;
    run.folder.summarize(&figures(&inputs, run.job.rows()))?;
    show(arguments, &inputs, run.job.rows(), console)
}

/// Settings from the arguments; with absolute paths for a run folder, so that it can be resumed from anywhere.
fn asked(arguments: &BenchCompress) -> Result<Settings, Failure> {
    let placed = |path: &PathBuf| match &arguments.out {
        Some(_) => std::path::absolute(path),
        None => Ok(path.clone()),
    };
    let all = |paths: &[PathBuf]| paths.iter().map(placed).collect::<Result<_, _>>();
    Ok(Settings {
        scenes: all(&arguments.scenes)?,
        methods: arguments.methods.clone(),
        peer: all(&arguments.peer)?,
        cameras: arguments.cameras.as_ref().map(placed).transpose()?,
        data: arguments.data.as_ref().map(placed).transpose()?,
        steps: arguments.steps,
        seed: arguments.seed,
        chamfer: arguments.chamfer,
        read: Vec::new(),
    })
}

/// Prints the rows, and writes the HTML page if wanted.
fn show(arguments: &BenchCompress, inputs: &Inputs, rows: &[Row], console: &mut Console) -> Result<(), Failure> {
    if let Some(file) = &arguments.html {
        page(rows).write(file)?;
        console.note(&format!("page: {}", file.display()));
    }
    if arguments.json {
        return console.print(&serde_json::to_string_pretty(&figures(inputs, rows))?);
    }
    console.print(&table(rows))
}

/// The rows for programs.
fn figures(inputs: &Inputs, rows: &[Row]) -> Vec<Value> {
    let Settings { steps, seed, .. } = inputs.settings();
    let row = |r: &Row| {
        let Coded { method, setting, bytes, seconds: [encode, decode] } = &r.coded;
        json!({"scene": r.scene, "method": method, "setting": setting, "gaussians": r.gaussians, "bytes": bytes,
            "bits_per_gaussian": r.bits, "psnr": r.psnr, "psnr_of_photos": r.photos, "chamfer": r.chamfer,
            "encode_seconds": encode, "decode_seconds": decode, "seed": seed, "steps": steps})
    };
    rows.iter().map(row).collect()
}
