//! `splatweaver vad train`.

use crate::command::arguments::{EncoderName, VadPlan, VadTrain};
use crate::command::checkpoint::{self, RunState};
use crate::command::{MODEL, report};
use crate::{
    Checkpoint, ConvolutionSizes, DeepMilSizes, Detector, EncoderKind, Error, Experts, Labels, Observe, Planted,
    Schedule, Snapshot, Splatting, StepReport, TrainingSet, UrDmuSizes, read_list,
};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure, Interrupt, Progress, ShellCommand};
use weaver_io::safetensors::Tensors;
use weaver_run::{Folder, Kind, Log, Recorder, Rhythm, Save};
use weaver_view_run::{Listener, LiveRun, LiveView, Server, live};

/// The folders of these runs.
pub const KIND: Kind = Kind { command: "vad", settings: "run.json", results: &[MODEL] };
/// Intervals of logging and saving.
const RHYTHM: Rhythm = Rhythm { log: Log::Every(1), save: Save::Seconds(20.0) };

pub fn run(arguments: &VadTrain, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let live = Listener::of(arguments.live)?;
    let Some(path) = &arguments.resume else {
        let path = &arguments.out.as_deref().map_or_else(|| Folder::free(Path::new("runs"), "vad"), Path::to_path_buf);
        if path.join(MODEL).exists() {
            return Err(weaver_run::Error::run_exists(path).into());
        }
        let folder = Folder::claim(path, KIND, arguments.plan.features.iter().chain(&arguments.plan.list))?;
        let job = Job::new(arguments.plan.clone())?;
        folder.store(&job.plan)?;
        return job.train((&folder, live), None, console, interrupt);
    };
    if path.join(MODEL).exists() && !path.join(Folder::CHECKPOINT).exists() {
        return Err(weaver_run::Error::complete(path).into());
    }
    if !path.join(Folder::CHECKPOINT).exists() {
        let plan = Folder::settings(path, KIND, "a detector of anomalies")?;
        let folder = Folder::reopen(path, KIND)?;
        return Job::new(plan)?.train((&folder, live), None, console, interrupt);
    }
    let folder = Folder::reopen(path, KIND)?;
    let state = Tensors::read(folder.checkpoint_path())?;
    let file = folder.checkpoint_path();
    let (detector, from, kept) = checkpoint::read(state)?;
    let job = Job::new(kept.plan)?;
    if job.videos() != kept.videos {
        let (expected, found) = (kept.videos, job.videos());
        let list = job.plan.list.as_deref().unwrap_or(&file).display();
        return Err(Failure::message(format!(
            "{list}: expected {} normal and {} abnormal videos as when the run began, found {} and {}",
            expected[0], expected[1], found[0], found[1]
        )));
    }
    if kept.features.is_some_and(|features| features != job.features) {
        let features = job.plan.features.as_deref().unwrap_or(&file).display();
        return Err(Failure::message(format!(
            "{features}: features and labels: expected those that the run began with, found others"
        )));
    }
    job.train((&folder, live), Some((detector, from, kept.done)), console, interrupt)
}

/// A training with its inputs.
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
        // Absolute paths hold in every folder from which the run is resumed.
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

    /// Trains to the end, or until Ctrl-C; a page follows if the training is live.
    fn train(
        self,
        (folder, listener): (&Folder, Option<Listener>),
        from: Option<(Detector, Checkpoint, usize)>,
        console: &mut Console,
        interrupt: &Interrupt,
    ) -> Result<(), Failure> {
        let total = self.schedule.steps(&self.set);
        let ([normal, abnormal], classes) = (self.videos(), self.set.classes.len());
        console.note(&format!("{normal} normal and {abnormal} abnormal videos, {classes} classes; {total} steps"));
        let done = from.as_ref().map_or(0, |(.., done)| *done);
        let (path, stop) = (folder.path(), interrupt.watch_after("this step"));
        let followed = LiveRun { folder: path, steps: total, names: &[], showing: LiveView::Curves, stop };
        let server =
            listener.map(|listener| Server::of_run(&path.display().to_string(), followed, listener)).transpose()?;
        let recorder = Recorder::open(folder, done, RHYTHM, stop)?;
        let (trained, done, failure) = live(server, console, |console| {
            let progress = Progress::new("train", done, total, console);
            let mut watch = Watch { job: &self, recorder, progress, console, done, total, failure: None };
            let trained = match from {
                None => self.schedule.train(&self.set, self.kind, &mut watch),
                Some((detector, checkpoint, _)) => self.schedule.resume(&self.set, (detector, checkpoint), &mut watch),
            };
            watch.progress.finish();
            (trained, watch.done, watch.failure)
        });
        failure.map_or(Ok(()), Err)?;
        let detector = match trained {
            Err(Error::Stopped { .. }) => {
                let resume = ShellCommand::new("splatweaver vad train --resume").path(folder.path());
                console.note(&format!("saved at step {done} of {total}; to go on: {resume}"));
                return Ok(());
            }
            Err(error @ (Error::Stage { .. } | Error::State(_))) => {
                return Err(Failure::message(format!("{}: {error}", folder.checkpoint_path().display())));
            }
            trained => trained?,
        };
        // Seed of the planted videos, the default test set of `vad eval`.
        let metadata = self.planted.map_or(String::new(), |planted| planted.seed.to_string());
        let model = folder.out().file(MODEL)?;
        detector.write(&model, &metadata)?;
        folder.forget_checkpoint();
        console.note(&format!("{total} steps done: {}", model.display()));
        let Some(planted) = self.planted else { return Ok(()) };
        let judged = crate::command::judged::planted(&detector, &planted)?;
        console.print(&crate::command::metrics::text(&judged.metrics()))?;
        report::leave(&judged, detector.experts(), folder)?;
        console.print(&format!("report: {}", folder.path().join(Folder::REPORT).display()))
    }
}

/// Logs steps, shows them, and writes checkpoints.
struct Watch<'a, 'c> {
    job: &'a Job,
    recorder: Recorder<'a>,
    progress: Progress,
    console: &'a mut Console<'c>,
    done: usize,
    total: usize,
    /// The recorder's failure, which ends the training.
    failure: Option<weaver_run::Error>,
}

impl Watch<'_, '_> {
    /// Records a step; returns true if training is to end.
    fn record(&mut self, step: &StepReport, snapshot: &Snapshot<'_>) -> Result<bool, weaver_run::Error> {
        let (stage, loss) = (step.stage.clone(), step.loss);
        let report = weaver_run::StepReport { step: self.done, of: self.total, stage, loss, scalars: Vec::new() };
        self.recorder.log(&report)?;
        let stopped = self.recorder.stopped();
        if stopped || self.recorder.is_due(self.done) {
            let (plan, features) = (self.job.plan.clone(), Some(self.job.features.clone()));
            let state = RunState { plan, videos: self.job.videos(), features, done: self.done };
            self.recorder.save(|| Ok::<_, weaver_run::Error>(checkpoint::write(snapshot, &state)))?;
        }
        Ok(stopped)
    }
}

impl Observe for Watch<'_, '_> {
    fn step(&mut self, step: &StepReport, snapshot: &Snapshot<'_>) -> crate::Result<ControlFlow<()>> {
        self.done += 1;
        let shown = || format!("{}, loss {:.4}", step.stage, step.loss);
        self.progress.at(self.done, self.total, shown, self.console);
        let stopped = self.record(step, snapshot).unwrap_or_else(|error| {
            self.failure = Some(error);
            true
        });
        Ok(if stopped { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    }
}

/// The experts' categories.
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
