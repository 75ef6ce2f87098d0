//! Fits a capture and prints how well held-out photos are met:
//! `fit_capture FOLDER [STEPS] [GAUSSIANS] [SETTINGS AS JSON]`.

use std::error::Error;
use std::time::Instant;
use weaver_data::posed::{self, PosedOptions};
use weaver_fit::{Fit, FitSettings, Judge, init};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().ok_or("expected the folder of a capture")?;
    let steps = arguments.next().map_or(Ok(1500), |a| a.parse())?;
    let gaussians = arguments.next().map_or(Ok(30_000), |a| a.parse())?;
    let mut settings = serde_json::to_value(FitSettings { steps, gaussians, ..FitSettings::default() })?;
    if let Some(json) = arguments.next() {
        merge(&mut settings, serde_json::from_str(&json)?);
    }
    let settings: FitSettings = serde_json::from_value(settings)?;

    let capture = posed::load(folder, &PosedOptions::default())?;
    let photo = |p: &posed::PosedPhoto| p.photo.clone();
    let of = |held_out| capture.photos.iter().filter(move |p| p.held_out == held_out).map(photo).collect::<Vec<_>>();
    let (training, test) = (of(false), of(true));
    let initial = match capture.points.is_empty() {
        true => init::random(&training, &settings)?,
        false => init::from_points(&capture.points, &settings)?,
    };
    let initial = init::bounded(initial, &training);
    let mut fit = Fit::new(training, &initial, settings)?;
    let start = Instant::now();
    let mut seconds = [0.0; 5];
    while fit.steps_done() < fit.settings().steps {
        let report = fit.step()?;
        let t = fit.timings();
        for (sum, part) in seconds.iter_mut().zip([t.forward, t.loss, t.backward, t.optimizer, t.density]) {
            *sum += part.as_secs_f64();
        }
        if report.step % 250 == 0 {
            println!(
                "{:5}  loss {:.4}  {} Gaussians  {:.2} M pairs",
                report.step,
                report.loss,
                report.gaussians,
                report.pairs as f64 / 1e6
            );
        }
    }
    let elapsed = start.elapsed().as_secs_f64();
    let ms = seconds.map(|s| 1e3 * s / fit.settings().steps as f64);
    println!(
        "ms a step: forward {:.2}, loss {:.2}, backward {:.2}, optimizer {:.2}, density {:.3}",
        ms[0], ms[1], ms[2], ms[3], ms[4]
    );
    let (mut psnr, mut ssim) = (0.0, 0.0);
    for photo in &test {
        let image = fit.render(&photo.camera)?;
        let quality = Judge::default().compare(&image, &photo.rgb, [photo.camera.height, photo.camera.width]);
        psnr += quality.psnr / test.len() as f64;
        ssim += quality.ssim.unwrap_or(f64::NAN) / test.len() as f64;
    }
    println!(
        "{} steps in {elapsed:.1} s; {} held-out photos: {psnr:.2} dB, SSIM {ssim:.4}",
        fit.steps_done(),
        test.len()
    );
    Ok(())
}

/// Lays one JSON tree over another.
fn merge(base: &mut serde_json::Value, over: serde_json::Value) {
    match (base, over) {
        (serde_json::Value::Object(base), serde_json::Value::Object(over)) => {
            over.into_iter().for_each(|(key, value)| merge(base.entry(key).or_insert(serde_json::Value::Null), value));
        }
        (base, over) => *base = over,
    }
}
