//! `splatweaver bench mixture`.

use super::median;
use super::workload::Workload;
use crate::arguments::{BenchMixture, Passes};
use serde_json::json;
use std::ops::Range;
use std::time::Instant;
use weaver_command::{Console, Failure, Progress};
use weaver_geometry::sh;
use weaver_kernels::random::Stream;
use weaver_scene::{CameraRows, Color, Features, GaussianSlices, Groups};
use weaver_splat::{Cotangents, Gradients, Images, RasterSettings, Target, Workspace, rasterize, rasterize_backward};

/// Numbers that a router draws of each Gaussian.
const CARRIED: usize = 3;

pub fn run(arguments: &BenchMixture, console: &mut Console) -> Result<(), Failure> {
    if !(arguments.keep > 0.0 && arguments.keep <= 1.0) {
        return Err(Failure::Usage(format!("--keep: expected above 0, at most 1, found {}", arguments.keep)));
    }
    let experts = usize::from(arguments.parts);
    let mut scene = Scene::new(Workload::synthetic(arguments.synthetic, false), experts);
    if arguments.keep < 1.0 {
        scene = scene.kept(arguments.keep)?;
    }
    let ways: Vec<Passes> = match arguments.only {
        Some(only) => vec![only],
        None => vec![Passes::One, Passes::Each, Passes::Apart],
    };
    let mut frames: Vec<Frame> = ways.iter().map(|way| Frame::new(&scene, *way, arguments.backward)).collect();
    // An untimed run allocates and touches all memory.
    frames.iter_mut().try_for_each(|frame| frame.draw(&scene).map(|_| ()))?;
    let same = frames.windows(2).all(|pair| pair[0].same_as(&pair[1]));
    let runs = arguments.runs as usize;
    let mut times = vec![Vec::new(); ways.len()];
    let mut progress = Progress::new("bench", 0, runs, console);
    for done in 1..=runs {
        // In turns, so that all ways meet the same machine.
        for (frame, times) in frames.iter_mut().zip(&mut times) {
            times.push(frame.draw(&scene)?);
        }
        progress.at(done, runs, String::new, console);
    }
    progress.finish();
    let found: Vec<(Passes, f64)> = ways.iter().copied().zip(times.into_iter().map(median)).collect();
    if !same {
        return Err(Failure::message("the ways of drawing a mixture differ in their pictures or gradients"));
    }
    let pairs = frames.first().map_or(0, |frame| frame.pairs);
    console.print(&match arguments.json {
        true => serde_json::to_string_pretty(&figures(&scene, &found, pairs, arguments.backward))?,
        false => table(&scene, &found, pairs, arguments.backward),
    })
}

/// Gaussians, expert by expert.
struct Scene {
    means: Vec<f32>,
    quats: Vec<f32>,
    scales: Vec<f32>,
    opacities: Vec<f32>,
    colors: Vec<f32>,
    carried: Vec<f32>,
    owners: Vec<u32>,
    experts: usize,
    camera: CameraRows,
}

impl Scene {
    /// Every `experts`-th Gaussian of a workload is an expert's, with its mean color and random numbers to carry.
    fn new(workload: Workload, experts: usize) -> Self {
        let all = &workload.gaussians;
        let n = workload.len();
        let order: Vec<usize> = (0..experts).flat_map(|k| (k..n).step_by(experts)).collect();
        let part = |values: &[f32], width: usize| gathered(values, width, &order);
        let terms = sh::coefficients(all.degree);
        let of_band_0 = |i: &usize| {
            let first = 3 * terms * i;
            all.sh[first..first + 3].iter().map(|x| 0.282_094_8 * x + 0.5).collect::<Vec<_>>()
        };
        let stream = Stream::new(4, 0, "bench.carried");
        Self {
            means: part(&all.means, 3),
            quats: part(&all.quats, 4),
            scales: part(&all.scales, 3),
            opacities: part(&all.opacities, 1),
            colors: order.iter().flat_map(of_band_0).collect(),
            carried: (0..(CARRIED * n) as u64).map(|i| stream.normal(i)).collect(),
            owners: order.iter().map(|i| (i % experts) as u32).collect(),
            experts,
            camera: workload.camera,
        }
    }

    /// The Gaussians with the largest contributions to the pictures.
    fn kept(self, share: f64) -> Result<Self, Failure> {
        let mut frame = Frame::new(&self, Passes::One, false);
        frame.draw(&self)?;
        let [mut sums, mut largest] = [0, 1].map(|_| vec![0.0; self.owners.len()]);
        frame.workspaces[0].contributions(&mut sums, &mut largest)?;
        let mut order: Vec<usize> = (0..sums.len()).collect();
        order.sort_by(|a, b| sums[*b].total_cmp(&sums[*a]).then(a.cmp(b)));
        order.truncate((share * sums.len() as f64).round() as usize);
        order.sort_unstable();
        Ok(Self {
            means: gathered(&self.means, 3, &order),
            quats: gathered(&self.quats, 4, &order),
            scales: gathered(&self.scales, 3, &order),
            opacities: gathered(&self.opacities, 1, &order),
            colors: gathered(&self.colors, 3, &order),
            carried: gathered(&self.carried, CARRIED, &order),
            owners: order.iter().map(|i| self.owners[*i]).collect(),
            ..self
        })
    }

    fn pixels(&self) -> usize {
        self.camera.width * self.camera.height
    }

    /// The rows of an expert, or of all.
    fn rows(&self, expert: Option<usize>) -> Range<usize> {
        let before = |k: usize| self.owners.partition_point(|owner| (*owner as usize) < k);
        expert.map_or(0..self.owners.len(), |k| before(k)..before(k + 1))
    }

    /// The Gaussians of an expert, or all of them in groups.
    fn slices(&self, Pass { expert, colors, carried }: Pass) -> GaussianSlices<'_, f32> {
        let rows = self.rows(expert);
        GaussianSlices {
            means: part(&self.means, 3, &rows),
            quats: part(&self.quats, 4, &rows),
            scales: part(&self.scales, 3, &rows),
            opacities: part(&self.opacities, 1, &rows),
            color: if colors { Color::Plain(part(&self.colors, 3, &rows)) } else { Color::None },
            features: carried.then(|| Features { values: part(&self.carried, CARRIED, &rows), channels: CARRIED }),
            groups: expert.is_none().then_some(Groups { of: &self.owners, count: self.experts }),
        }
    }
}

fn part<'a>(values: &'a [f32], width: usize, rows: &Range<usize>) -> &'a [f32] {
    &values[rows.start * width..rows.end * width]
}

fn part_mut<'a>(values: &'a mut [f32], width: usize, rows: &Range<usize>) -> &'a mut [f32] {
    &mut values[rows.start * width..rows.end * width]
}

fn gathered(values: &[f32], width: usize, rows: &[usize]) -> Vec<f32> {
    rows.iter().flat_map(|row| &values[row * width..][..width]).copied().collect()
}

/// One drawing: of an expert or of all, of colors and of the carried features.
#[derive(Clone, Copy)]
struct Pass {
    expert: Option<usize>,
    colors: bool,
    carried: bool,
}

/// The drawings of a frame.
fn passes(way: Passes, experts: usize) -> Vec<Pass> {
    let both = |expert| Pass { expert, colors: true, carried: true };
    match way {
        Passes::One => vec![both(None)],
        Passes::Each => (0..experts).map(|k| both(Some(k))).collect(),
        Passes::Apart => {
            let parts = |k| [true, false].map(|colors| Pass { expert: Some(k), colors, carried: !colors });
            (0..experts).flat_map(parts).collect()
        }
    }
}

/// A way of drawing, and all its memory.
struct Frame {
    way: Passes,
    workspaces: Vec<Workspace<f32>>,
    /// Images `[K, H, W, 3]`, alphas `[K, H, W]`, carried features `[K, H, W, CARRIED]`.
    planes: [Vec<f32>; 3],
    /// Incoming gradients of the planes, `None` without the backward pass.
    slopes: Option<[Vec<f32>; 3]>,
    /// Gradients of means, quaternions, scales, opacities, colors and carried features, expert by expert.
    gradients: [Vec<f32>; 6],
    /// Pairs of a Gaussian and a pixel of its footprint.
    pairs: u64,
}

impl Frame {
    fn new(scene: &Scene, way: Passes, backward: bool) -> Self {
        let pictures = scene.experts * scene.pixels();
        let workspaces = if way == Passes::One { 1 } else { scene.experts };
        let sizes = [3, 1, CARRIED].map(|width| width * pictures);
        let stream = Stream::new(5, 0, "bench.slopes");
        let slopes = |part: usize| (0..sizes[part] as u64).map(|i| stream.fork(part as u64).normal(i)).collect();
        let widths = if backward { [3, 4, 3, 1, 3, CARRIED] } else { [0; 6] };
        Self {
            way,
            workspaces: (0..workspaces).map(|_| Workspace::new()).collect(),
            planes: sizes.map(|size| vec![0.0; size]),
            slopes: backward.then(|| [0, 1, 2].map(slopes)),
            gradients: widths.map(|width| vec![0.0; width * scene.owners.len()]),
            pairs: 0,
        }
    }

    /// Draws everything once; returns milliseconds.
    fn draw(&mut self, scene: &Scene) -> Result<f64, Failure> {
        let start = Instant::now();
        self.pairs = 0;
        passes(self.way, scene.experts).into_iter().try_for_each(|pass| self.pass(scene, pass))?;
        Ok(1e3 * start.elapsed().as_secs_f64())
    }

    fn pass(&mut self, scene: &Scene, pass: Pass) -> Result<(), Failure> {
        let (gaussians, cameras) = (scene.slices(pass), scene.camera.as_slices(&[0.0; 3]));
        let settings = RasterSettings::default();
        let workspace = &mut self.workspaces[pass.expert.unwrap_or(0)];
        let pixels = scene.pixels();
        let pixels = pass.expert.map_or(0..scene.experts * pixels, |k| k * pixels..(k + 1) * pixels);
        let [image, alpha, maps] = &mut self.planes;
        let images = Images {
            image: if pass.colors { part_mut(image, 3, &pixels) } else { &mut [] },
            alpha: part_mut(alpha, 1, &pixels),
            depth: None,
            features: pass.carried.then(|| part_mut(maps, CARRIED, &pixels)),
        };
        let stats = rasterize(&gaussians, &cameras, &settings, workspace, images)?;
        if pass.colors {
            self.pairs += stats.pairs;
        }
        let Some([of_image, of_alpha, of_maps]) = &self.slopes else { return Ok(()) };
        let cotangents = Cotangents {
            image: pass.colors.then(|| part(of_image, 3, &pixels)),
            alpha: pass.carried.then(|| part(of_alpha, 1, &pixels)),
            depth: None,
            features: pass.carried.then(|| part(of_maps, CARRIED, &pixels)),
        };
        let rows = scene.rows(pass.expert);
        let [means, quats, scales, opacities, colors, carried] = &mut self.gradients;
        // The second drawing of an expert adds to the gradients that both have.
        let shape = |values, width| {
            let values = part_mut(values, width, &rows);
            Some(if pass.colors { Target::write(values) } else { Target::add(values) })
        };
        let gradients = Gradients {
            means: shape(means, 3),
            quats: shape(quats, 4),
            scales: shape(scales, 3),
            opacities: shape(opacities, 1),
            colors: pass.colors.then(|| Target::write(part_mut(colors, 3, &rows))),
            features: pass.carried.then(|| Target::write(part_mut(carried, CARRIED, &rows))),
            ..Gradients::default()
        };
        rasterize_backward(&gaussians, &cameras, &settings, workspace, &cotangents, gradients)?;
        Ok(())
    }

    /// True if both hold the same pictures, to the bit, and the same gradients unless one sums two drawings.
    fn same_as(&self, other: &Self) -> bool {
        let bits = |values: &Vec<f32>| values.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        let sums = [self, other].iter().any(|frame| frame.way == Passes::Apart);
        self.planes.each_ref().map(bits) == other.planes.each_ref().map(bits)
            && (sums || self.gradients.each_ref().map(bits) == other.gradients.each_ref().map(bits))
    }
}

fn name(passes: Passes) -> &'static str {
    match passes {
        Passes::One => "one pass",
        Passes::Each => "a pass for each expert",
        Passes::Apart => "two passes for each expert",
    }
}

fn figures(scene: &Scene, found: &[(Passes, f64)], pairs: u64, backward: bool) -> serde_json::Value {
    let ways = found.iter().map(|(passes, ms)| json!({"passes": name(*passes), "ms": ms, "per_second": 1e3 / ms}));
    json!({
        "n": scene.owners.len(),
        "experts": scene.experts,
        "width": scene.camera.width,
        "height": scene.camera.height,
        "pairs": pairs,
        "backward": backward,
        "ways": ways.collect::<Vec<_>>(),
        "threads": rayon::current_num_threads(),
        "peak_rss_mb": weaver_io::peak_mb(),
    })
}

fn table(scene: &Scene, found: &[(Passes, f64)], pairs: u64, backward: bool) -> String {
    let (n, experts) = (scene.owners.len(), scene.experts);
    let CameraRows { width, height, .. } = scene.camera;
    let threads = rayon::current_num_threads();
    let what = if backward { ", with gradients" } else { "" };
    let mut text = format!(
        "{n} Gaussians of {experts} experts, {width}x{height} pixels{what}, {threads} threads\n\n{:<28}{:>10}{:>12}{:>10}\n",
        "", "ms", "frames/s", "times"
    );
    let first = found.first().map_or(f64::NAN, |(_, ms)| *ms);
    for (passes, ms) in found {
        text += &format!("{:<28}{ms:>10.2}{:>12.2}{:>10.2}\n", name(*passes), 1e3 / ms, ms / first);
    }
    text += &format!("\nthe same pictures, to the bit; pairs composited {:.2} M", pairs as f64 / 1e6);
    if let Some(mb) = weaver_io::peak_mb() {
        text += &format!("\npeak memory {mb:.0} MB, inputs and all ways included");
    }
    text
}
