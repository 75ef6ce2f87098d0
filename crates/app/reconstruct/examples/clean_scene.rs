//! Removes what no photo needs from the scene of a finished run by several rules, and prints what that did to held-out
//! photos: `clean_scene RUN [LONG SIDE]`. The run was made with `--keep-all --hold-out 8`.

use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;
use weaver_data::capture::HoldOut;
use weaver_data::posed::{self, PosedOptions};
use weaver_fit::{CleaningRules, Fit, FitSettings, Judge, Photo};
use weaver_reconstruct::Outcome;
use weaver_splat::RasterSettings;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let run = PathBuf::from(arguments.next().ok_or("expected the folder of a run")?);
    let side = arguments.next().map_or(Ok(800), |side| side.parse())?;
    let path = run.join("scene.ply");
    let outcome = Outcome::beside(&path).ok_or("expected a summary.json in the folder")?;
    let scene = weaver_io::read_gaussians(&path)?;
    let options = PosedOptions { long_side: Some(side), hold_out: HoldOut::Every(8), ..PosedOptions::default() };
    let capture = posed::load(&run, &options)?;
    let of = |held_out| capture.photos.iter().filter(move |p| p.held_out == held_out).map(|p| p.photo.clone());
    let (training, test): (Vec<Photo>, Vec<Photo>) = (of(false).collect(), of(true).collect());
    let exposures: Vec<_> = training.iter().map(|photo| outcome.exposure_of(&photo.name).unwrap_or_default()).collect();
    let settings = FitSettings {
        gaussians: scene.len(),
        background: outcome.background,
        exposure: true,
        ..FitSettings::default()
    };
    println!("  rise rounds pixels | unseen lone harmful contradicted unneeded   left      dB     SSIM  seconds");
    let usual = CleaningRules::default();
    let tried = [
        None,
        Some(CleaningRules { rise: 0.0, ..usual }),
        Some(usual),
        Some(CleaningRules { rounds: 1, ..usual }),
        Some(CleaningRules { pixels: usual.pixels / 2, ..usual }),
        Some(CleaningRules { pixels: usual.pixels * 4, ..usual }),
    ];
    let mut first = None;
    for rules in tried {
        let mut fit = Fit::new(training.clone(), &scene, settings.clone())?;
        fit.set_raster_settings(RasterSettings {
            antialiased: outcome.antialiased,
            near: outcome.near,
            alpha_max: outcome.alpha_max,
            ..RasterSettings::default()
        });
        fit.begin_exposures(exposures.clone().into_iter());
        let start = Instant::now();
        let cleaned = rules.map(|rules| fit.clean(&rules)).transpose()?.unwrap_or_default();
        let seconds = start.elapsed().as_secs_f64();
        let (mut psnr, mut ssim) = (0.0, 0.0);
        for photo in &test {
            let mut image = fit.render(&photo.camera)?;
            if let Some(exposure) = outcome.exposure_of(&photo.name) {
                let drawn = image.clone();
                exposure.apply(&drawn, &mut image);
            }
            let quality = Judge::default().compare_inside(&image, &photo.rgb, photo.size(), photo.mask.as_deref());
            psnr += quality.psnr / test.len() as f64;
            ssim += quality.ssim.unwrap_or(f64::NAN) / test.len() as f64;
        }
        let [first_psnr, first_ssim] = *first.get_or_insert([psnr, ssim]);
        println!(
            "{} | {:6} {:4} {:7} {:12} {:8} {:6.3} {psnr:.3} {:+7.3} {:+8.4} {seconds:8.1}",
            rules.map_or("none               ".into(), |r| format!("{:6} {:6} {:6}", r.rise, r.rounds, r.pixels >> 20)),
            cleaned.unseen,
            cleaned.lone,
            cleaned.harmful,
            cleaned.contradicted,
            cleaned.unneeded,
            fit.gaussians().len() as f64 / scene.len() as f64,
            psnr - first_psnr,
            ssim - first_ssim
        );
    }
    Ok(())
}
