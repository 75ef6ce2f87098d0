//! `splatweaver image bench`.

use super::{failure, read};
use clap::Args;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;
use weaver_command::{Console, Failure, Threads};
use weaver_image::{FitSettings, Picture, Window, decode, encode, fit, metrics};
use weaver_io::{Background, Bitmap, Image};
use weaver_kernels::peak;

/// Fits pictures at several ratios and prints bytes, decibels and times, beside JPEG at equal bytes.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver image bench photo.jpg
  splatweaver image bench a.png b.png --steps 1000")]
pub struct ImageBench {
    /// The pictures
    #[arg(value_name = "PICTURE", required = true)]
    pub pictures: Vec<PathBuf>,
    /// Optimization steps
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..))]
    pub steps: u32,
    #[command(flatten)]
    pub threads: Threads,
}

const RATIOS: [f64; 4] = [200.0, 100.0, 50.0, 25.0];
/// Sides of the region whose drawing is timed.
const REGION: usize = 64;
/// Drawings that are timed, of which the fastest counts.
const DRAWINGS: usize = 5;

pub fn run(arguments: &ImageBench, console: &mut Console) -> Result<(), Failure> {
    let threads = rayon::current_num_threads();
    let peak = peak::fma_gflops_f32(threads);
    console.print(&format!(
        "{threads} threads, {peak:.0} GFLOP/s at most; JPEG is baseline, by the program's own encoder"
    ))?;
    for path in &arguments.pictures {
        let picture = read(path, console)?;
        console.print(&format!("{}: {} x {}", path.display(), picture.width(), picture.height()))?;
        console
            .print("ratio  Gaussians   bytes  bits/px     dB  MS-SSIM  JPEG dB  ms/step  decode ms/Mpx  region us")?;
        for ratio in RATIOS {
            console.print(&row(&picture, path, ratio, arguments.steps as usize)?)?;
        }
    }
    Ok(())
}

fn row(picture: &Picture, path: &Path, ratio: f64, steps: usize) -> Result<String, Failure> {
    let named = |error| failure(path, &error);
    let (width, height) = (picture.width(), picture.height());
    let mut settings = FitSettings::new(picture.gaussians_for(ratio), steps);
    settings.coded = true;
    let begin = Instant::now();
    let fitted = fit(picture, &settings, &mut |_| ControlFlow::Continue(())).map_err(named)?;
    let step = begin.elapsed().as_secs_f64() * 1e3 / steps as f64;
    let bytes = encode(&fitted, width, height).map_err(named)?;
    let (mut whole, mut part) = (f64::INFINITY, f64::INFINITY);
    let side = |length: usize| REGION.min(length);
    let region = Window {
        x: (width - side(width)) / 2,
        y: (height - side(height)) / 2,
        width: side(width),
        height: side(height),
    };
    let mut drawn = Vec::new();
    for _ in 0..DRAWINGS {
        let begin = Instant::now();
        let back = decode(&bytes).map_err(named)?.fitted;
        drawn = back.draw(width, height).map_err(named)?;
        whole = whole.min(begin.elapsed().as_secs_f64());
        let begin = Instant::now();
        back.draw_window(region).map_err(named)?;
        part = part.min(begin.elapsed().as_secs_f64());
    }
    let similar = metrics::ms_ssim(&drawn, picture.colors(), [height, width]);
    Ok(format!(
        "{ratio:>5}  {:>9}  {:>6}  {:>7.3}  {:>5.2}  {:>7}  {:>7}  {step:>7.2}  {:>13.1}  {:>9.0}",
        fitted.gaussians.len(),
        bytes.len(),
        8.0 * bytes.len() as f64 / picture.pixels() as f64,
        metrics::psnr(&drawn, picture.colors()),
        similar.map_or("-".into(), |x| format!("{x:.3}")),
        jpeg(picture, bytes.len())?.map_or("-".into(), |x| format!("{x:.2}")),
        whole * 1e9 / picture.pixels() as f64,
        part * 1e6
    ))
}

/// Decibels of the best JPEG of at most so many bytes, unless there is none.
fn jpeg(picture: &Picture, most: usize) -> Result<Option<f64>, Failure> {
    let (width, height) = (picture.width(), picture.height());
    let image = Image { width, height, pixels: picture.colors().to_vec() };
    let bitmap = Bitmap { width, height, pixels: image.to_bytes() };
    let (mut low, mut high, mut best) = (1_u8, 100_u8, None);
    while low <= high {
        let quality = low + (high - low) / 2;
        let bytes = bitmap.to_jpeg(quality)?;
        if bytes.len() <= most {
            (low, best) = (quality + 1, Some(bytes));
        } else {
            high = quality - 1;
        }
    }
    let Some(bytes) = best else { return Ok(None) };
    let back = Image::decode(&bytes, "a JPEG in memory", Background::Black)?;
    Ok(Some(metrics::psnr(&back.pixels, picture.colors())))
}
