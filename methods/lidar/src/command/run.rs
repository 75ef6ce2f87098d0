//! `splatweaver lidar`.

use crate::command::job::said;
use crate::command::looks::{beginning, scene_of};
use crate::command::plan::name;
use crate::command::report::CURVES;
use crate::command::results::{KEYFRAMES, MAP, Summary, TRAJECTORY, write};
use crate::command::{LidarJob, LidarPlan, LidarRunError};
use clap::{Args, Command};
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure, Interrupt, LiveFlag, Output, Progress, ShellCommand, Threads, in_pool};
use weaver_run::{Folder, Job, Kind, Run};
use weaver_view_run::{Listener, LiveRun, LiveView, Server, live};

/// The folders of these runs.
pub const KIND: Kind = Kind { command: "lidar", settings: "run.json", results: &[TRAJECTORY, KEYFRAMES, MAP] };

/// Finds where the scans of a lidar were taken, and makes a map of flat Gaussians of them (Splat-LOAM).
///
/// Each scan is registered to the map as it is drawn from the last keyframe; scans that show something new become
/// keyframes, to which the map is fitted. Ctrl-C saves a checkpoint and ends; --resume goes on to the same bits.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver lidar scans -o runs/street
  splatweaver lidar velodyne --size 64x1024 --fov -25,3 --range 3,60 --reference poses.txt -o runs/kitti
  splatweaver lidar scans --poses poses.txt -o runs/map
  splatweaver lidar --resume runs/street")]
pub struct Lidar {
    #[command(flatten)]
    plan: LidarPlan,
    /// Folder of the run [default: the first free one of runs/lidar-1, runs/lidar-2, ...]
    #[arg(short, long, value_name = "DIR", value_parser = Output::folder())]
    out: Option<Output>,
    /// Goes on from the checkpoint of a run that was stopped, with what it was started with
    #[arg(long, value_name = "RUN", conflicts_with_all = ["LidarPlan", "out"])]
    resume: Option<PathBuf>,
    /// Prints figures as JSON, and nothing else, on standard output
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    live: LiveFlag,
    #[command(flatten)]
    threads: Threads,
}

/// Runs `splatweaver lidar`.
///
/// Fails on unreadable scans, on invalid settings, and on results that cannot be written.
pub fn run(arguments: &Lidar, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    in_pool(arguments.threads.count(), || {
        let listener = Listener::of(arguments.live)?;
        advance(opened(arguments)?, listener, arguments, console, interrupt)
    })
}

fn opened(arguments: &Lidar) -> Result<Run<LidarJob>, Failure> {
    let Some(path) = &arguments.resume else {
        let path =
            &arguments.out.as_deref().map_or_else(|| Folder::free(Path::new("runs"), "lidar"), Path::to_path_buf);
        let plan = arguments.plan.clone().absolute()?;
        let inputs = [plan.scans.as_ref(), plan.poses.as_ref(), plan.reference.as_ref()];
        for input in inputs.into_iter().flatten() {
            weaver_io::path_in_utf8(input)?;
        }
        let folder = Folder::claim(path, KIND, inputs.into_iter().flatten())?;
        let job = LidarJob::new(plan)?;
        folder.store(job.plan())?;
        return Ok(Run::begin(folder, job));
    };
    let plan = stored(path)?;
    let folder = Folder::reopen(path, KIND)?;
    if path.join(Folder::SUMMARY).exists() && !folder.checkpoint_path().exists() {
        return Err(weaver_run::Error::complete(path).into());
    }
    Ok(Run::resume(folder, LidarJob::stored(plan)?)?)
}

/// The plan of the run in a folder, with numbers checked as on the command line.
pub(crate) fn stored(run: &Path) -> Result<LidarPlan, Failure> {
    const OF: &str = "odometry and mapping of lidar scans";
    let plan: LidarPlan = Folder::settings(run, KIND, OF)?;
    let Err(error) = Lidar::augment_args(Command::new(KIND.command)).try_get_matches_from(plan.words()) else {
        return Ok(plan);
    };
    let text = error.to_string();
    let line = text.lines().next().unwrap_or_default();
    Err(LidarRunError::Invalid {
        path: run.join(KIND.settings),
        what: "settings",
        expected: format!("those of {OF}"),
        found: line.strip_prefix("error: ").unwrap_or(line).into(),
    }
    .into())
}

fn advance(
    mut run: Run<LidarJob>,
    listener: Option<Listener>,
    arguments: &Lidar,
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let [before, of] = run.job.steps();
    let (path, stop) = (run.folder.path().to_path_buf(), interrupt.watch_after("this scan"));
    let scene_page = listener.is_some().then(|| beginning(&run.job, path.display().to_string())).transpose()?;
    let followed = LiveRun { folder: &path, steps: of, names: &CURVES, showing: LiveView::Scene(&scene_of), stop };
    let shown = scene_page.as_ref().zip(listener);
    let server = shown.map(|(scene_page, listener)| Server::new(scene_page, Some(followed), listener)).transpose()?;
    if server.is_some() {
        run.folder.follow();
    }
    let mut progress = Progress::new("lidar", before, of, console);
    let complete = live(server, console, |console| {
        run.advance(stop, |report| {
            let shown = || report.scalar("fitness").map_or(String::new(), |fitness| format!("fitness {fitness:.2}"));
            progress.at(report.step, report.of, shown, console);
            Ok(())
        })
    })?;
    progress.finish();
    remark(&run.job, before, console);
    let [done, of] = run.job.steps();
    if !complete && !run.job.ended() {
        let resume = ShellCommand::new("splatweaver lidar --resume").path(run.folder.path());
        console.note(&format!("saved at scan {done} of {of}; to go on: {resume}"));
        return Ok(());
    }
    if run.job.ended() {
        console.note(&format!("tracking ended after scan {done} of {}", run.job.files().len()));
    }
    let summary = write(&mut run.job, &run.folder)?;
    finish(&mut run, &summary, arguments.json, console)
}

/// Prints lost scans with reasons: one line for each, and one for all scans without range registration.
fn remark(job: &LidarJob, before: usize, console: &mut Console) {
    let mut once = false;
    for (record, file) in job.records().iter().zip(job.files()).skip(before) {
        if let Some(line) = said(record, &name(file)).filter(|_| record.lost || !once) {
            console.note(&line);
        }
        once |= !record.lost && !record.remark.is_empty();
    }
}

fn finish(run: &mut Run<LidarJob>, summary: &Summary, json: bool, console: &mut Console) -> Result<(), Failure> {
    run.folder.summarize(summary)?;
    crate::command::report::leave(&mut run.job, summary, &run.folder)?;
    run.folder.forget_checkpoint();
    let report = run.folder.path().join(Folder::REPORT);
    console.answer(json, &[&report], summary, &summary.text())?;
    console.note(&format!("report: {}", report.display()));
    Ok(())
}
