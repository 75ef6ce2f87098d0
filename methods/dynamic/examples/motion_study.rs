//! What a mixture of trained experts is worth on generated films, with its controls: `motion_study FOLDER SEED...`. What is done already is not done again.

#[path = "motion_study/routers.rs"]
mod routers;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use weaver_dynamic::run::{Evaluation, ExpertKind, FilmSource, KeepBy, Preset, Run, RunSettings, Scores, Stage};

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

const EXPERT: usize = 3000;
const ROUTER: usize = 2000;
const PRUNED: usize = 500;
const DISTILLED: usize = 1500;

fn main() -> Outcome<()> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("expected a folder")?);
    for seed in arguments {
        of_seed(&folder.join(&seed), seed.parse()?)?;
    }
    Ok(())
}

/// Trains, unless that was done.
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
fn row(name: &str, evaluation: &Evaluation, of: impl Fn(&Scores) -> f64) {
    let groups = [&evaluation.held_out_cameras, &evaluation.held_out_times, &evaluation.trained];
    let cells: Vec<String> = groups.into_iter().flatten().map(|scores| format!("{:.2}", of(scores))).collect();
    println!("| {name} | {} |", cells.join(" | "));
}

fn of_seed(folder: &Path, seed: u64) -> Outcome<()> {
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
    println!("\nSeed {seed}, PSNR in dB\n\n| | held-out cameras | held-out times | trained on |\n|---|---|---|---|");
    let run = trained(&folder.join("mixture"), settings.clone(), None)?;
    let found = evaluated(&run)?;
    run.report(&found)?;
    for (k, name) in found.experts.iter().enumerate() {
        row(name, &found, |scores| scores.experts[k].psnr);
    }
    row("uniform mean", &found, |scores| scores.uniform.psnr);
    row("mixture", &found, |scores| scores.mixture.psnr);
    row("oracle", &found, |scores| scores.oracle.psnr);
    row("gate is right, %", &found, |scores| 100.0 * scores.right);
    routers::compared(&run)?;

    let times = |k: usize| found.held_out_times.as_ref().map_or(0.0, |scores| scores.experts[k].psnr);
    let best = (0..4).fold(0, |best, k| if times(k) > times(best) { k } else { best });
    let kind = settings.experts[best];
    let steps = 4 * EXPERT;
    let control =
        RunSettings { experts: vec![kind; 2], stages: vec![Stage::Expert { index: 0, steps }], ..settings.clone() };
    let longer = evaluated(&trained(&folder.join("longer"), control, None)?)?;
    row(&format!("{kind}, four times the steps"), &longer, |scores| scores.experts[0].psnr);
    let control = RunSettings { experts: vec![kind; 4], ..settings.clone() };
    let same = evaluated(&trained(&folder.join("same"), control, None)?)?;
    row(&format!("mixture of four {kind}"), &same, |scores| scores.mixture.psnr);

    for by in [KeepBy::Contribution, KeepBy::Sensitivity, KeepBy::Chance] {
        for keep in [1.0, 0.5, 0.45, 0.25] {
            // All of them are the same whatever they are judged by.
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
            row(&format!("{name}, {PRUNED} steps later"), &pruned, |scores| scores.mixture.psnr);
        }
    }
    for index in 0..4 {
        let plain = Stage::Expert { index, steps: DISTILLED };
        let stages = [
            ("plain", plain, false),
            ("distilled", Stage::Distil { index, steps: DISTILLED, lambda: 0.5 }, false),
            // What a teacher might know at best of what no photo shows: the photos that are held out.
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
            row(&format!("{label}, {name}, {DISTILLED} steps later"), &later, |scores| scores.experts[index].psnr);
        }
    }
    for motion in &found.motions {
        let experts: Vec<String> =
            motion.psnr.0.iter().zip(&motion.shares).map(|(psnr, share)| format!("{psnr:.2} ({share:.2})")).collect();
        println!("{}: {}; mixture {:.2}", motion.motion, experts.join(", "), motion.psnr.1);
    }
    Ok(())
}
