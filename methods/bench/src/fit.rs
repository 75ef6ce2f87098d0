//! `splatweaver bench fit`.

use super::median;
use super::workload::Workload;
use crate::arguments::{BenchFit, Synthetic};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use weaver_command::device::{self, Device};
use weaver_command::{Console, Failure, Progress};
use weaver_fit::{Fit, FitRasterizer, FitSettings, Photo, StepTimings};
use weaver_geometry::sh::coefficients;
use weaver_kernels::peak;
use weaver_kernels::random::Stream;
use weaver_reconstruct::{Run, RunSettings};
use weaver_splat::{CpuRasterizer, Images, RasterSettings, Workspace, rasterize};

/// Approximate vector operations per lane of each part: of a Gaussian at a pixel forward (the exponent, its
/// exponential, the comparisons, the blending of three colors) and backward, of a pixel for the loss (seven maps under
/// eleven taps in two directions, and some forty more for each color), of a parameter for Adam.
const OPERATIONS: [f64; 4] = [20.0, 45.0, 3.0 * (7.0 * 22.0 + 40.0), 12.0];
/// Rounds of density control among the timed steps.
const ROUNDS: usize = 4;
/// Untimed steps of a synthetic scene at the beginning: they allocate and touch all memory.
const WARM: usize = 2;
/// Standard deviation of the noise that sets a synthetic photo apart from the scene's own picture, of 255.
const NOISE: f64 = 25.0;

pub fn run(arguments: &BenchFit, console: &mut Console) -> Result<(), Failure> {
    let runs = arguments.runs as usize;
    let rasterizer = match device::name(&arguments.device) {
        Some(name) => Device::open(name)?.measured().into_rasterizer(),
        None => Arc::new(CpuRasterizer),
    };
    let (mut fit, warm, name) = match &arguments.capture {
        Some(capture) => {
            let settings = settings(FitSettings::default().gaussians, 4 * runs, runs);
            (
                Run::optimization(&RunSettings::new(capture, settings), rasterizer)?,
                3 * runs,
                capture.display().to_string(),
            )
        }
        None => {
            let Synthetic { gaussians, width, height } = arguments.synthetic;
            let settings = settings(gaussians, WARM + runs, runs);
            (
                synthetic(arguments.synthetic, settings, rasterizer)?,
                WARM,
                format!("synthetic {gaussians},{width},{height}"),
            )
        }
    };
    let interval = (fit.settings().steps / fit.settings().density.rounds).max(1);
    let mut progress = Progress::new("bench", 0, warm + runs, console);
    let mut samples = Vec::with_capacity(runs);
    for done in 1..=warm + runs {
        if done == warm + 1 {
            // Drops the times of the warm-up steps.
            fit.pass_times();
        }
        let step = fit.step()?;
        let photo = fit.photo(step.photo).camera;
        let round = done % interval == 0;
        if done > warm {
            samples.push(Sample {
                timings: fit.timings(),
                round,
                gaussians: step.gaussians as f64,
                pixels: (photo.width * photo.height) as f64,
                pairs: step.pairs as f64,
            });
        }
        progress.at(done, warm + runs, || format!("{} Gaussians", step.gaussians), console);
    }
    progress.finish();
    let passes = fit.pass_times().into_iter().map(|(name, time)| (name, ms(time) / runs as f64)).collect();
    fit.fetch()?;
    let threads = rayon::current_num_threads();
    let report = Report {
        name,
        degree: fit.population().degree(),
        // Before the machine is measured, which takes memory, too.
        peak_rss_mb: weaver_io::peak_mb(),
        samples,
        passes,
        threads,
        peak_gflops: peak::fma_gflops_f32(threads),
        copy_gbs: peak::copy_gbs(threads),
    };
    console.print(&if arguments.json { serde_json::to_string_pretty(&report.json())? } else { report.table() })
}

/// All photos at their size and all harmonics from the second step on.
fn settings(gaussians: usize, steps: usize, runs: usize) -> FitSettings {
    let mut settings = FitSettings { steps, gaussians, sh_interval: 0.0, coarse_until: 0.0, ..FitSettings::default() };
    settings.density.rounds = (steps * ROUNDS / runs).max(1);
    (settings.density.from, settings.density.until) = (0.0, 1.0);
    // The rates of a run of ordinary length: a scene that flies apart is no ordinary load.
    settings.rates.power = 0.0;
    settings
}

/// A fit of a synthetic scene to its own picture with noise.
fn synthetic(scene: Synthetic, mut settings: FitSettings, rasterizer: Arc<dyn FitRasterizer>) -> Result<Fit, Failure> {
    settings.background = [0.0; 3];
    let workload = Workload::synthetic(scene, false);
    let pixels = workload.camera.width * workload.camera.height;
    let (mut image, mut alpha) = (vec![0.0; 3 * pixels], vec![0.0; pixels]);
    let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
    let cameras = workload.camera();
    rasterize(&workload.gaussians(), &cameras, &RasterSettings::default(), &mut Workspace::new(), images)?;
    let noise = Stream::new(settings.seed, 0, "bench.noise");
    let byte = |(i, x): (usize, &f32)| (255.0 * f64::from(*x) + NOISE * noise.normal::<f64>(i as u64)) as u8;
    let photo = Photo {
        name: workload.name.clone(),
        camera: cameras.to_cameras()[0],
        rgb: image.iter().enumerate().map(byte).collect(),
        mask: None,
        lens: None,
    };
    let initial = workload.gaussians.to_stored();
    Ok(Fit::with(rasterizer, settings.density.strategy(), vec![photo], &initial, settings)?)
}

/// Times and sizes of a timed step.
struct Sample {
    timings: StepTimings,
    /// True if a round of density control followed.
    round: bool,
    gaussians: f64,
    pixels: f64,
    pairs: f64,
}

/// A part of a step: its median, and the machine's least time for its bytes and its operations.
struct Part {
    name: &'static str,
    ms: f64,
    memory_ms: f64,
    arithmetic_ms: f64,
}

impl Part {
    fn least_ms(&self) -> f64 {
        self.memory_ms.max(self.arithmetic_ms)
    }
}

/// All figures of a run.
struct Report {
    name: String,
    degree: usize,
    samples: Vec<Sample>,
    /// Milliseconds a step of the passes on a device.
    passes: Vec<(&'static str, f64)>,
    threads: usize,
    peak_gflops: f64,
    copy_gbs: f64,
    peak_rss_mb: Option<f64>,
}

impl Report {
    fn median(&self, of: impl Fn(&Sample) -> f64) -> f64 {
        median(self.samples.iter().map(of))
    }

    /// Median milliseconds of a round of density control.
    fn round_ms(&self) -> f64 {
        median(self.samples.iter().filter(|sample| sample.round).map(|sample| ms(sample.timings.density)))
    }

    /// The bytes of a part are its parameters, gradients, moments and images, each read and written once.
    fn parts(&self) -> [Part; 5] {
        let (n, pixels) = (self.median(|s| s.gaussians), self.median(|s| s.pixels));
        let pairs = self.median(|s| s.pairs);
        let numbers = n * (3 + 3 + 4 + 1 + 3 * coefficients(self.degree)) as f64;
        let interval = interval() as f64;
        let [forward, backward, loss, adam] = OPERATIONS;
        let part = |name, ms, bytes: f64, operations: f64| Part {
            name,
            ms,
            memory_ms: bytes / self.copy_gbs / 1e6,
            // A fused multiply-add counts as two in the peak.
            arithmetic_ms: operations / (self.peak_gflops / 2.0) / 1e6,
        };
        let time = |of: fn(&StepTimings) -> Duration| self.median(|s| ms(of(&s.timings)));
        [
            part("forward", time(|t| t.forward), 4.0 * numbers + 16.0 * pixels, forward * pairs),
            part("loss", time(|t| t.loss), (3.0 + 12.0 + 12.0) * pixels, loss * pixels),
            part("backward", time(|t| t.backward), 8.0 * numbers + 12.0 * pixels, backward * pairs),
            part("optimizer", time(|t| t.optimizer), 28.0 * numbers, adam * numbers),
            // Opacities are read and written, scores read.
            part("density", self.round_ms() / interval, 12.0 * n / interval, 0.0),
        ]
    }

    fn json(&self) -> Value {
        let part = |part: &Part| {
            json!({
                "name": part.name,
                "ms": part.ms,
                "memory_ms": part.memory_ms,
                "arithmetic_ms": part.arithmetic_ms,
                "fraction_of_peak": part.least_ms() / part.ms,
            })
        };
        let parts = self.parts();
        json!({
            "scene": self.name,
            "n": self.median(|s| s.gaussians),
            "pixels": self.median(|s| s.pixels),
            "pairs": self.median(|s| s.pairs),
            "step_ms": parts.iter().map(|part| part.ms).sum::<f64>(),
            "parts": parts.iter().map(part).collect::<Value>(),
            "density_round_ms": self.round_ms(),
            "passes_ms": self.passes.iter().copied().collect::<BTreeMap<_, _>>(),
            "threads": self.threads,
            "peak_gflops": self.peak_gflops,
            "copy_gbs": self.copy_gbs,
            "peak_rss_mb": self.peak_rss_mb,
        })
    }

    fn table(&self) -> String {
        let threads = if self.threads == 1 { "1 thread".into() } else { format!("{} threads", self.threads) };
        let mut text = format!(
            "{}: {} Gaussians, SH degree {}, {} pixels, {threads}\n\n{:<12}{:>10}{:>12}{:>12}{:>10}\n",
            self.name,
            self.median(|s| s.gaussians),
            self.degree,
            self.median(|s| s.pixels),
            "part",
            "ms a step",
            "memory, ms",
            "FMAs, ms",
            "of peak"
        );
        let parts = self.parts();
        for part in &parts {
            let Part { name, ms, memory_ms, arithmetic_ms } = part;
            let percent = 100.0 * part.least_ms() / ms;
            text += &format!("{name:<12}{ms:>10.3}{memory_ms:>12.3}{arithmetic_ms:>12.3}{percent:>8.0} %\n");
        }
        let total = parts.iter().map(|part| part.ms).sum::<f64>();
        let least = parts.iter().map(Part::least_ms).sum::<f64>();
        text += &format!(
            "{:<12}{total:>10.3}{:>24}{:>8.0} %\n\nMedians. Memory and FMAs: what the bytes of parameters, gradients and images, \
             each read and written once, take at {:.1} GB/s,\nand the operations at the FMAs of {:.0} GFLOP/s, both measured in \
             this run. Pairs composited: {:.2} M.\nA round of density control takes {:.2} ms and is due every {} steps.",
            "step",
            "",
            100.0 * least / total,
            self.copy_gbs,
            self.peak_gflops,
            self.median(|s| s.pairs) / 1e6,
            self.round_ms(),
            interval()
        );
        for (name, ms) in &self.passes {
            text += &format!("\n{name:<18}{ms:>10.3} ms a step on the device");
        }
        if let Some(mb) = self.peak_rss_mb {
            text += &format!("\nPeak memory {mb:.0} MB.");
        }
        text
    }
}

/// Steps between two rounds of density control, in a run of usual length.
fn interval() -> usize {
    let settings = FitSettings::default();
    settings.steps / settings.density.rounds
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}
