//! `splatweaver train`.

use crate::arguments::Train;
use crate::{Console, Interrupt};
use std::path::Path;
use weaver_command::{Failure, Progress, device, duration};
use weaver_inference::RunFolder;
use weaver_trainer::{Error, Folder, Observer, Resolved, Setup, StepReport, Summary, Training, claim_run, reclaim_run};

pub fn run(arguments: &Train, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let registry = weaver_recipes::registry();
    let rasterizer = device::rasterizer(&arguments.device)?;
    if let Some(path) = &arguments.resume {
        let folder = RunFolder::at(path);
        let architecture = registry.of_run(&folder)?;
        let config = architecture.read(&folder)?;
        check_trace(arguments, &config)?;
        let claimed = if arguments.dry_run { None } else { Some(reclaim_run(path)?) };
        return crate::in_pool(arguments.threads.map(usize::from).or(config.threads), || {
            let mut session = architecture.resume(&folder, arguments.steps.map(|steps| steps as usize))?;
            session.draw_by(rasterizer);
            let Some(claimed) = &claimed else {
                return dry_run(session, &config, console);
            };
            train(session, claimed, arguments, console, interrupt)
        });
    }
    let architecture = registry.find(arguments.model.as_deref())?;
    let config = architecture.resolve(&Setup {
        preset: arguments.preset.clone(),
        file: arguments.config.clone(),
        settings: arguments.settings.clone(),
        data: arguments.data.clone(),
        init: arguments.init.clone(),
        teacher: arguments.teacher.clone(),
        seed: arguments.seed,
        threads: arguments.threads.map(usize::from),
        steps: arguments.steps.map(|steps| steps as usize),
    })?;
    let path = arguments.out.clone().unwrap_or_else(|| Folder::free(Path::new("runs"), &config.preset));
    check_trace(arguments, &config)?;
    // Claimed before anything is read; nothing is left behind when the data cannot be.
    let claimed = if arguments.dry_run { None } else { Some(claim_run(&path, &config)?) };
    crate::in_pool(config.threads, || {
        let mut session = architecture.start(&config)?;
        session.draw_by(rasterizer);
        let Some(claimed) = &claimed else {
            return dry_run(session, &config, console);
        };
        claimed.store_text(&config.toml)?;
        train(session, claimed, arguments, console, interrupt)
    })
}

/// Checks that the file of a trace can be written.
fn check_trace(arguments: &Train, config: &Resolved) -> Result<(), Failure> {
    Ok(arguments.trace.as_ref().map_or(Ok(()), |path| weaver_io::check_output_file(path, &config.inputs))?)
}

/// Measures what the run would take. Nothing is left behind.
fn dry_run(session: Box<dyn Training>, config: &Resolved, console: &mut Console) -> Result<(), Failure> {
    console.print(session.plan().trim_end())?;
    let path = std::env::temp_dir().join(format!("splatweaver-dry-run-{}", std::process::id()));
    let folder = claim_run(&path, config)?;
    let measured = session.dry_run(&folder);
    drop(folder);
    std::fs::remove_dir_all(&path)?;
    console.print(&measured?.to_string())?;
    if let Some(peak) = weaver_io::peak_mb() {
        console.print(&format!("{:<28}{peak:>9.1} MB, photos and program included", "peak"))?;
    }
    Ok(())
}

fn train(
    mut session: Box<dyn Training>,
    folder: &Folder,
    arguments: &Train,
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    if let Some(path) = &arguments.trace {
        session.trace_to(&std::path::absolute(path)?);
    }
    let path = folder.path().display();
    console.note(session.plan().trim_end());
    console.note(&format!("run folder {path}"));
    let (done, total) = session.steps();
    let label = session.labeler();
    let mut shown = Shown { progress: Progress::new("train", done, total, console), label, total, console };
    let result = session.train(folder, &mut shown, interrupt.watch());
    let Shown { progress, console, .. } = shown;
    progress.finish();
    let summary = result?;
    report(&summary, folder, console)
}

fn report(summary: &Summary, folder: &Folder, console: &mut Console) -> Result<(), Failure> {
    let Summary { steps, planned, .. } = summary;
    if steps < planned {
        let path = folder.path().display();
        console.note(&format!("saved at step {steps} of {planned}; to go on: splatweaver train --resume {path}"));
        return Ok(());
    }
    let memory = weaver_io::peak_mb().map_or(String::new(), |peak| format!(", at most {peak:.1} MB of memory"));
    console.note(&format!("{steps} steps done, {} in this session{memory}", duration(summary.seconds)));
    if let Some(evaluation) = &summary.evaluation {
        console.print(&evaluation.table())?;
    }
    console.print(&format!("report: {}", folder.path().join(Folder::REPORT).display()))
}

/// Shows each step.
struct Shown<'a, 'c> {
    progress: Progress,
    label: fn(&StepReport) -> String,
    total: usize,
    console: &'a mut Console<'c>,
}

impl Observer for Shown<'_, '_> {
    fn step(&mut self, report: &StepReport) -> Result<(), Error> {
        let label = self.label;
        self.progress.at(report.step, self.total, || label(report), self.console);
        Ok(())
    }
}
