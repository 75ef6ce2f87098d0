//! `splatweaver train`.

use crate::arguments::Train;
use crate::bench::memory::peak_mb;
use crate::failure::Failure;
use crate::progress::{Progress, duration};
use crate::{Console, Interrupt};
use std::path::{Path, PathBuf};
use weaver_trainer::{Config, Error, Observer, RunFolder, Session, StepReport, Summary};

pub fn run(arguments: &Train, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    match &arguments.resume {
        Some(path) => {
            let (folder, config) = RunFolder::open(path)?;
            crate::in_pool(arguments.threads.map_or(config.threads, usize::from), || {
                let mut session = Session::resume(config, &folder.checkpoint_path())?;
                if arguments.dry_run {
                    return rehearse(session, console);
                }
                trace(&mut session, arguments)?;
                train(session, &folder, console, interrupt)
            })
        }
        None => {
            let config = configure(arguments)?;
            let path = arguments.out.clone().unwrap_or_else(|| free_folder(Path::new("runs"), &config.preset));
            crate::in_pool(config.threads, || {
                // The folder comes second: nothing is left behind when the data cannot be read.
                let mut session = Session::new(config)?;
                if arguments.dry_run {
                    return rehearse(session, console);
                }
                trace(&mut session, arguments)?;
                let folder = RunFolder::create(&path, session.config())?;
                train(session, &folder, console, interrupt)
            })
        }
    }
}

fn configure(arguments: &Train) -> Result<Config, Failure> {
    let mut config = Config::resolve(arguments.preset.as_deref(), arguments.config.as_deref(), &arguments.settings)?;
    if !arguments.data.is_empty() {
        config.data.folders = arguments.data.clone();
    }
    // The run may be resumed or evaluated from elsewhere.
    for folder in &mut config.data.folders {
        *folder = std::path::absolute(&folder)?;
    }
    config.seed = arguments.seed.unwrap_or(config.seed);
    config.threads = arguments.threads.map_or(config.threads, usize::from);
    if let Some(steps) = arguments.steps {
        config.rescale(steps as usize);
    }
    Ok(config)
}

fn trace(session: &mut Session, arguments: &Train) -> Result<(), Failure> {
    if let Some(path) = &arguments.trace {
        session.trace_to(&std::path::absolute(path)?);
    }
    Ok(())
}

/// What the run would take. Nothing is left behind.
fn rehearse(session: Session, console: &mut Console) -> Result<(), Failure> {
    console.print(session.plan().trim_end())?;
    let path = std::env::temp_dir().join(format!("splatweaver-dry-run-{}", std::process::id()));
    let folder = RunFolder::create(&path, session.config())?;
    let rehearsal = session.rehearse(&folder);
    std::fs::remove_dir_all(&path)?;
    let rehearsal = rehearsal?;
    console.print(&rehearsal.to_string())?;
    if let Some(peak) = peak_mb() {
        console.print(&format!("{:<28}{peak:>9.1} MB, photos and program included", "peak"))?;
    }
    Ok(())
}

/// The first of `<parent>/<preset>-1`, `-2`, ... that does not exist.
fn free_folder(parent: &Path, preset: &str) -> PathBuf {
    let mut number = 1;
    loop {
        let path = parent.join(format!("{preset}-{number}"));
        if !path.exists() {
            return path;
        }
        number += 1;
    }
}

fn train(
    mut session: Session,
    folder: &RunFolder,
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let path = folder.path().display();
    console.note(session.plan().trim_end());
    console.note(&format!("run folder {path}"));
    let (done, total) = session.steps();
    let mut shown = Shown { progress: Progress::new("train", done, total, console), total, console };
    let result = session.train(folder, &mut shown, interrupt.heed());
    let Shown { progress, console, .. } = shown;
    progress.finish();
    let summary = result?;
    report(&summary, folder, console)
}

fn report(summary: &Summary, folder: &RunFolder, console: &mut Console) -> Result<(), Failure> {
    let Summary { steps, planned, .. } = summary;
    if steps < planned {
        let path = folder.path().display();
        console.note(&format!("saved at step {steps} of {planned}; to go on: splatweaver train --resume {path}"));
        return Ok(());
    }
    let memory = peak_mb().map_or(String::new(), |peak| format!(", at most {peak:.1} MB of memory"));
    console.note(&format!("{steps} steps done, {} in this session{memory}", duration(summary.seconds)));
    if let Some(evaluation) = &summary.evaluation {
        console.print(&evaluation.table())?;
    }
    console.print(&format!("report: {}", folder.report_path().display()))
}

/// Shows each step.
struct Shown<'a, 'c> {
    progress: Progress,
    total: usize,
    console: &'a mut Console<'c>,
}

impl Observer for Shown<'_, '_> {
    fn step(&mut self, report: &StepReport) -> Result<(), Error> {
        let note = || format!("{}, loss {:.4}", report.stage, report.loss);
        self.progress.at(report.step, self.total, note, self.console);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_free_folder_is_taken() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(free_folder(folder.path(), "micro"), folder.path().join("micro-1"));
        std::fs::create_dir(folder.path().join("micro-1")).unwrap();
        assert_eq!(free_folder(folder.path(), "micro"), folder.path().join("micro-2"));
    }
}
