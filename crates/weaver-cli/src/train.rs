//! `splatweaver train`.

use crate::arguments::Train;
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
                let session = Session::resume(config, &folder.checkpoint_path())?;
                train(session, &folder, console, interrupt)
            })
        }
        None => {
            let config = configure(arguments)?;
            let path = arguments.out.clone().unwrap_or_else(|| free_folder(Path::new("runs"), &config.preset));
            crate::in_pool(config.threads, || {
                // The folder comes second: nothing is left behind when the data cannot be read.
                let session = Session::new(config)?;
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
    console.note(&format!("{steps} steps done, {} in this session", duration(summary.seconds)));
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
