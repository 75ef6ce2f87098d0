//! `splatweaver image fit`.

use crate::command::arguments::ImageFit;
use crate::command::job::{KIND, PicturesJob, Settings};
use crate::command::read::{note_shortfall, read};
use crate::command::results::Method;
use crate::command::search::{Goal, Search};
use crate::command::state::under_way;
use crate::command::trace::{Trace, TraceFolder};
use crate::command::{read, report};
use serde_json::json;
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure, Interrupt, Progress, ShellCommand};
use weaver_io::safetensors::Tensors;
use weaver_io::{atomic_write, photos_at};
use weaver_run::{Folder, Job, Run};
use weaver_view_run::{Listener, LiveRun, LiveView, Server, live};

pub fn run(arguments: &ImageFit, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let live = Listener::of(arguments.live)?;
    if let Some(path) = &arguments.resume {
        let settings: Settings = Folder::settings(path, KIND, "fits of pictures")?;
        let names = settings.names();
        if path.join(Folder::SUMMARY).exists() && !path.join(Folder::CHECKPOINT).exists() {
            return Err(weaver_run::Error::complete(path).into());
        }
        let folder = Folder::reopen_with(path, KIND, names)?;
        return go_on(Run::resume(folder, PicturesJob::new(settings)?)?, (live, arguments.json), console, interrupt);
    }
    let out = arguments.out.as_ref().ok_or_else(|| Failure::Usage("expected --out".into()))?;
    let method = Method {
        ratio: arguments.ratio,
        gaussians: arguments.gaussians.map(|n| n as usize),
        steps: arguments.steps as usize,
        seed: arguments.seed,
        coarse: arguments.coarse,
        published: arguments.published,
    };
    method.check()?;
    if let Some(psnr) = arguments.psnr.filter(|psnr| !psnr.is_finite()) {
        return Err(Failure::Usage(format!("--psnr: expected a number of decibels, found {psnr}")));
    }
    match &arguments.pictures[..] {
        [picture] if picture.is_file() && !is_folder(out) => {
            one(picture, out.as_file()?, (arguments, live), &method, console, interrupt)
        }
        _ if arguments.bytes.is_some() || arguments.psnr.is_some() => {
            Err(Failure::Usage("--bytes and --psnr: expected one picture and a file to write".into()))
        }
        _ => {
            let settings = Settings::new(list(&arguments.pictures)?, method)?;
            let folder = Folder::claim(out, KIND, &arguments.pictures)?;
            folder.out().check(settings.names())?;
            let job = PicturesJob::new(settings)?;
            folder.store(job.settings())?;
            go_on(Run::begin(folder, job), (live, arguments.json), console, interrupt)
        }
    }
}

/// True if a path for results is a folder's: an existing folder, or a path without the extension of a file.
fn is_folder(out: &Path) -> bool {
    out.is_dir() || (!out.exists() && out.extension().is_none())
}

/// Pictures, and those in folders.
fn list(given: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let pictures = photos_at(given)?;
    if pictures.is_empty() {
        let folders: Vec<String> = given.iter().map(|path| path.display().to_string()).collect();
        return Err(Failure::message(format!("{}: expected pictures, found none", folders.join(", "))));
    }
    Ok(pictures)
}

/// Fits one picture to one file.
fn one(
    path: &Path,
    out: &Path,
    (arguments, listener): (&ImageFit, Option<Listener>),
    method: &Method,
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let picture = read(path, console)?;
    let goal = match (arguments.bytes, arguments.psnr) {
        (Some(bytes), _) => Goal::Bytes(bytes as usize),
        (_, Some(decibels)) => Goal::Decibels(decibels),
        _ => Goal::Gaussians(method.count(&picture)),
    };
    let (trials, stop) = (goal.trials(), interrupt.watch_after("this step"));
    let traces = listener.is_some().then(TraceFolder::new).transpose()?;
    let trace = traces.as_ref().map(|traces| Trace::new(traces, [method.steps, trials], stop)).transpose()?;
    let folder = traces.as_ref().map_or(out, TraceFolder::path);
    let drawing = |state: &Tensors| under_way(state, path, method);
    let (steps, names, showing) = (method.steps * trials, &report::CURVES, LiveView::Drawing(&drawing));
    let followed = LiveRun { folder, steps, names, showing, stop };
    let server =
        listener.map(|listener| Server::of_run(&path.display().to_string(), followed, listener)).transpose()?;
    let (judged, early) = live(server, console, |console| {
        let mut search = Search { path, picture: &picture, method, console, interrupt, trace, early: None };
        let judged = search.reaching(goal)?;
        Ok::<_, Failure>((judged, search.early))
    })?;
    if let Some(at) = &early {
        let name = out.display();
        // The existing file may be a completed fit.
        if out.symlink_metadata().is_ok() {
            return Err(Failure::message(format!("{name}: stopped at {at}; the file that is there stays as it is")));
        }
        console.note(&format!(
            "{name}: stopped at {at}, the fit so far is written; one whose --out is a folder can go on, by --resume"
        ));
    }
    atomic_write(out, |to| to.write_all(&judged.bytes))?;
    // The count of a stopped fit is no property of the picture.
    let asked = if let (Goal::Gaussians(asked), None) = (goal, &early) { asked } else { 0 };
    note_shortfall(path, asked, judged.row.gaussians, judged.row.reset, console);
    console.answer(arguments.json, &[out], &judged.row, &judged.row.line(out))
}

/// Fits all pictures of a run, or until Ctrl-C.
fn go_on(
    mut run: Run<PicturesJob>,
    (listener, json): (Option<Listener>, bool),
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    run.job.write(&run.folder)?;
    let [done, of] = run.job.steps();
    let (settings, path) = (run.job.settings().clone(), run.folder.path().to_path_buf());
    let stop = interrupt.watch_after("this step");
    let drawing = |state: &Tensors| settings.drawn(state, &path);
    let (names, showing) = (&report::CURVES, LiveView::Drawing(&drawing));
    let followed = LiveRun { folder: &path, steps: of, names, showing, stop };
    if listener.is_some() {
        run.folder.follow();
    }
    let server =
        listener.map(|listener| Server::of_run(&path.display().to_string(), followed, listener)).transpose()?;
    let mut progress = Progress::new("fit", done, of, console);
    let complete = live(server, console, |console| {
        run.advance(stop, |report| {
            let gaussians = report.scalar("gaussians").unwrap_or(0.0) as usize;
            let note = || format!("{}: {}", report.stage, settings.method.note(gaussians, report.loss));
            progress.at(report.step, report.of, note, console);
            Ok(())
        })
    });
    progress.finish();
    let complete = complete?;
    for (row, asked) in run.job.take_news() {
        read::note_shortfall(&row.picture, asked, row.gaussians, row.reset, console);
    }
    if !complete {
        let resume = ShellCommand::new("splatweaver image fit --resume").path(&path);
        let text = format!("saved; to go on: {resume}");
        return if json {
            console.answer(json, &[&path], json!({ "complete": false }), &text)
        } else {
            console.print(&text)
        };
    }
    let page = report::of_run(run.job.rows(), &run.folder)?;
    run.folder.report(&page)?;
    run.folder.summarize(&run.job.rows())?;
    run.folder.forget_checkpoint();
    let rows = run.job.rows();
    let bytes: usize = rows.iter().map(|row| row.bytes).sum();
    let mean = rows.iter().map(|row| row.psnr).sum::<f64>() / rows.len() as f64;
    let text = format!("{} pictures, {bytes} bytes, {mean:.2} dB on average: {}", rows.len(), path.display());
    console.answer(json, &[&path], json!({ "pictures": rows, "bytes": bytes, "psnr": mean }), &text)
}
