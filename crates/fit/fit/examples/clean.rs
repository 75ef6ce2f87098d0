//! Fits a capture, removes what no photo needs by several rules, and prints what that did to held-out photos:
//! `clean FOLDER [STEPS] [GAUSSIANS] [LONG SIDE]`.

use std::error::Error;
use std::time::Instant;
use weaver_data::capture::HoldOut;
use weaver_data::posed::{self, PosedOptions};
use weaver_fit::{CleaningRules, Fit, FitSettings, Judge, Photo, init, mean_color};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().ok_or("expected the folder of a capture")?;
    let mut number = |default: usize| arguments.next().map_or(Ok(default), |a| a.parse());
    let (steps, gaussians, side) = (number(1500)?, number(60_000)?, number(800)?);
    let options = PosedOptions { long_side: Some(side), hold_out: HoldOut::Every(8), ..PosedOptions::default() };
    let capture = posed::load(folder, &options)?;
    let of = |held_out| capture.photos.iter().filter(move |p| p.held_out == held_out).map(|p| p.photo.clone());
    let (training, test): (Vec<Photo>, Vec<Photo>) = (of(false).collect(), of(true).collect());
    let settings = FitSettings { steps, gaussians, background: mean_color(&training), ..FitSettings::default() };
    let initial = init::from_points(&capture.points, &settings)?;
    let mut fit = Fit::new(training.clone(), &initial, settings.clone())?;
    while fit.steps_done() < steps {
        fit.step()?;
    }
    let fitted = fit.gaussians();
    let [before, before_ssim] = judge(&mut fit, &test)?;
    println!(
        "{} Gaussians, {} photos, {} held out: {before:.3} dB, SSIM {before_ssim:.4}",
        fitted.len(),
        training.len(),
        test.len()
    );
    println!("rise    others  unseen harmful contradicted unneeded   left      dB     SSIM  seconds");
    for rise in [0.0, 0.001, 0.002, 0.005, 0.01] {
        for others in [f64::INFINITY, 1.0, 0.5, 0.2] {
            let settings = FitSettings { gaussians: fitted.len(), ..settings.clone() };
            let mut fit = Fit::new(training.clone(), &fitted, settings)?;
            let start = Instant::now();
            let cleaned = fit.clean(&CleaningRules { rise, others })?;
            let seconds = start.elapsed().as_secs_f64();
            let [psnr, ssim] = judge(&mut fit, &test)?;
            println!(
                "{rise:<7} {others:<6} {:7} {:7} {:12} {:8} {:6.3} {:+7.3} {:+8.4} {seconds:8.1}",
                cleaned.unseen,
                cleaned.harmful,
                cleaned.contradicted,
                cleaned.unneeded,
                1.0 - cleaned.count() as f64 / fitted.len() as f64,
                psnr - before,
                ssim - before_ssim
            );
        }
    }
    Ok(())
}

/// Mean PSNR and SSIM of photos.
fn judge(fit: &mut Fit, photos: &[Photo]) -> Result<[f64; 2], Box<dyn Error>> {
    let mut sums = [0.0; 2];
    for photo in photos {
        let image = fit.render(&photo.camera)?;
        let quality = Judge::default().compare_inside(&image, &photo.rgb, photo.size(), photo.mask.as_deref());
        sums[0] += quality.psnr / photos.len() as f64;
        sums[1] += quality.ssim.unwrap_or(f64::NAN) / photos.len() as f64;
    }
    Ok(sums)
}
