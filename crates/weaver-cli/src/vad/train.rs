//! `splatweaver vad train`.

use super::{MODEL, report};
use crate::Console;
use crate::arguments::{EncoderName, VadTrain};
use crate::failure::Failure;
use crate::progress::Progress;
use std::path::Path;
use weaver_io::{Appender, create_folder};
use weaver_vad::{
    ConvolutionSizes, DeepMilSizes, EncoderKind, Experts, Labels, Planted, Schedule, Splatting, TrainingSet,
    UrDmuSizes, read_list,
};

pub fn run(arguments: &VadTrain, console: &mut Console) -> Result<(), Failure> {
    let out = &arguments.out;
    if out.join(MODEL).exists() {
        let path = out.join(MODEL);
        return Err(Failure::Usage(format!("{}: a run is there already; give another --out", path.display())));
    }
    weaver_io::check_writable(out)?;
    let (set, planted) = match (&arguments.features, &arguments.list) {
        (Some(folder), Some(list)) => {
            let videos = read_list(list, folder)?;
            (TrainingSet::listed(list, videos, arguments.abnormal.map(|n| n as usize))?, None)
        }
        _ => {
            let planted = Planted::new(arguments.seed);
            (TrainingSet::planted(&planted), Some(planted))
        }
    };
    let experts = experts(arguments, &set)?;
    let kind = kind(arguments.encoder, &set, experts == Experts::Classes, planted.is_some());
    let labels = arguments.splat.rule().map_or(Labels::None, |rule| Labels::Splat(Splatting::with(rule)));
    let schedule = match planted {
        Some(_) => Schedule::planted(labels, experts, arguments.seed),
        None => Schedule::published(labels, experts, arguments.seed),
    };
    let schedule = match arguments.steps {
        Some(steps) => {
            let factor = f64::from(steps) / schedule.encoder.steps as f64;
            schedule.scaled(factor)
        }
        None => schedule,
    };
    let total = schedule.steps(&set);
    let (normal, abnormal) = (set.normal().len(), set.abnormal().len());
    console
        .note(&format!("{normal} normal and {abnormal} abnormal videos, {} classes; {total} steps", set.classes.len()));
    create_folder(out)?;
    let mut log = Appender::open(out.join("training.jsonl"))?;
    let mut progress = Progress::new("train", 0, total, console);
    let (mut done, mut failed) = (0, None);
    let detector = schedule.train(&set, kind, &mut |step| {
        done += 1;
        progress.at(done, total, || format!("{}, loss {:.4}", step.stage, step.loss), console);
        let record = serde_json::json!({"step": done, "stage": step.stage, "loss": step.loss});
        if failed.is_none() {
            failed = log.append(format!("{record}\n").as_bytes()).err();
        }
    });
    progress.finish();
    let detector = detector?;
    failed.map_or(Ok(()), Err)?;
    // What `vad eval` is to judge it on where it is given no list.
    let told = planted.map_or(String::new(), |planted| planted.seed.to_string());
    detector.write(&out.join(MODEL), &told)?;
    console.note(&format!("{total} steps done: {}", out.join(MODEL).display()));
    match planted {
        None => Ok(()),
        Some(planted) => {
            let judged = super::judged::planted(&detector, &planted)?;
            console.print(&super::metrics::text(&judged.metrics()))?;
            let path = out.join("report.html");
            report::write(&judged, detector.experts(), &path)?;
            console.print(&format!("report: {}", path.display()))
        }
    }
}

/// What experts are for.
fn experts(arguments: &VadTrain, set: &TrainingSet) -> Result<Experts, Failure> {
    let plain = arguments.plain || matches!(arguments.encoder, EncoderName::Deepmil | EncoderName::Rtfm);
    match arguments.clusters {
        Some(k) => Ok(Experts::Clusters(usize::from(k))),
        None if plain => Ok(Experts::None),
        None if !set.classes.is_empty() => Ok(Experts::Classes),
        None => {
            let list = arguments.list.as_deref().unwrap_or(Path::new("the list")).display();
            Err(Failure::Usage(format!("{list}: names tell no classes; give --clusters K or --plain")))
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
