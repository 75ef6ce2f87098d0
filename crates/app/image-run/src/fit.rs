//! `splatweaver image fit`.

use crate::arguments::ImageFit;
use crate::job::{KIND, PicturesJob, Settings};
use crate::read::{note_shortfall, read};
use crate::results::Method;
use crate::search::Search;
use crate::{read, report};
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure, Interrupt, Progress};
use weaver_io::{atomic_write, check_output_file, list_photos};
use weaver_run::{Folder, Job, Run};

pub fn run(arguments: &ImageFit, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    if let Some(path) = &arguments.resume {
        let settings: Settings = Folder::settings(path, KIND, "fits of pictures")?;
        let names = settings.names();
        if path.join(Folder::SUMMARY).exists() && !path.join(Folder::CHECKPOINT).exists() {
            return Err(weaver_run::Error::complete(path).into());
        }
        let folder = Folder::reopen_with(path, KIND, names)?;
        return go_on(Run::resume(folder, PicturesJob::new(settings)?)?, console, interrupt);
    }
    let out = arguments.out.as_deref().ok_or_else(|| Failure::Usage("expected --out".into()))?;
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
        [picture] if picture.is_file() && !is_folder(out) => one(picture, out, arguments, &method, console, interrupt),
        _ if arguments.bytes.is_some() || arguments.psnr.is_some() => {
            Err(Failure::Usage("--bytes and --psnr: expected one picture and a file to write".into()))
        }
        _ => {
            let settings = Settings::new(list(&arguments.pictures)?, method)?;
            let folder = Folder::claim(out, KIND, &arguments.pictures)?;
            folder.out().check(settings.names())?;
            let job = PicturesJob::new(settings)?;
            folder.store(job.settings())?;
            go_on(Run::begin(folder, job), console, interrupt)
        }
    }
}

/// True if a path for results is that of a folder: it is there as one, or has no extension of files.
fn is_folder(out: &Path) -> bool {
    out.is_dir() || (!out.exists() && out.extension().is_none())
}

/// Pictures, and those in folders.
fn list(given: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut pictures = Vec::new();
    for path in given {
        match path.is_dir() {
            true => pictures.extend(list_photos(path)?),
            false => pictures.push(path.clone()),
        }
    }
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
    arguments: &ImageFit,
    method: &Method,
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    check_output_file(out, [path])?;
    let picture = read(path, console)?;
    let mut search = Search { path, picture: &picture, method, console, interrupt };
    let asked = method.count(&picture);
    let judged = match (arguments.bytes, arguments.psnr) {
        (Some(bytes), _) => search.within(bytes as usize)?,
        (_, Some(decibels)) => search.reaching(decibels)?,
        _ => search.trial(asked)?,
    };
    atomic_write(out, |to| to.write_all(&judged.bytes))?;
    let asked = if arguments.bytes.or(arguments.psnr.map(|_| 0)).is_some() { 0 } else { asked };
    note_shortfall(path, asked, judged.row.gaussians, judged.row.reset, console);
    console.print(&judged.row.line(out))
}

/// Fits the pictures of a run to the last, or until Ctrl-C.
fn go_on(mut run: Run<PicturesJob>, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    run.job.write(&run.folder)?;
    let [done, of] = run.job.steps();
    let method = run.job.settings().method.clone();
    let mut progress = Progress::new("fit", done, of, console);
    let complete = run.advance(interrupt.watch(), |report| {
        let gaussians = report.scalar("gaussians").unwrap_or(0.0) as usize;
        let note = || format!("{}: {}", report.stage, method.note(gaussians, report.loss));
        progress.at(report.step, report.of, note, console);
        Ok(())
    });
    progress.finish();
    let complete = complete?;
    for (row, asked) in run.job.take_news() {
        read::note_shortfall(&row.picture, asked, row.gaussians, row.reset, console);
    }
    let folder = run.folder.path().display().to_string();
    if !complete {
        return console.print(&format!("saved; `splatweaver image fit --resume {folder}` goes on"));
    }
    let page = report::of_run(run.job.rows(), &run.folder)?;
    run.folder.report(&page)?;
    run.folder.summarize(&run.job.rows())?;
    run.folder.forget_checkpoint();
    let rows = run.job.rows();
    let bytes: usize = rows.iter().map(|row| row.bytes).sum();
    let mean = rows.iter().map(|row| row.psnr).sum::<f64>() / rows.len() as f64;
    console.print(&format!("{} pictures, {bytes} bytes, {mean:.2} dB on average: {folder}", rows.len()))
}
