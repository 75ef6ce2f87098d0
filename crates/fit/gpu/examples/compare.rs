//! A device beside the CPU: `cargo run --release -p weaver-gpu --example compare [ADAPTER [SCENE]]`.
//!
//! ADAPTER is as for `Choice`, `gpu:0` if it is left out. SCENE is `N,W,H`, so many Gaussians in a view of W x H
//! pixels, or a file of `splatweaver bench raster --workload`. Draws and differentiates it on both, and prints the
//! distance of images and gradients, wall-clock and processor time, and the time of each pass by the device's clock.

use safetensors::SafeTensors;
use std::time::Instant;
use weaver_gpu::{Choice, Context, GpuRasterizer, GpuSession};
use weaver_kernels::random::Stream;
use weaver_scene::{CameraSlices, Color, GaussianSlices, Model};
use weaver_splat::{Cotangents, Gradients, Images, RasterSettings, Session, Target, Workspace};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Draws that are timed, after one that is not.
const RUNS: usize = 3;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let adapter = arguments.first().map_or("gpu:0", String::as_str);
    let scene = match arguments.get(1).map_or("10000,320,240", String::as_str) {
        file if file.ends_with(".safetensors") => Scene::read(file)?,
        sizes => Scene::synthetic(sizes)?,
    };
    let device = GpuRasterizer::new(Context::open(&adapter.parse::<Choice>()?)?).measured();
    println!("{}", device.context().adapter());
    println!("{} Gaussians, {} x {} pixels", scene.opacities.len(), scene.width, scene.height);
    let mut session = GpuSession::new(&device);
    let on_device = scene.timed(&mut session)?;
    let on_cpu = scene.timed(&mut Workspace::new())?;
    for (name, drawn) in [("device", &on_device), ("CPU", &on_cpu)] {
        let [wall, both, processor, processor_both] = drawn.seconds.map(|seconds| 1e3 * seconds);
        println!(
            "{name}: forward {wall:.0} ms, with backward {both:.0} ms; processor time {processor:.0} and {processor_both:.0} ms"
        );
    }
    let far = on_device.image.iter().zip(&on_cpu.image).filter(|(a, b)| (*a - *b).abs() > 1e-4).count();
    println!("numbers of the image that differ by more than 1e-4: {far} of {}", on_cpu.image.len());
    for (name, (ours, theirs)) in NAMES.iter().zip(on_device.gradients.iter().zip(&on_cpu.gradients)) {
        println!("gradient of {name}: {:.1e} of its norm apart", apart(ours, theirs));
    }
    println!("pass: runs a draw, milliseconds of all of them");
    for pass in session.workspace.pass_times() {
        // One draw more than those that are timed.
        let draws = (RUNS + 1) as f64;
        println!("{:<14}{:>4}{:>10.2}", pass.name, pass.runs / (RUNS + 1), 1e3 * pass.time.as_secs_f64() / draws);
    }
    Ok(())
}

/// One view of Gaussians, and the gradient that arrives at its image.
struct Scene {
    means: Vec<f32>,
    quats: Vec<f32>,
    scales: Vec<f32>,
    opacities: Vec<f32>,
    colors: Vec<f32>,
    /// Of spherical harmonics; `None` for plain colors.
    degree: Option<usize>,
    viewmat: Vec<f32>,
    intrinsics: [f32; 4],
    background: Vec<f32>,
    width: usize,
    height: usize,
    dimage: Vec<f32>,
}

const NAMES: [&str; 6] = ["means", "quats", "scales", "opacities", "colors", "viewmat"];

/// Result and fastest times: wall-clock of forward and of both, processor time of forward and of both.
struct Drawn {
    image: Vec<f32>,
    gradients: [Vec<f32>; 6],
    seconds: [f64; 4],
}

impl Scene {
    fn read(path: &str) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|error| format!("{path}: {error}"))?;
        let file = SafeTensors::deserialize(&bytes)?;
        let floats = |key: &str| -> Result<Vec<f32>> {
            let data = file.tensor(key).map_err(|error| format!("{path}: {key}: {error}"))?.data();
            Ok(data.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect())
        };
        let [height, width, _] = *file.tensor("v_image")?.shape() else {
            return Err("v_image: expected [H, W, 3]".into());
        };
        let k = floats("K")?;
        let harmonics = file.tensor("sh").ok().map(|sh| sh.shape()[1].isqrt() - 1);
        Ok(Self {
            means: floats("means")?,
            quats: floats("quats")?,
            scales: floats("scales")?,
            opacities: floats("opacities")?,
            colors: floats(if harmonics.is_some() { "sh" } else { "colors" })?,
            degree: harmonics,
            viewmat: floats("viewmat")?,
            intrinsics: [k[0], k[4], k[2], k[5]],
            background: floats("background")?,
            width,
            height,
            dimage: floats("v_image")?,
        })
    }

    /// A view full of Gaussians: depths from 1.5 to 8, log-normal scales, spherical harmonics of degree 3, as in
    /// `splatweaver bench raster --synthetic`.
    fn synthetic(sizes: &str) -> Result<Self> {
        let sizes = sizes.split(',').map(str::parse).collect::<std::result::Result<Vec<usize>, _>>()?;
        let [n, width, height] = sizes[..] else { return Err("expected N,W,H".into()) };
        let stream = Stream::new(3, 0, "gpu.compare");
        let normal = |purpose: u64, i: usize| stream.fork(purpose).normal::<f32>(i as u64);
        let uniform = |purpose: u64, i: usize| stream.fork(purpose).uniform::<f32>(i as u64);
        let focal = 0.78 * width as f32;
        let median = 0.005 * (1e6 / n.max(1) as f32).sqrt();
        let mut means = Vec::new();
        for i in 0..n {
            let z = 1.5 + 6.5 * uniform(0, i);
            let side = |purpose: u64, pixels: usize| (1.1 * uniform(purpose, i) - 0.55) * pixels as f32 / focal * z;
            means.extend([side(1, width), side(2, height), z]);
        }
        Ok(Self {
            means,
            quats: (0..4 * n).map(|i| normal(3, i)).collect(),
            scales: (0..3 * n).map(|i| median * (0.6 * normal(4, i)).exp()).collect(),
            opacities: (0..n).map(|i| 1.0 / (1.0 + (-1.5 * normal(5, i)).exp())).collect(),
            colors: (0..48 * n).map(|i| 0.5 * normal(6, i) / (1 << (i / 3 % 16).isqrt()) as f32).collect(),
            degree: Some(3),
            viewmat: vec![1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            intrinsics: [focal, focal, width as f32 / 2.0, height as f32 / 2.0],
            background: vec![0.0; 3],
            width,
            height,
            dimage: (0..3 * width * height).map(|i| normal(7, i)).collect(),
        })
    }

    fn timed(&self, session: &mut dyn Session<f32>) -> Result<Drawn> {
        let pixels = self.width * self.height;
        let like = |values: &[f32]| vec![0.0; values.len()];
        let inputs = [&self.means, &self.quats, &self.scales, &self.opacities, &self.colors, &self.viewmat];
        let gradients = inputs.map(|values| like(values));
        let mut drawn = Drawn { image: vec![0.0; 3 * pixels], gradients, seconds: [f64::INFINITY; 4] };
        let mut alpha = vec![0.0; pixels];
        let gaussians = GaussianSlices {
            means: &self.means,
            quats: &self.quats,
            scales: &self.scales,
            opacities: &self.opacities,
            color: match self.degree {
                Some(degree) => Color::Sh { coefficients: &self.colors, degree },
                None => Color::Plain(&self.colors),
            },
            features: None,
            groups: None,
        };
        let cameras = CameraSlices {
            viewmats: &self.viewmat,
            intrinsics: &self.intrinsics,
            background: &self.background,
            width: self.width,
            height: self.height,
            model: Model::Pinhole,
        };
        let settings = RasterSettings::default();
        let cotangents = Cotangents { image: Some(&self.dimage), ..Cotangents::default() };
        for run in 0..=RUNS {
            let (start, processor) = (Instant::now(), processor_seconds());
            let images = Images { image: &mut drawn.image, alpha: &mut alpha, depth: None, features: None };
            session.forward(&gaussians, &cameras, &settings, images)?;
            let (forward, processor_forward) = (start.elapsed().as_secs_f64(), processor_seconds() - processor);
            let [means, quats, scales, opacities, colors, viewmats] =
                drawn.gradients.each_mut().map(|values| Some(Target::write(&mut values[..])));
            let targets = Gradients { means, quats, scales, opacities, colors, viewmats, ..Gradients::default() };
            session.backward(&gaussians, &cameras, &settings, &cotangents, targets)?;
            let both = [forward, start.elapsed().as_secs_f64(), processor_forward, processor_seconds() - processor];
            // The first run makes room, and a software device compiles.
            if run > 0 {
                drawn.seconds.iter_mut().zip(both).for_each(|(least, seconds)| *least = least.min(seconds));
            }
        }
        Ok(drawn)
    }
}

/// |a - b| / |b|.
fn apart(a: &[f32], b: &[f32]) -> f64 {
    let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|x| x * x).sum::<f64>().sqrt();
    let difference = norm(&mut a.iter().zip(b).map(|(a, b)| f64::from(a - b)));
    difference / norm(&mut b.iter().map(|b| f64::from(*b)))
}

/// Processor time of this program so far, a software device's included; 0 where the system does not say it in the way
/// of Linux.
fn processor_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    fields.skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / 100.0
}
