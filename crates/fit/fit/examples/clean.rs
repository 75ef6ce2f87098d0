//! Fits a capture, removes what no photo needs by several rules, and prints what that did to held-out photos:
//! `clean FOLDER [STEPS] [GAUSSIANS] [LONG SIDE]`.

use std::error::Error;
use std::time::Instant;
use weaver_data::capture::HoldOut;
use weaver_data::posed::{self, PosedOptions};
use weaver_fit::{Cleaned, CleaningRules, Fit, FitSettings, Judge, Photo, init, mean_color};

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
    let initial = init::bounded(initial, &training);
    println!("at      rise    others  unseen harmful contradicted unneeded   left      dB     SSIM  seconds, all");
    let none = (2.0, CleaningRules { rise: 0.0, others: f64::INFINITY });
    let at = |at: f64, rise: f64, others: f64| (at, CleaningRules { rise, others });
    let tried =
        [none, at(1.0, 0.002, 0.5), at(0.8, 0.002, 0.5), at(0.8, 0.01, 0.5), at(0.8, 0.03, 0.5), at(0.8, 0.01, 9.0)];
    for (at, rules) in tried {
        let mut fit = Fit::new(training.clone(), &initial, settings.clone())?;
        let (start, mut seconds, mut cleaned, mut count) = (Instant::now(), 0.0, Cleaned::default(), 0);
        while fit.steps_done() < steps {
            fit.step()?;
            if fit.steps_done() == (at * steps as f64) as usize {
                let begun = Instant::now();
                count = fit.population().len();
                cleaned = fit.clean(&rules)?;
                seconds = begun.elapsed().as_secs_f64();
            }
        }
        let all = start.elapsed().as_secs_f64();
        let [psnr, ssim] = judge(&mut fit, &test)?;
        println!(
            "{at:<7} {:<7} {:<6} {:7} {:7} {:12} {:8} {:6.3} {psnr:7.3} {ssim:8.4} {seconds:8.1} {all:.0}",
            rules.rise,
            rules.others,
            cleaned.unseen,
            cleaned.harmful,
            cleaned.contradicted,
            cleaned.unneeded,
            1.0 - cleaned.count() as f64 / count.max(1) as f64,
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
