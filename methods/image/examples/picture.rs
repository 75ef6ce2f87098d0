//! A photo as Gaussians:
//! `cargo run --release -p weaver-image --example picture -- PHOTO OUT.png [RATIO] [STEPS]
//! [published] [coarse] [whole]`.
//!
//! Fits the middle 512 x 512 pixels, or the whole, prints decibels on the way, and writes the photo beside the drawing.

use std::error::Error;
use std::ops::ControlFlow;
use weaver_image::{FitSettings, Picture, fit, metrics};
use weaver_io::{Background, Image};

const SIDE: usize = 512;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (words, values): (Vec<&String>, Vec<&String>) =
        arguments.iter().partition(|word| ["published", "coarse", "whole"].contains(&word.as_str()));
    let [path, out, rest @ ..] = &values[..] else {
        return Err("expected PHOTO OUT.png [RATIO] [STEPS] [published] [coarse] [whole]".into());
    };
    let number = |i: usize, default: usize| rest.get(i).map_or(Ok(default), |word| word.parse());
    let (ratio, steps) = (number(0, 50)?, number(1, 300)?);
    let photo = Image::read(path, Background::Black)?;
    let given = |name: &str| words.iter().any(|word| *word == name);
    let most = if given("whole") { usize::MAX } else { SIDE };
    let [width, height] = [photo.width, photo.height].map(|side| side.min(most));
    let mut photo = photo.crop((photo.width - width) / 2, (photo.height - height) / 2, width, height);
    let picture = Picture::new(width, height, std::mem::take(&mut photo.pixels))?;
    let count = picture.gaussians_for(ratio as f64);
    let mut settings = FitSettings::new(count, steps);
    if given("published") {
        settings = FitSettings::published(count, steps);
    }
    settings.coarse = given("coarse");
    let begin = std::time::Instant::now();
    let fitted = fit(&picture, &settings, &mut |progress| {
        if progress.step % (steps / 10).max(1) == 1 {
            println!("step {:6}  {:6} Gaussians  loss {:.6}", progress.step, progress.gaussians, progress.loss);
        }
        ControlFlow::Continue(())
    })?;
    let seconds = begin.elapsed().as_secs_f64();
    // Read before the metrics, which take more memory.
    let memory = weaver_io::peak_mb().map_or(String::new(), |mb| format!(", at most {mb:.0} MB"));
    let drawn = fitted.draw(width, height)?;
    let decibels = metrics::psnr(&drawn, picture.colors());
    let similar = metrics::ms_ssim(&drawn, picture.colors(), [height, width]);
    let similar = similar.map_or("none".to_string(), |x| format!("{x:.3}"));
    println!(
        "{} Gaussians, {steps} steps: {decibels:.2} dB, MS-SSIM {similar}, {seconds:.1} s{memory}",
        fitted.gaussians.len()
    );
    photo.pixels = picture.colors().to_vec();
    let drawn = Image { width, height, pixels: drawn };
    Image::mosaic(&[&photo, &drawn]).write_png(out)?;
    Ok(())
}
