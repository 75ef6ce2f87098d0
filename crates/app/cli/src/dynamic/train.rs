//! `splatweaver dynamic train`, `prune` and `distil`.

use super::eval;
use crate::arguments::{DynamicDistil, DynamicPrune, DynamicTrain, PresetName};
use crate::{Console, Interrupt};
use std::path::Path;
use weaver_command::{Failure, Progress, duration};
use weaver_dynamic_run::{FilmSource, Made, Preset, Run, RunSettings, Stage};
use weaver_io::safetensors::Tensors;
use weaver_run::Folder;

/// Seconds between checkpoints.
const SAVE_EVERY: f64 = 60.0;
/// Longest side of a generated film's photos, and the other.
const SIZE: [usize; 2] = [96, 72];

pub fn run(arguments: &DynamicTrain, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    if let Some(folder) = &arguments.resume {
        return finish(Run::resume(folder)?, folder, console, interrupt);
    }
    let size = arguments.long_side.map(|size| size as usize);
    let film = match &arguments.data {
        Some(path) => FilmSource::Folder { path: path.clone(), long_side: size },
        None => {
            let width = size.unwrap_or(SIZE[0]);
            FilmSource::Procedural {
                seed: arguments.seed,
                size: [width, width * SIZE[1] / SIZE[0]],
                shots: arguments.shots,
            }
        }
    };
    let experts = (0..arguments.experts.len()).map(|index| Stage::Expert { index, steps: arguments.steps as usize });
    let settings = RunSettings {
        film,
        experts: arguments.experts.clone(),
        preset: match arguments.preset {
            PresetName::Tiny => Preset::Tiny,
            PresetName::Published => Preset::Published,
        },
        gaussians: arguments.gaussians as usize,
        all: arguments.hold_out == "none",
        stages: experts.chain([Stage::Router { steps: arguments.router_steps as usize }]).collect(),
        temperature: arguments.temperature,
        background_weight: arguments.background_weight,
        seed: arguments.seed,
        save_every: SAVE_EVERY,
        made: None,
    };
    let out = arguments.out.clone().unwrap_or_else(|| Folder::free(Path::new("runs"), "dynamic"));
    begin(&out, settings, None, console, interrupt)
}

pub fn prune(arguments: &DynamicPrune, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let run = Run::open(&arguments.run)?;
    let mut progress = Progress::new("prune", 0, run.training().len(), console);
    let observe = |done, all| progress.at(done, all, String::new, console);
    let tensors = run.pruned(arguments.keep, arguments.by, observe)?;
    progress.finish();
    let stages = vec![Stage::Router { steps: arguments.steps as usize }];
    let by = format!("keeping {} of the Gaussians by {}", arguments.keep, arguments.by);
    made(&run, &arguments.run, (stages, by), &arguments.out, tensors, (console, interrupt))
}

pub fn distil(arguments: &DynamicDistil, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let run = Run::open(&arguments.run)?;
    let index = run.settings().expert(&arguments.expert)?;
    let steps = arguments.steps as usize;
    let (stage, how) = match arguments.photos_alone {
        true => (Stage::Expert { index, steps }, "photos alone".to_string()),
        false => (Stage::Distil { index, steps, lambda: arguments.lambda }, format!("lambda {}", arguments.lambda)),
    };
    let by = format!("training the expert {} on, {how}", arguments.expert);
    let tensors = run.tensors();
    made(&run, &arguments.run, (vec![stage], by), &arguments.out, tensors, (console, interrupt))
}

/// A run that comes out of another.
fn made(
    run: &Run,
    from: &Path,
    (stages, by): (Vec<Stage>, String),
    out: &Path,
    tensors: Tensors,
    (console, interrupt): (&mut Console, &Interrupt),
) -> Result<(), Failure> {
    let settings = RunSettings { stages, made: Some(Made { from: from.into(), by }), ..run.settings().clone() };
    begin(out, settings, Some(tensors), console, interrupt)
}

fn begin(
    folder: &Path,
    settings: RunSettings,
    init: Option<Tensors>,
    console: &mut Console,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let run = Run::create(folder, settings, init)?;
    let film = run.film();
    let [height, width] = film.size;
    let counts: usize = run.mixture().counts().iter().sum();
    console.note(&format!(
        "{}: {} photos of {width} x {height} to train on, {} held out; {counts} Gaussians",
        film.name,
        run.training().len(),
        film.shots.len() - run.training().len()
    ));
    film.remarks.iter().for_each(|remark| console.note(&format!("note: {remark}")));
    finish(run, folder, console, interrupt)
}

fn finish(mut run: Run, folder: &Path, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    let [done, steps] = run.steps();
    let mut progress = Progress::new("train", done, steps, console);
    let complete = run.advance(interrupt.watch(), |report| {
        let shown = || format!("{}, loss {:.4}", report.stage, report.loss);
        progress.at(report.step, report.of, shown, console);
    })?;
    progress.finish();
    let folder = folder.display();
    if !complete {
        let [done, steps] = run.steps();
        console
            .note(&format!("saved at step {done} of {steps}; to go on: splatweaver dynamic train --resume {folder}"));
        return Ok(());
    }
    let evaluation = eval::judge(&run, console)?;
    let seconds: f64 = evaluation.seconds.iter().sum();
    console.note(&format!("{steps} steps done in {}: {folder}", duration(seconds)));
    console.print(&eval::table(&evaluation))?;
    console.print(&format!("report: {folder}/report.html"))
}
