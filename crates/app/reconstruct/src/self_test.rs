//! A short measurement of the machine and the program on it, for reports of faults.

use crate::demo;
use std::time::{Duration, Instant};
use weaver_io::{Background, Image, available_memory, read_text};
use weaver_kernels::random::Stream;
use weaver_kernels::{peak, simd};
use weaver_scene::{CameraSlices, Color, GaussianSlices, Model};
use weaver_splat::{Cotangents, Gradients, Images, RasterSettings, Target, Workspace, rasterize, rasterize_backward};

/// Time that each of the repeated parts is given.
const PART: Duration = Duration::from_secs(4);
/// Gaussians of the drawing, and its sides in pixels.
const GAUSSIANS: usize = 20_000;
const SIDES: [usize; 2] = [640, 480];

/// Lines about the machine and about the program on it, each with its name, for a report of a fault. Takes about ten
/// seconds, reads no file of the user, and writes none; names of the user, of folders and of the machine are not in it.
pub fn self_test() -> Vec<(&'static str, String)> {
    let (threads, level) = (rayon::current_num_threads(), simd::level());
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let memory = available_memory().map_or("unknown".into(), |bytes| format!("{:.1} GB available", bytes as f64 / 1e9));
    let measured =
        |rate: Result<f64, String>, unit| rate.map_or_else(|error| error, |rate| format!("{rate:.1} {unit}"));
    vec![
        ("system", format!("{} {}", std::env::consts::OS, std::env::consts::ARCH)),
        ("processor", processor().unwrap_or("unknown".into())),
        ("cores", format!("{cores}, {threads} threads")),
        ("instructions", format!("{level:?}")),
        ("memory", memory),
        ("arithmetic", measured(Ok(peak::fma_gflops_f32(threads)), "GFLOP/s")),
        ("copies", measured(Ok(peak::copy_gbs(threads)), "GB/s")),
        ("photos", measured(decoding(), "decoded a second")),
        ("drawings", measured(drawing(), "a second, with gradients")),
    ]
}

/// The model of the processor, where the system names it.
fn processor() -> Option<String> {
    if let Ok(named) = std::env::var("PROCESSOR_IDENTIFIER") {
        return Some(named);
    }
    let list = read_text("/proc/cpuinfo").ok()?;
    let line = list.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_string())
}

/// The rate of a repeated part.
fn rate(mut part: impl FnMut() -> Result<usize, String>) -> Result<f64, String> {
    let (start, mut done) = (Instant::now(), 0);
    while start.elapsed() < PART {
        done += part()?;
    }
    Ok(done as f64 / start.elapsed().as_secs_f64())
}

/// Photos of the demonstration, decoded on one thread.
fn decoding() -> Result<f64, String> {
    rate(|| {
        for (name, bytes) in demo::PHOTOS {
            Image::decode(bytes, name, Background::White).map_err(|error| error.to_string())?;
        }
        Ok(demo::PHOTOS.len())
    })
}

/// A cloud of Gaussians drawn and differentiated on all threads.
fn drawing() -> Result<f64, String> {
    let random = Stream::new(0, 0, "self test");
    let count = 3 * GAUSSIANS as u64;
    // A cube of sides of two units before the camera.
    let mean = |i: u64| 2.0 * random.uniform::<f32>(i) - if i % 3 == 2 { -2.0 } else { 1.0 };
    let means: Vec<f32> = (0..count).map(mean).collect();
    let colors: Vec<f32> = (count..2 * count).map(|i| random.uniform(i)).collect();
    let gaussians = GaussianSlices {
        means: &means,
        quats: &[1.0, 0.0, 0.0, 0.0].repeat(GAUSSIANS),
        scales: &vec![0.02; 3 * GAUSSIANS],
        opacities: &vec![0.5; GAUSSIANS],
        color: Color::Plain(&colors),
        features: None,
        groups: None,
    };
    let [width, height] = SIDES;
    let cameras = CameraSlices {
        viewmats: &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        intrinsics: &[500.0, 500.0, 0.5 * width as f32, 0.5 * height as f32],
        background: &[0.0; 3],
        width,
        height,
        model: Model::Pinhole,
    };
    let (settings, mut workspace) = (RasterSettings::default(), Workspace::new());
    let (mut image, mut alpha) = (vec![0.0; 3 * width * height], vec![0.0; width * height]);
    let (cotangent, mut gradient) = (vec![1e-3; 3 * width * height], vec![0.0; 3 * GAUSSIANS]);
    rate(|| {
        let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
        rasterize(&gaussians, &cameras, &settings, &mut workspace, images).map_err(|error| error.to_string())?;
        let cotangents = Cotangents { image: Some(&cotangent), ..Cotangents::default() };
        let gradients = Gradients { means: Some(Target::write(&mut gradient)), ..Gradients::default() };
        rasterize_backward(&gaussians, &cameras, &settings, &mut workspace, &cotangents, gradients)
            .map_err(|error| error.to_string())?;
        Ok(1)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Promise (options): `info --report` measures the program in ten seconds and names nothing of the user.
    #[test]
    fn every_part_of_the_report_is_measured() {
        let found = self_test();
        let rate = |name: &str| {
            let line = found.iter().find(|line| line.0 == name).map(|line| line.1.split_whitespace().next());
            line.flatten().and_then(|word| word.parse::<f64>().ok())
        };
        for name in ["arithmetic", "copies", "photos", "drawings"] {
            assert!(rate(name).is_some_and(|rate| rate > 0.0 && rate.is_finite()), "{name}: {found:?}");
        }
        let text: String = found.into_iter().map(|line| line.1).collect();
        for name in ["HOME", "USER", "HOSTNAME"].into_iter().filter_map(|name| std::env::var(name).ok()) {
            // A short name, as of a container, may be part of any word.
            assert!(name.len() < 5 || !text.contains(&name), "{name}: {text}");
        }
    }
}
