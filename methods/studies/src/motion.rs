//! The worth of a mixture of trained experts on generated films, with its controls: `motion FOLDER SEED..`. Existing
//! trainings are read.

mod routers;

use crate::Outcome;
use crate::arguments::Arguments;
use crate::table::{Table, note};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use weaver_dynamic::run::{Evaluation, ExpertKind, FilmSource, KeepBy, Preset, Run, RunSettings, Scores, Stage};

const EXPERT: usize = 3000;
const ROUTER: usize = 2000;
const PRUNED: usize = 500;
const DISTILLED: usize = 1500;

pub fn run(mut arguments: Arguments) -> Outcome {
    let folder: PathBuf = arguments.required("a folder")?;
    arguments.rest("seeds")?.into_iter().try_for_each(|seed: u64| of_seed(&folder.join(seed.to_string()), seed))
}

/// Trains, unless the folder holds the training already.
fn trained(folder: &Path, settings: RunSettings, init: Option<&Run>) -> Outcome<Run> {
    let made = match folder.join("run.json").exists() {
        true if folder.join("model.safetensors").exists() => return Ok(Run::open(folder)?),
        true => Run::resume(folder),
        false => Run::create(folder, settings, init.map(Run::tensors)),
    };
    made?.advance(&AtomicBool::new(false), |_| {})?;
    Ok(Run::open(folder)?)
}

fn evaluated(run: &Run) -> Outcome<Evaluation> {
    Ok(run.evaluate(|_, _| {})?)
}

/// A row of PSNRs: held-out cameras, held-out times, photos that were trained on.
fn row(table: &Table, name: &str, evaluation: &Evaluation, of: impl Fn(&Scores) -> f64) {
    let groups = [&evaluation.held_out_cameras, &evaluation.held_out_times, &evaluation.trained];
    let cells: Vec<String> = groups.into_iter().flatten().map(|scores| format!("{:.2}", of(scores))).collect();
    table.row(name, &cells);
}

fn of_seed(folder: &Path, seed: u64) -> Outcome {
    let experts = ExpertKind::ALL.to_vec();
    let alone = |count: usize| (0..count).map(|index| Stage::Expert { index, steps: EXPERT });
    let settings = RunSettings {
        film: FilmSource::Procedural { seed, size: [96, 72], shots: [9, 32] },
        stages: alone(4).chain([Stage::Router { steps: ROUTER }]).collect(),
        experts,
        preset: Preset::Tiny,
        gaussians: 2500,
        all: false,
        temperature: 1.0,
        background_weight: 1.0,
        seed,
        save_every: 30.0,
        derived_from: None,
    };
    let columns = ["held-out cameras", "held-out times", "trained on"];
    let table = Table::new(&format!("Seed {seed}, PSNR in dB"), &columns);
    let run = trained(&folder.join("mixture"), settings.clone(), None)?;
    let found = evaluated(&run)?;
    run.report(&found)?;
    for (k, name) in found.experts.iter().enumerate() {
        row(&table, name, &found, |scores| scores.experts[k].psnr);
    }
    row(&table, "uniform mean", &found, |scores| scores.uniform.psnr);
    row(&table, "mixture", &found, |scores| scores.mixture.psnr);
    row(&table, "oracle", &found, |scores| scores.oracle.psnr);
    row(&table, "gate is right, %", &found, |scores| 100.0 * scores.right);
    routers::compared(&run, &table)?;

    let times = |k: usize| found.held_out_times.as_ref().map_or(0.0, |scores| scores.experts[k].psnr);
    let best = (0..4).fold(0, |best, k| if times(k) > times(best) { k } else { best });
    let kind = settings.experts[best];
    let steps = 4 * EXPERT;
    let control =
        RunSettings { experts: vec![kind; 2], stages: vec![Stage::Expert { index: 0, steps }], ..settings.clone() };
    let longer = evaluated(&trained(&folder.join("longer"), control, None)?)?;
    row(&table, &format!("{kind}, four times the steps"), &longer, |scores| scores.experts[0].psnr);
    let control = RunSettings { experts: vec![kind; 4], ..settings.clone() };
    let same = evaluated(&trained(&folder.join("same"), control, None)?)?;
    row(&table, &format!("mixture of four {kind}"), &same, |scores| scores.mixture.psnr);

    for by in [KeepBy::Contribution, KeepBy::Sensitivity, KeepBy::Chance] {
        for keep in [1.0, 0.5, 0.45, 0.25] {
            // With all Gaussians kept, the score does not matter.
            if keep == 1.0 && by != KeepBy::Contribution {
                continue;
            }
            let name = format!("{keep} kept by {by}");
            let place = folder.join(name.replace(' ', "-"));
            let after = RunSettings { stages: vec![Stage::Router { steps: PRUNED }], ..settings.clone() };
            if !place.exists() {
                Run::create(&place, after.clone(), Some(run.pruned(keep, by, |_, _| {})?))?;
            }
            let pruned = evaluated(&trained(&place, after, None)?)?;
            row(&table, &format!("{name}, {PRUNED} steps later"), &pruned, |scores| scores.mixture.psnr);
        }
    }
    for index in 0..4 {
        let plain = Stage::Expert { index, steps: DISTILLED };
        let stages = [
            ("plain", plain, false),
            ("distilled", Stage::Distil { index, steps: DISTILLED, lambda: 0.5 }, false),
            // Upper bound on a teacher's additional knowledge: the held-out photos themselves.
            ("plain, on all photos", plain, true),
        ];
        for (name, stage, all) in stages {
            let label = &found.experts[index];
            let after = RunSettings { stages: vec![stage], all, ..settings.clone() };
            let later = evaluated(&trained(
                &folder.join(format!("{label}-{name}").replace(", ", "-").replace(' ', "-")),
                after,
                Some(&run),
            )?)?;
            row(&table, &format!("{label}, {name}, {DISTILLED} steps later"), &later, |scores| {
                scores.experts[index].psnr
            });
        }
    }
    for motion in &found.motions {
        let experts: Vec<String> =
            motion.psnr.0.iter().zip(&motion.shares).map(|(psnr, share)| format!("{psnr:.2} ({share:.2})")).collect();
        note(&format!("{}: {}; mixture {:.2}", motion.motion, experts.join(", "), motion.psnr.1));
    }
    Ok(())
}
