//! `splatweaver bench raster`.

use super::draws::Draws;
use super::workload::Workload;
use super::{dump, median, processor};
use crate::arguments::BenchRaster;
use serde_json::json;
use std::time::Instant;
use weaver_command::device::{self, Device};
use weaver_command::{Console, Failure, Progress};
use weaver_kernels::peak;
use weaver_splat::{Cotangents, Gradients, Images, RasterSettings, RasterStats, Target, Workspace};

/// Approximate operations for compositing one Gaussian at one pixel forward: the exponent, its exponential, the
/// comparisons, the blending of three colors.
pub const OPERATIONS: f64 = 20.0;

pub fn run(arguments: &BenchRaster, console: &mut Console) -> Result<(), Failure> {
    let backward = !arguments.forward_only;
    let workload = match (&arguments.workload, arguments.synthetic) {
        (Some(path), _) => Workload::read(path, backward)?,
        (None, Some(scene)) => Workload::synthetic(scene, backward),
        (None, None) => return Err(Failure::Usage("expected --workload or --synthetic".into())),
    };
    let draws = match device::name(&arguments.device) {
        Some(name) => Draws::Device(Box::new(Device::open(name)?.measured())),
        None => Draws::Processor(Box::new(Workspace::new())),
    };
    let mut frame = Frame::new(&workload, draws, arguments.dump.is_some());
    // An untimed run allocates and touches all memory.
    frame.draw()?;
    let threads = rayon::current_num_threads();
    let peak_gflops = peak::fma_gflops_f32(threads);
    let runs = arguments.runs as usize;
    let mut progress = Progress::new("bench", 0, runs, console);
    let mut samples = Vec::with_capacity(runs);
    for done in 1..=runs {
        samples.push(frame.draw()?);
        progress.at(done, runs, String::new, console);
    }
    progress.finish();
    let report = Report { frame: &frame, samples: &samples, threads, peak_gflops, peak_rss_mb: weaver_io::peak_mb() };
    let text = if arguments.json { serde_json::to_string_pretty(&report.json())? } else { report.table() };
    if let Some(path) = &arguments.dump {
        dump::write(path, frame)?;
    }
    console.print(&text)
}

/// A workload, and all memory for drawing it again and again.
pub struct Frame<'a> {
    pub workload: &'a Workload,
    settings: RasterSettings,
    draws: Draws,
    /// `[H, W, 3]`
    pub image: Vec<f32>,
    /// `[H, W]`
    pub alpha: Vec<f32>,
    /// `[H, W]`; `None` if depth is not drawn.
    pub depth: Option<Vec<f32>>,
    pub gradients: Option<GradientBuffers>,
}

/// Memory for the gradient of every input, in the input's shape.
#[derive(Default)]
pub struct GradientBuffers {
    pub means: Vec<f32>,
    pub quats: Vec<f32>,
    pub scales: Vec<f32>,
    pub opacities: Vec<f32>,
    pub colors: Vec<f32>,
    pub viewmat: Vec<f32>,
    /// fx, fy, cx, cy.
    pub intrinsics: [f32; 4],
    pub background: Vec<f32>,
}

/// Times of drawing once, milliseconds.
struct Sample {
    forward: Times,
    /// Forward and backward; `None` without backward.
    whole: Option<Times>,
    stages: Vec<(&'static str, f64)>,
    /// Bytes to the device and from it.
    transfers: Option<[u64; 2]>,
    stats: RasterStats,
}

/// Times of a frame, milliseconds.
#[derive(Clone, Copy)]
struct Times {
    wall: f64,
    /// Processor time of all threads; NaN if unknown.
    processor: f64,
}

/// Wall and processor time since its creation.
struct Clock {
    start: Instant,
    processor: Option<f64>,
}

impl Clock {
    fn start() -> Self {
        Self { processor: processor::seconds(), start: Instant::now() }
    }

    fn times(&self) -> Times {
        let wall = 1e3 * self.start.elapsed().as_secs_f64();
        let spent = self.processor.zip(processor::seconds()).map(|(begin, end)| 1e3 * (end - begin));
        Times { wall, processor: spent.unwrap_or(f64::NAN) }
    }
}

impl<'a> Frame<'a> {
    fn new(workload: &'a Workload, draws: Draws, with_depth: bool) -> Self {
        let pixels = workload.camera.width * workload.camera.height;
        let depth = with_depth || workload.cotangents.as_ref().is_some_and(|c| c.depth.is_some());
        let like = |values: &[f32]| vec![0.0; values.len()];
        let gradients = workload.cotangents.is_some().then(|| GradientBuffers {
            means: like(&workload.gaussians.means),
            quats: like(&workload.gaussians.quats),
            scales: like(&workload.gaussians.scales),
            opacities: like(&workload.gaussians.opacities),
            colors: like(workload.colors()),
            viewmat: like(&workload.camera.viewmats),
            intrinsics: [0.0; 4],
            background: like(&workload.background),
        });
        Self {
            workload,
            settings: RasterSettings { antialiased: workload.antialiased, ..RasterSettings::default() },
            draws,
            image: vec![0.0; 3 * pixels],
            alpha: vec![0.0; pixels],
            depth: depth.then(|| vec![0.0; pixels]),
            gradients,
        }
    }

    /// A frame that the processor draws.
    #[cfg(feature = "lidar")]
    pub fn on_the_processor(workload: &'a Workload) -> Self {
        Self::new(workload, Draws::Processor(Box::new(Workspace::new())), false)
    }

    /// Draws once on the processor: times of the stages, and the pairs.
    #[cfg(feature = "lidar")]
    pub fn timed(&mut self) -> Result<(weaver_splat::Timings, RasterStats), Failure> {
        let stats = self.draw()?.stats;
        Ok((self.draws.timings().unwrap_or_default(), stats))
    }

    /// Forward, and backward where there are cotangents.
    fn draw(&mut self) -> Result<Sample, Failure> {
        let Self { workload, settings, draws, image, alpha, depth, gradients } = self;
        let (gaussians, camera) = (workload.gaussians(), workload.camera());
        let clock = Clock::start();
        let images = Images { image, alpha, depth: depth.as_deref_mut(), features: None };
        let stats = draws.forward((&gaussians, &camera), settings, images)?;
        let forward = clock.times();
        let mut whole = None;
        if let (Some(cotangents), Some(into)) = (&workload.cotangents, gradients) {
            let cotangents = Cotangents {
                image: Some(&cotangents.image),
                alpha: Some(&cotangents.alpha),
                depth: cotangents.depth.as_deref(),
                features: None,
            };
            let gradients = Gradients {
                means: Some(Target::write(&mut into.means)),
                quats: Some(Target::write(&mut into.quats)),
                scales: Some(Target::write(&mut into.scales)),
                opacities: Some(Target::write(&mut into.opacities)),
                colors: Some(Target::write(&mut into.colors)),
                viewmats: Some(Target::write(&mut into.viewmat)),
                intrinsics: Some(Target::write(&mut into.intrinsics)),
                background: Some(Target::write(&mut into.background)),
                ..Gradients::default()
            };
            draws.backward((&gaussians, &camera), settings, &cotangents, gradients)?;
            whole = Some(clock.times());
        }
        let stages = draws.stages(whole.is_some());
        Ok(Sample { forward, whole, stages, transfers: draws.transfers(), stats })
    }
}

/// All figures of a run.
struct Report<'a> {
    frame: &'a Frame<'a>,
    samples: &'a [Sample],
    threads: usize,
    peak_gflops: f64,
    peak_rss_mb: Option<f64>,
}

impl Report<'_> {
    fn forward(&self, of: fn(Times) -> f64) -> f64 {
        median(self.samples.iter().map(|sample| of(sample.forward)))
    }

    /// Median of a time of whole frames; `None` without backward.
    fn whole(&self, of: fn(Times) -> f64) -> Option<f64> {
        self.frame.gradients.as_ref().map(|_| median(self.samples.iter().filter_map(|sample| sample.whole).map(of)))
    }

    /// Medians of the parts, by their names.
    fn stages(&self) -> Vec<(&'static str, f64)> {
        let names = self.samples.first().map_or(&[][..], |sample| &sample.stages).iter().map(|(name, _)| *name);
        let ms = |name| self.samples.iter().flat_map(|s| &s.stages).filter(move |s| s.0 == name).map(|s| s.1);
        names.map(|name| (name, median(ms(name)))).collect()
    }

    fn stage(&self, name: &str) -> f64 {
        self.stages().into_iter().find(|stage| stage.0 == name).map_or(f64::NAN, |stage| stage.1)
    }

    fn transfers(&self) -> Option<[u64; 2]> {
        self.samples.first().and_then(|sample| sample.transfers)
    }

    /// Drawing again gives the same bits.
    fn stats(&self) -> RasterStats {
        self.samples.first().map(|sample| sample.stats).unwrap_or_default()
    }

    fn mode(&self) -> &'static str {
        if self.frame.workload.antialiased { "antialiased" } else { "classic" }
    }

    fn json(&self) -> serde_json::Value {
        let (workload, stats) = (self.frame.workload, self.stats());
        let mut stages =
            serde_json::Map::from_iter(self.stages().into_iter().map(|(name, ms)| (name.into(), json!(ms))));
        let device = self.frame.draws.device();
        if device.is_none() && self.frame.gradients.is_none() {
            stages.insert("backward".into(), json!(null));
        }
        json!({
            "workload": workload.name,
            "mode": self.mode(),
            "n": workload.len(),
            "width": workload.camera.width,
            "height": workload.camera.height,
            "pairs": stats.pairs,
            "evaluated": stats.evaluated,
            "forward_ms": self.forward(|times| times.wall),
            "forward_backward_ms": self.whole(|times| times.wall),
            "processor_forward_ms": self.forward(|times| times.processor),
            "processor_forward_backward_ms": self.whole(|times| times.processor),
            "stages_ms": stages,
            "device": device.map(Device::json),
            "bytes_to_device": self.transfers().map(|[to, _]| to),
            "bytes_from_device": self.transfers().map(|[_, from]| from),
            "entries": stats.entries,
            "threads": self.threads,
            "peak_gflops": self.peak_gflops,
            "peak_rss_mb": self.peak_rss_mb,
        })
    }

    fn table(&self) -> String {
        let (workload, stats) = (self.frame.workload, self.stats());
        let colors = workload.degree().map_or("plain colors".into(), |degree| format!("SH degree {degree}"));
        let threads = if self.threads == 1 { "1 thread".into() } else { format!("{} threads", self.threads) };
        let device = self.frame.draws.device().map_or(String::new(), |device| device.title() + "\n");
        let mut text = format!(
            "{device}{}: {} Gaussians, {colors}, {}x{} pixels, {}, {threads}\n\n{:<18}{:>10}\n",
            workload.name,
            workload.len(),
            workload.camera.width,
            workload.camera.height,
            self.mode(),
            "stage",
            "ms"
        );
        for (name, ms) in self.stages() {
            let name = if name == "bin" { "bin and sort" } else { name };
            text += &format!("{name:<18}{ms:>10.2}\n");
        }
        let mut total = |name: &str, forward: f64, whole: Option<f64>| {
            text += &format!("{:<18}{forward:>10.2}\n", format!("forward{name}"));
            if let Some(whole) = whole {
                text += &format!("{:<18}{whole:>10.2}\n", format!("forward + backward{name}"));
            }
        };
        total("", self.forward(|times| times.wall), self.whole(|times| times.wall));
        let (pairs, lanes) = (stats.pairs as f64, stats.evaluated as f64);
        if let Some([to, from]) = self.transfers() {
            total(", processor", self.forward(|times| times.processor), self.whole(|times| times.processor));
            text += &format!(
                "\nentries of tiles {:.2} M; {:.1} MB to the device, {:.1} MB from it each time",
                stats.entries as f64 / 1e6,
                to as f64 / 1e6,
                from as f64 / 1e6
            );
        } else {
            text += &format!("\npairs composited {:.2} M, lanes evaluated for them {:.2} M", pairs / 1e6, lanes / 1e6);
        }
        if lanes > 0.0 {
            // An FMA counts as two operations.
            let floor = lanes * OPERATIONS / (self.peak_gflops / 2.0 * 1e9) * 1e3;
            text += &format!(
                "\npeak {:.0} GFLOP/s (f32 FMA, measured in this run); at the rate of its FMAs, {OPERATIONS} operations on every \
                 lane take {floor:.2} ms, {:.0} % of the time of composite",
                self.peak_gflops,
                100.0 * floor / self.stage("composite")
            );
        }
        if stats.rejected > 0 {
            text += &format!("\nGaussians left out, not finite or without a rotation: {}", stats.rejected);
        }
        if let Some(mb) = self.peak_rss_mb {
            text += &format!("\npeak memory {mb:.0} MB, inputs included");
        }
        text
    }
}
