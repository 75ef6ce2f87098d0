//! Trains two experts and their router on a film in a folder, or on a generated one: `train_folder OUT [FILM]`.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use weaver_dynamic::run::{ExpertKind, FilmSource, Preset, Run, RunSettings, Stage};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1).map(PathBuf::from);
    let out = arguments.next().ok_or("expected a folder for the run")?;
    let film = match arguments.next() {
        Some(path) => FilmSource::Folder { path, long_side: Some(96) },
        None => FilmSource::Procedural { seed: 0, size: [96, 72], shots: [5, 16] },
    };
    let expert = |index| Stage::Expert { index, steps: 300 };
    let settings = RunSettings {
        film,
        experts: vec![ExpertKind::Keys, ExpertKind::Poly],
        preset: Preset::Tiny,
        gaussians: 1000,
        all: false,
        stages: vec![expert(0), expert(1), Stage::Router { steps: 200 }],
        temperature: 1.0,
        background_weight: 1.0,
        seed: 0,
        save_every: 60.0,
        derived_from: None,
    };
    let mut run = Run::create(&out, settings, None)?;
    run.advance(&AtomicBool::new(false), |step| {
        if step.step.is_multiple_of(100) {
            println!("{}: {:.4}", step.stage, step.loss);
        }
    })?;
    let evaluation = run.evaluate(|_, _| {})?;
    for row in evaluation.rows() {
        println!("{}", row.join("  "));
    }
    Ok(run.report(&evaluation)?)
}
