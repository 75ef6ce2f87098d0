//! `splatweaver bench raster`.

use super::workload::Workload;
use super::{dump, median, memory};
use crate::Console;
use crate::arguments::BenchRaster;
use crate::failure::Failure;
use crate::progress::Progress;
use serde_json::json;
use std::time::{Duration, Instant};
use weaver_kernels::peak;
use weaver_splat::{
    Cotangents, Gradients, Images, RasterSettings, RasterStats, Target, Timings, Workspace, rasterize,
    rasterize_backward,
};

/// About as many operations as compositing one Gaussian at one pixel takes in forward: the exponent, its exponential, the
/// comparisons, the blending of three colors.
const OPERATIONS: f64 = 20.0;

pub fn run(arguments: &BenchRaster, console: &mut Console) -> Result<(), Failure> {
    let backward = !arguments.forward_only;
    let workload = match (&arguments.workload, arguments.synthetic) {
        (Some(path), _) => Workload::read(path, backward)?,
        (None, Some(scene)) => Workload::synthetic(scene, backward),
        (None, None) => return Err(Failure::Usage("expected --workload or --synthetic".into())),
    };
    let mut frame = Frame::new(&workload, arguments.dump.is_some());
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
    let report = Report { frame: &frame, samples: &samples, threads, peak_gflops, peak_rss_mb: memory::peak_mb() };
    let text = if arguments.json { serde_json::to_string_pretty(&report.json())? } else { report.table() };
    if let Some(path) = &arguments.dump {
        dump::write(path, frame)?;
    }
    console.print(&text)
}

/// A workload, and all memory that drawing it again and again takes.
pub struct Frame<'a> {
    pub workload: &'a Workload,
    settings: RasterSettings,
    workspace: Workspace<f32>,
    /// `[H, W, 3]`
    pub image: Vec<f32>,
    /// `[H, W]`
    pub alpha: Vec<f32>,
    /// `[H, W]`, where it is wanted.
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

/// Times of drawing once.
struct Sample {
    forward: Duration,
    /// Forward and backward; `None` without backward.
    whole: Option<Duration>,
    timings: Timings,
    stats: RasterStats,
}

impl<'a> Frame<'a> {
    fn new(workload: &'a Workload, with_depth: bool) -> Self {
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
            workspace: Workspace::new(),
            image: vec![0.0; 3 * pixels],
            alpha: vec![0.0; pixels],
            depth: depth.then(|| vec![0.0; pixels]),
            gradients,
        }
    }

    /// Forward, and backward where there are cotangents.
    fn draw(&mut self) -> Result<Sample, Failure> {
        let Self { workload, settings, workspace, image, alpha, depth, gradients } = self;
        let (gaussians, camera) = (workload.gaussians(), workload.camera());
        let start = Instant::now();
        let images = Images { image, alpha, depth: depth.as_deref_mut(), features: None };
        let stats = rasterize(&gaussians, &camera, settings, workspace, images)?;
        let forward = start.elapsed();
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
            rasterize_backward(&gaussians, &camera, settings, workspace, &cotangents, gradients)?;
            whole = Some(start.elapsed());
        }
        Ok(Sample { forward, whole, timings: workspace.timings(), stats })
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
    fn ms(&self, of: impl Fn(&Sample) -> Duration) -> f64 {
        median(self.samples.iter().map(|sample| of(sample).as_secs_f64() * 1e3))
    }

    /// `None` without backward.
    fn backward_ms(&self, of: impl Fn(&Sample) -> Duration) -> Option<f64> {
        self.frame.gradients.as_ref().map(|_| self.ms(of))
    }

    fn forward_backward_ms(&self) -> Option<f64> {
        self.backward_ms(|s| s.whole.unwrap_or_default())
    }

    /// Names as in JSON and in the table, and medians.
    fn stages(&self) -> [(&'static str, &'static str, Option<f64>); 4] {
        [
            ("project", "project", Some(self.ms(|s| s.timings.project))),
            ("bin", "bin and sort", Some(self.ms(|s| s.timings.bin))),
            ("composite", "composite", Some(self.ms(|s| s.timings.blend))),
            ("backward", "backward", self.backward_ms(|s| s.timings.backward)),
        ]
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
        let stages = self.stages().map(|(name, _, ms)| (name.to_string(), json!(ms)));
        json!({
            "workload": workload.name,
            "mode": self.mode(),
            "n": workload.len(),
            "width": workload.camera.width,
            "height": workload.camera.height,
            "pairs": stats.pairs,
            "evaluated": stats.evaluated,
            "forward_ms": self.ms(|s| s.forward),
            "forward_backward_ms": self.forward_backward_ms(),
            "stages_ms": serde_json::Map::from_iter(stages),
            "threads": self.threads,
            "peak_gflops": self.peak_gflops,
            "peak_rss_mb": self.peak_rss_mb,
        })
    }

    fn table(&self) -> String {
        let (workload, stats) = (self.frame.workload, self.stats());
        let colors = workload.degree().map_or("plain colors".into(), |degree| format!("SH degree {degree}"));
        let threads = if self.threads == 1 { "1 thread".into() } else { format!("{} threads", self.threads) };
        let mut text = format!(
            "{}: {} Gaussians, {colors}, {}x{} pixels, {}, {threads}\n\n{:<18}{:>10}\n",
            workload.name,
            workload.len(),
            workload.camera.width,
            workload.camera.height,
            self.mode(),
            "stage",
            "ms"
        );
        let totals =
            [("", "forward", Some(self.ms(|s| s.forward))), ("", "forward + backward", self.forward_backward_ms())];
        for (_, name, ms) in self.stages().into_iter().chain(totals) {
            if let Some(ms) = ms {
                text += &format!("{name:<18}{ms:>10.2}\n");
            }
        }
        let (pairs, lanes) = (stats.pairs as f64, stats.evaluated as f64);
        text += &format!("\npairs composited {:.2} M, lanes evaluated for them {:.2} M", pairs / 1e6, lanes / 1e6);
        if lanes > 0.0 {
            // An FMA counts as two operations.
            let floor = lanes * OPERATIONS / (self.peak_gflops / 2.0 * 1e9) * 1e3;
            text += &format!(
                "\npeak {:.0} GFLOP/s (f32 FMA, measured in this run); at the rate of its FMAs, {OPERATIONS} operations on every \
                 lane take {floor:.2} ms, {:.0} % of the time of composite",
                self.peak_gflops,
                100.0 * floor / self.ms(|s| s.timings.blend)
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
