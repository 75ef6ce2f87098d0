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
    let state = fit.state();
    println!("  rise others rounds | unseen lone harmful contradicted unneeded   left      dB     SSIM  seconds");
    let usual = CleaningRules::default();
    let tried = [
        None,
        Some(CleaningRules { rise: 0.0, others: f64::INFINITY, rounds: 1, ..usual }),
        Some(CleaningRules { rise: 0.0, ..usual }),
        Some(usual),
        Some(CleaningRules { rounds: 8, ..usual }),
    ];
    let mut first = None;
    for rules in tried {
        fit.restore(&state)?;
        let start = Instant::now();
        let before = fit.gaussians().len();
        let cleaned = rules.map(|rules| fit.clean(&rules)).transpose()?.unwrap_or_default();
        let seconds = start.elapsed().as_secs_f64();
        let [psnr, ssim] = judge(&mut fit, &test)?;
        let [first_psnr, first_ssim] = *first.get_or_insert([psnr, ssim]);
        println!(
            "{} | {:6} {:4} {:7} {:12} {:8} {:6.3} {psnr:.3} {:+7.3} {:+8.4} {seconds:8.1}",
            rules.map_or("none               ".into(), |r| format!("{:6} {:6} {:6}", r.rise, r.others, r.rounds)),
            cleaned.unseen,
            cleaned.lone,
            cleaned.harmful,
            cleaned.contradicted,
            cleaned.unneeded,
            1.0 - cleaned.count() as f64 / before as f64,
            psnr - first_psnr,
            ssim - first_ssim
        );
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
