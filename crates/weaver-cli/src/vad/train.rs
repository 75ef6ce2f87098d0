//! `splatweaver vad train`.

use super::{MODEL, report};
use crate::arguments::{EncoderName, VadPlan, VadTrain};
use crate::{Console, Interrupt};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use weaver_command::{Failure, Progress};
use weaver_io::{Appender, OutputFolder};
use weaver_vad::{
    Checkpoint, ConvolutionSizes, DeepMilSizes, Detector, EncoderKind, Error, Experts, Labels, Observe, Planted,
    Schedule, Snapshot, Splatting, StepReport, TrainingSet, UrDmuSizes, read_list,
};

/// The file to go on from in a run folder, and how often it is written.
const CHECKPOINT: &str = "checkpoint.safetensors";
/// The other files of a run.
const LOG: &str = "training.jsonl";
pub const REPORT: &str = "report.html";
const FILES: [&str; 4] = [MODEL, CHECKPOINT, LOG, REPORT];
/// What a run's folder says that its files were written by.
const COMMAND: &str = "vad";
const BETWEEN_CHECKPOINTS: Duration = Duration::from_secs(300);

pub fn run(arguments: &VadTrain, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let Some(folder) = &arguments.resume else {
        let folder = &arguments.out;
        for (file, advice) in
            [(MODEL, "give another --out"), (CHECKPOINT, "go on with --resume, or give another --out")]
        {
            if folder.join(file).exists() {
                let path = folder.join(file);
                return Err(Failure::Usage(format!("{}: a run is there already; {advice}", path.display())));
            }
        }
        let out = OutputFolder::claim(folder, COMMAND, arguments.plan.features.iter().chain(&arguments.plan.list))?;
        out.check(FILES)?;
        let job = Job::new(arguments.plan.clone())?;
        return job.train(&out, None, console, interrupt);
    };
    let path = folder.join(CHECKPOINT);
    if !path.exists() && folder.join(MODEL).exists() {
        return Err(Failure::Usage(format!("{}: the run is complete", folder.display())));
    }
    let out = reopened(folder)?;
    let (detector, checkpoint, told) = Checkpoint::read(&path)?;
    let kept: Kept = serde_json::from_str(&told)
        .map_err(|error| Failure::message(format!("{}: what was trained: {error}", path.display())))?;
    let job = Job::new(kept.plan)?;
    if job.videos() != kept.videos {
        let (expected, found) = (kept.videos, job.videos());
        let list = job.plan.list.as_deref().unwrap_or(&path).display();
        return Err(Failure::message(format!(
            "{list}: expected {} normal and {} abnormal videos as when the run began, found {} and {}",
            expected[0], expected[1], found[0], found[1]
        )));
    }
    if kept.features.is_some_and(|features| features != job.features) {
        let features = job.plan.features.as_deref().unwrap_or(&path).display();
        return Err(Failure::message(format!(
            "{features}: features and labels: expected those that the run began with, found others"
        )));
    }
    job.train(&out, Some((detector, checkpoint, kept.done)), console, interrupt)
}

/// What a checkpoint keeps beside the weights.
#[derive(Serialize, Deserialize)]
struct Kept {
    plan: VadPlan,
    /// Normal and abnormal videos.
    videos: [usize; 2],
    /// A checksum of features and labels; runs of earlier versions have none.
    #[serde(default)]
    features: Option<String>,
    /// Steps of all stages.
    done: usize,
}

/// The folder of a run that is there already, claimed.
pub fn reopened(folder: &Path) -> Result<OutputFolder, Failure> {
    Ok(OutputFolder::reopen(folder, COMMAND, FILES)?)
}

/// A training, all that it needs at hand.
struct Job {
    plan: VadPlan,
    set: TrainingSet,
    planted: Option<Planted>,
    kind: EncoderKind,
    schedule: Schedule,
    /// A checksum of features and labels.
    features: String,
}

impl Job {
    fn new(plan: VadPlan) -> Result<Self, Failure> {
        // Wherever it is resumed from.
        let absolute = |path: Option<PathBuf>| path.map(std::path::absolute).transpose();
        let plan = VadPlan { features: absolute(plan.features)?, list: absolute(plan.list)?, ..plan };
        for path in plan.features.iter().chain(&plan.list) {
            weaver_io::path_in_utf8(path)?;
        }
        let (set, planted) = match (&plan.features, &plan.list) {
            (Some(folder), Some(list)) => {
                let videos = read_list(list, folder)?;
                (TrainingSet::listed(list, videos, plan.abnormal.map(|n| n as usize))?, None)
            }
            _ => {
                let planted = Planted::new(plan.seed);
                (TrainingSet::planted(&planted), Some(planted))
            }
        };
        let experts = experts(&plan, &set)?;
        let kind = kind(plan.encoder, &set, experts == Experts::Classes, planted.is_some());
        let labels = plan.splat.rule().map_or(Labels::None, |rule| Labels::Splat(Splatting::with(rule)));
        let mut schedule = match planted {
            Some(_) => Schedule::planted(labels, experts, plan.seed),
            None => Schedule::published(labels, experts, plan.seed),
        };
        if let Some(steps) = plan.steps {
            let factor = f64::from(steps) / schedule.encoder.steps as f64;
            schedule = schedule.scaled(factor);
        }
        let features = set.checksum()?.to_string();
        Ok(Self { plan, set, planted, kind, schedule, features })
    }

    fn videos(&self) -> [usize; 2] {
        [self.set.normal().len(), self.set.abnormal().len()]
    }

    fn train(
        self,
        out: &OutputFolder,
        from: Option<(Detector, Checkpoint, usize)>,
        console: &mut Console,
        interrupt: &Interrupt,
    ) -> Result<(), Failure> {
        let total = self.schedule.steps(&self.set);
        let ([normal, abnormal], classes) = (self.videos(), self.set.classes.len());
        console.note(&format!("{normal} normal and {abnormal} abnormal videos, {classes} classes; {total} steps"));
        let done = from.as_ref().map_or(0, |(.., done)| *done);
        let folder = out.path();
        let path = out.file(LOG)?;
        if done > 0 {
            keep_lines(&path, done)?;
        }
        let mut watch = Watch {
            job: &self,
            out,
            log: Appender::open(path)?,
            progress: Progress::new("train", done, total, console),
            console,
            stop: interrupt.watch(),
            saved: Instant::now(),
            done,
            total,
        };
        let trained = match from {
            None => self.schedule.train(&self.set, self.kind, &mut watch),
            Some((detector, checkpoint, _)) => self.schedule.resume(&self.set, (detector, checkpoint), &mut watch),
        };
        let done = watch.done;
        watch.progress.finish();
        let detector = match trained {
            Err(Error::Stopped { .. }) => {
                let folder = folder.display();
                console.note(&format!(
                    "saved at step {done} of {total}; to go on: splatweaver vad train --resume {folder}"
                ));
                return Ok(());
            }
            trained => trained?,
        };
        // What `vad eval` is to judge it on where it is given no list.
        let told = self.planted.map_or(String::new(), |planted| planted.seed.to_string());
        detector.write(&out.file(MODEL)?, &told)?;
        let _ = std::fs::remove_file(folder.join(CHECKPOINT));
        console.note(&format!("{total} steps done: {}", folder.join(MODEL).display()));
        let Some(planted) = self.planted else { return Ok(()) };
        let judged = super::judged::planted(&detector, &planted)?;
        console.print(&super::metrics::text(&judged.metrics()))?;
        let path = out.file(REPORT)?;
        report::write(&judged, detector.experts(), &path)?;
        console.print(&format!("report: {}", path.display()))
    }
}

/// Logs steps, shows them, and writes checkpoints.
struct Watch<'a, 'c> {
    job: &'a Job,
    out: &'a OutputFolder,
    log: Appender,
    progress: Progress,
    console: &'a mut Console<'c>,
    stop: &'a AtomicBool,
    saved: Instant,
    done: usize,
    total: usize,
}

impl Observe for Watch<'_, '_> {
    fn step(&mut self, step: &StepReport, snapshot: &Snapshot<'_>) -> weaver_vad::Result<ControlFlow<()>> {
        self.done += 1;
        let shown = || format!("{}, loss {:.4}", step.stage, step.loss);
        self.progress.at(self.done, self.total, shown, self.console);
        let record = serde_json::json!({"step": self.done, "stage": step.stage, "loss": step.loss});
        self.log.append(format!("{record}\n").as_bytes())?;
        let stopped = self.stop.load(Ordering::Relaxed);
        if stopped || self.saved.elapsed() > BETWEEN_CHECKPOINTS {
            let Job { plan, features, .. } = self.job;
            let (plan, features) = (plan.clone(), Some(features.clone()));
            let kept = Kept { plan, videos: self.job.videos(), features, done: self.done };
            let told = serde_json::to_string(&kept).unwrap_or_default();
            snapshot.write(&self.out.file(CHECKPOINT)?, &told)?;
            self.saved = Instant::now();
        }
        Ok(if stopped { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    }
}

/// Takes back what was logged after a checkpoint.
fn keep_lines(path: &Path, count: usize) -> Result<(), Failure> {
    let text = weaver_io::read_text(path)?;
    let kept: String = text.split_inclusive('\n').take(count).collect();
    Ok(weaver_io::write_text(path, &kept)?)
}

/// What experts are for.
fn experts(plan: &VadPlan, set: &TrainingSet) -> Result<Experts, Failure> {
    let plain = plan.plain || matches!(plan.encoder, EncoderName::Deepmil | EncoderName::Rtfm);
    match plan.clusters {
        Some(k) => Ok(Experts::Clusters(usize::from(k))),
        None if plain => Ok(Experts::None),
        None if !set.classes.is_empty() => Ok(Experts::Classes),
        None => {
            let list = plan.list.as_deref().unwrap_or(Path::new("the list")).display();
            Err(Failure::Usage(format!("{list}: names tell no classes; give --clusters K or --no-experts")))
        }
    }
}

fn kind(name: EncoderName, set: &TrainingSet, class_heads: bool, small: bool) -> EncoderKind {
    let features = set.width();
    let classes = if class_heads { set.classes.len() } else { 0 };
    let width = if small { 32 } else { 512 };
    match name {
        EncoderName::Urdmu => {
            let sizes = if small { UrDmuSizes::small(features) } else { UrDmuSizes::published(features) };
            EncoderKind::UrDmu(UrDmuSizes { classes, ..sizes })
        }
        EncoderName::Convolutions => EncoderKind::Convolutions(ConvolutionSizes { features, width, classes }),
        EncoderName::Deepmil => EncoderKind::DeepMil(DeepMilSizes { features, hidden: [512, 32] }),
        EncoderName::Rtfm => EncoderKind::Rtfm(ConvolutionSizes { features, width, classes: 0 }),
    }
}
