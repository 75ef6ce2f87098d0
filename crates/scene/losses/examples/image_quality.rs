//! Distortions as the metrics see them: `cargo run --release -p weaver-losses --example image_quality`.
//!
//! A picture is spoilt in four ways, each until its mean squared error is the same. PSNR rates them equal; SSIM does
//! not. Writes image_quality.png (the picture, then brighter, shifted, noisy, blurred) and prints both.

use weaver_data::procedural::{ProceduralOptions, scene};
use weaver_io::Image;
use weaver_kernels::random::Stream;
use weaver_losses::metrics::{psnr, ssim};

const WIDTH: usize = 128;
const HEIGHT: usize = 96;

/// The picture as channels `[3, H, W]`.
fn channels(image: &Image) -> Vec<f32> {
    (0..3).flat_map(|c| image.pixels.iter().skip(c).step_by(3).copied()).collect()
}

/// The picture whose pixel (x, y) is a function of the pixels around it.
fn filtered(image: &Image, f: impl Fn(&dyn Fn(isize, isize) -> f32) -> f32) -> Image {
    let (w, h) = (image.width as isize, image.height as isize);
    let pixel =
        |x: isize, y: isize, c: usize| image.pixels[3 * (y.clamp(0, h - 1) * w + x.clamp(0, w - 1)) as usize + c];
    let places = (0..h).flat_map(|y| (0..w).flat_map(move |x| [(x, y, 0), (x, y, 1), (x, y, 2)]));
    let pixels = places.map(|(x, y, c)| f(&|dx, dy| pixel(x + dx, y + dy, c))).collect();
    Image { pixels, ..*image }
}

/// The picture moved toward a spoilt one, or beyond it, until the error reaches `decibels`.
fn spoilt(image: &Image, by: &Image, decibels: f64) -> Image {
    let difference = |a: &Image, b: &Image| a.pixels.iter().zip(&b.pixels).map(|(a, b)| b - a).collect::<Vec<_>>();
    let delta = difference(image, by);
    let squares: f64 = delta.iter().map(|d| f64::from(d * d)).sum::<f64>() / delta.len() as f64;
    let factor = (10_f64.powf(-0.1 * decibels) / squares).sqrt() as f32;
    // Values stay beyond [0, 1]: the metrics clamp.
    Image { pixels: image.pixels.iter().zip(&delta).map(|(p, d)| p + factor * d).collect(), ..*image }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let photo = &scene(9, &ProceduralOptions { width: WIDTH, height: HEIGHT, views: 4 }).views[0].image;
    // Less contrast, so that hardly a value leaves [0, 1].
    let photo = Image { pixels: photo.pixels.iter().map(|p| 0.2 + 0.6 * p).collect(), ..*photo };
    let noise = Stream::new(0, 0, "image_quality");
    let noisy = photo.pixels.iter().zip(0..).map(|(p, i)| p + noise.normal::<f32>(i)).collect();
    let box_blur = |at: &dyn Fn(isize, isize) -> f32| (0..25).map(|i| at(i % 5 - 2, i / 5 - 2)).sum::<f32>() / 25.0;
    let kinds = [
        ("brighter", filtered(&photo, |at| at(0, 0) + 0.1)),
        ("shifted", filtered(&photo, |at| at(-1, 0))),
        ("noisy", Image { pixels: noisy, ..photo }),
        ("blurred", filtered(&photo, box_blur)),
    ];
    let clean = channels(&photo);
    let mut pictures = vec![photo.clone()];
    for (name, kind) in &kinds {
        let picture = spoilt(&photo, kind, 22.0);
        let seen = channels(&picture);
        println!("{name:8}: {:.2} dB, SSIM {:.3}", psnr(&seen, &clean), ssim(&seen, &clean, [3, HEIGHT, WIDTH]));
        pictures.push(picture);
    }
    Image::mosaic(&pictures.iter().collect::<Vec<_>>()).write_png("image_quality.png")?;
    Ok(())
}
