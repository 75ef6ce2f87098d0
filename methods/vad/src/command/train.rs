//! `splatweaver vad train`.

use crate::command::arguments::{EncoderName, VadPlan, VadTrain};
use crate::command::checkpoint::{self, RunState};
use crate::command::{MODEL, metrics, report};
use crate::{
    ConvolutionSizes, DeepMilSizes, EncoderKind, Error, Experts, Labels, Planted, Schedule, Splatting, Training,
    TrainingSet, UrDmuSizes, read_list,
};
use serde_json::json;
use std::path::{Path, PathBuf};
use weaver_command::{Console, Failure, Interrupt, Progress, ShellCommand};
use weaver_io::safetensors::Tensors;
use weaver_run::{Folder, Job, Kind, Log, Rhythm, Run, Save, StepReport};
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
        let inputs = Inputs::new(arguments.plan.clone())?;
        folder.store(&inputs.plan)?;
        return train(Run::begin(folder, inputs.job()), (live, arguments.json), console, interrupt);
    };
    if path.join(MODEL).exists() && !path.join(Folder::CHECKPOINT).exists() {
        return Err(weaver_run::Error::complete(path).into());
    }
    let stored = path.join(Folder::CHECKPOINT);
    let plan = match stored.exists() {
        // In folders of earlier versions, the checkpoint alone has the plan.
        true => checkpoint::read(&Tensors::read(&stored)?)?.2.plan,
        false => Folder::settings(path, KIND, "a detector of anomalies")?,
    };
    let folder = Folder::reopen(path, KIND)?;
    let inputs = Inputs::new(plan)?;
    train(Run::resume(folder, inputs.job())?, (live, arguments.json), console, interrupt)
}

/// Trains to the end, or until Ctrl-C; a page follows if the training is live.
fn train(
    mut run: Run<DetectorJob<'_>>,
    (listener, json): (Option<Listener>, bool),
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let (inputs, [done, total]) = (run.job.inputs, [run.job.steps()[0], run.job.inputs.steps()]);
    let ([normal, abnormal], classes) = (inputs.videos(), inputs.set.classes.len());
    console.note(&format!("{normal} normal and {abnormal} abnormal videos, {classes} classes; {total} steps"));
    let (path, stop) = (run.folder.path().to_path_buf(), interrupt.watch_after("this step"));
    let followed = LiveRun { folder: &path, steps: total, names: &[], showing: LiveView::Curves, stop };
    let server =
        listener.map(|listener| Server::of_run(&path.display().to_string(), followed, listener)).transpose()?;
    let finished = live(server, console, |console| {
        let mut progress = Progress::new("train", done, total, console);
        let finished = run.advance(stop, |report| {
            progress.at(report.step, total, || format!("{}, loss {:.4}", report.stage, report.loss), console);
            Ok(())
        });
        progress.finish();
        finished
    })?;
    if !finished {
        let resume = ShellCommand::new("splatweaver vad train --resume").path(&path);
        console.note(&format!("saved at step {} of {total}; to go on: {resume}", run.job.steps()[0]));
        return Ok(());
    }
    let (folder, detector) = (run.folder, run.job.training.into_detector());
    // Seed of the planted videos, the default test set of `vad eval`.
    let metadata = inputs.planted.as_ref().map_or(String::new(), |planted| planted.seed.to_string());
    let model = folder.out().file(MODEL)?;
    detector.write(&model, &metadata)?;
    folder.forget_checkpoint();
    console.note(&format!("{total} steps done: {}", model.display()));
    let Some(planted) = &inputs.planted else {
        return if json { console.answer(json, &[&model], json!({}), "") } else { Ok(()) };
    };
    let judged = crate::command::judged::planted(&detector, planted)?;
    report::leave(&judged, detector.experts(), &folder)?;
    let (found, report) = (judged.metrics(), path.join(Folder::REPORT));
    let text = format!("{}\nreport: {}", metrics::text(&found).trim_end(), report.display());
    console.answer(json, &[&model, &report], metrics::value(&found), &text)
}

/// The inputs of a training.
struct Inputs {
    plan: VadPlan,
    set: TrainingSet,
    planted: Option<Planted>,
    kind: EncoderKind,
    schedule: Schedule,
    /// A checksum of features and labels.
    features: String,
}

impl Inputs {
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

    /// Steps in all; with clusters, which may be fewer, an upper bound.
    fn steps(&self) -> usize {
        self.schedule.steps(&self.set)
    }

    fn job(&self) -> DetectorJob<'_> {
        DetectorJob { inputs: self, training: self.schedule.training(&self.set, self.kind) }
    }
}

/// A training as work in steps.
struct DetectorJob<'a> {
    inputs: &'a Inputs,
    training: Training<'a>,
}

impl Job for DetectorJob<'_> {
    type Error = Failure;

    fn steps(&self) -> [usize; 2] {
        self.training.steps()
    }

    fn step(&mut self) -> Result<StepReport, Failure> {
        let crate::StepReport { stage, loss, .. } = self.training.step()?;
        Ok(StepReport { step: self.steps()[0], of: self.inputs.steps(), stage, loss, scalars: Vec::new() })
    }

    fn state(&mut self) -> Result<Tensors, Failure> {
        let Inputs { plan, features, .. } = self.inputs;
        let (videos, features) = (self.inputs.videos(), Some(features.clone()));
        let state = RunState { plan: plan.clone(), videos, features, done: self.steps()[0] };
        Ok(checkpoint::write(&self.training, &state))
    }

    fn restore(&mut self, state: &Tensors) -> Result<(), Failure> {
        let inputs = self.inputs;
        let (detector, from, kept) = checkpoint::read(state)?;
        let file = state.origin();
        if inputs.videos() != kept.videos {
            let (expected, found) = (kept.videos, inputs.videos());
            let list = inputs.plan.list.as_deref().unwrap_or(file).display();
            return Err(Failure::message(format!(
                "{list}: expected {} normal and {} abnormal videos as when the run began, found {} and {}",
                expected[0], expected[1], found[0], found[1]
            )));
        }
        if kept.features.is_some_and(|features| features != inputs.features) {
            let features = inputs.plan.features.as_deref().unwrap_or(file).display();
            return Err(Failure::message(format!(
                "{features}: features and labels: expected those that the run began with, found others"
            )));
        }
        let resumed = Training::resume(&inputs.schedule, &inputs.set, detector, from);
        self.training = resumed.map_err(|error| match error {
            Error::Stage { .. } | Error::State(_) => Failure::message(format!("{}: {error}", file.display())),
            error => error.into(),
        })?;
        Ok(())
    }

    fn rhythm(&self) -> Rhythm {
        RHYTHM
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
