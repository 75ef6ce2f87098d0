//! Study of the settings of refinement: held-out views after each change, beside the usual settings.
//!
//! `cargo run --release -p weaver-trainer --example refinement -- STEPS WIDTH CAMERAS CHANGE,CHANGE,.. DIR..`
//!
//! WIDTH is the width of the photos during refinement, 64 for the network's own. CAMERAS are `given`, or `estimated`
//! from the photos. A change is `usual`, or factors on settings joined by `+`, such as `means=0.5+quats=2`;
//! `dropout=0.2`, `ssim=0.5` and `last=0` (of the last gradient) set a value, `seed=1` another order of the photos,
//! `keep=1` moves no density. The weights that come with the program, 0.3 Gaussians per pixel, one thread; DIR are
//! captures.

use std::path::PathBuf;
use std::time::Instant;
use weaver_inference::{Density, Effort, Refined};
use weaver_trainer::{Error, EvalOptions, MatchingOverride, Source};

/// Gaussians per pixel.
const BUDGET: f64 = 0.3;
/// Longest side of photos while cameras are estimated, pixels.
const MATCHED: usize = 384;

fn main() -> Result<(), Error> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [steps, width, cameras, changes, folders @ ..] = &arguments[..] else {
        println!("expected STEPS WIDTH CAMERAS CHANGE,CHANGE,.. DIR..");
        return Ok(());
    };
    let number = |name, text: &str| {
        text.parse::<usize>().map_err(|_| Error::Input(format!("{name}: expected a number, found {text}")))
    };
    let (steps, width) = (number("STEPS", steps)?, number("WIDTH", width)?);
    let matching = match &cameras[..] {
        "given" => None,
        "estimated" => Some(MatchingOverride { long_side: MATCHED, focal_known: true }),
        other => return Err(Error::Input(format!("CAMERAS: expected given or estimated, found {other}"))),
    };
    let options = EvalOptions {
        density: Density { budget: Some(BUDGET), ..Density::default() },
        matching,
        ..EvalOptions::default()
    };
    let source = Source::Folders(folders.iter().map(PathBuf::from).collect());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("one thread can be had");
    println!("| change | PSNR | SSIM | seconds | of each capture |\n|---|---|---|---|---|");
    for change in changes.split(',') {
        pool.install(|| judge((steps, width), change, &source, &options))?;
    }
    Ok(())
}

/// Evaluates the refinement with one change, and prints its row.
fn judge((steps, width): (usize, usize), change: &str, source: &Source, options: &EvalOptions) -> Result<(), Error> {
    let mut run = weaver_trainer::OpenRun::built_in()?;
    let [h, w] = run.predictor.image_size();
    let size = [h * width / w, width];
    let refined = Refined::new(run.predictor, size, Effort::Steps(steps)).with_settings(changed(change)?);
    run.predictor = Box::new(refined);
    let start = Instant::now();
    let found = run.evaluate(source, options, &mut |_, _| ())?;
    let each: Vec<String> = (found.scenes.iter())
        .map(|scene| format!("{} {:.2}", scene.name.as_deref().unwrap_or("mean"), scene.psnr))
        .collect();
    let seconds = start.elapsed().as_secs_f64();
    println!("| {change} | {:.3} | {:.3} | {seconds:.1} | {} |", found.mean.psnr, found.mean.ssim, each.join(", "));
    Ok(())
}

/// The usual settings with a change.
fn changed(change: &str) -> Result<weaver_fit::FitSettings, Error> {
    let mut settings = Refined::usual_settings();
    for part in change.split('+').filter(|part| *part != "usual") {
        let wrong = || Error::Input(format!("CHANGE: expected NAME=NUMBER, found {part}"));
        let (name, value) = part.split_once('=').ok_or_else(wrong)?;
        let value: f64 = value.parse().map_err(|_| wrong())?;
        let rates = &mut settings.rates;
        match name {
            "means" => rates.means *= value,
            "end" => rates.means_end *= value,
            "scales" => rates.scales *= value,
            "quats" => rates.quats *= value,
            "opacities" => rates.opacities *= value,
            "sh" => rates.sh *= value,
            "fading" => settings.density.opacity_weight *= value as f32,
            "shrinking" => settings.density.scale_weight *= value as f32,
            "last" => rates.last = value,
            "ssim" => settings.ssim_weight = value,
            "dropout" => settings.dropout = value,
            "seed" => settings.seed = value as u64,
            "keep" => settings.density.strategy = weaver_fit::StrategyKind::Keep,
            _ => return Err(wrong()),
        }
    }
    Ok(settings)
}
