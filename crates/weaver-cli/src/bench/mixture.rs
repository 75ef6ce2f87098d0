//! `splatweaver bench mixture`.

use super::workload::Workload;
use super::{median, memory};
use crate::Console;
use crate::arguments::{BenchMixture, Passes};
use crate::failure::Failure;
use crate::progress::Progress;
use serde_json::json;
use std::ops::Range;
use std::time::Instant;
use weaver_geometry::sh;
use weaver_kernels::random::Stream;
use weaver_scene::{CameraRows, Color, Features, GaussianSlices, Groups};
use weaver_splat::{Images, RasterSettings, Workspace, rasterize};

/// Numbers that a router draws of each Gaussian.
const CARRIED: usize = 3;

pub fn run(arguments: &BenchMixture, console: &mut Console) -> Result<(), Failure> {
    if !(arguments.keep > 0.0 && arguments.keep <= 1.0) {
        return Err(Failure::Usage(format!("--keep: expected above 0, at most 1, found {}", arguments.keep)));
    }
    let experts = usize::from(arguments.experts);
    let mut scene = Scene::new(Workload::synthetic(arguments.synthetic, false), experts);
    if arguments.keep < 1.0 {
        scene = scene.kept(arguments.keep)?;
    }
    let ways: Vec<Passes> = match arguments.only {
        Some(only) => vec![only],
        None => vec![Passes::One, Passes::Each, Passes::Apart],
    };
    let mut frames: Vec<Frame> = ways.iter().map(|way| Frame::new(&scene, *way)).collect();
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
        return Err(Failure::message("the ways of drawing a mixture differ in their pictures"));
    }
    let pairs = frames.first().map_or(0, |frame| frame.pairs);
    console.print(&match arguments.json {
        true => serde_json::to_string_pretty(&figures(&scene, &found, pairs))?,
        false => table(&scene, &found, pairs),
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

    /// The Gaussians that the pictures have most of.
    fn kept(self, share: f64) -> Result<Self, Failure> {
        let mut frame = Frame::new(&self, Passes::One);
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

    /// The Gaussians of an expert, or all of them in groups.
    fn slices(&self, expert: Option<usize>, colors: bool, carried: bool) -> GaussianSlices<'_, f32> {
        let rows = match expert {
            Some(expert) => {
                let before = |k: usize| self.owners.partition_point(|owner| (*owner as usize) < k);
                before(expert)..before(expert + 1)
            }
            None => 0..self.owners.len(),
        };
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

fn gathered(values: &[f32], width: usize, rows: &[usize]) -> Vec<f32> {
    rows.iter().flat_map(|row| &values[row * width..][..width]).copied().collect()
}

/// A way of drawing, and all memory that it takes.
struct Frame {
    passes: Passes,
    workspaces: Vec<Workspace<f32>>,
    /// `[K, H, W, 3]`
    images: Vec<f32>,
    /// `[K, H, W]`
    alphas: Vec<f32>,
    /// `[K, H, W, CARRIED]`
    maps: Vec<f32>,
    /// Gaussians over pixels that they add to.
    pairs: u64,
}

impl Frame {
    fn new(scene: &Scene, passes: Passes) -> Self {
        let pictures = scene.experts * scene.pixels();
        let workspaces = match passes {
            Passes::One => 1,
            Passes::Each | Passes::Apart => scene.experts,
        };
        Self {
            passes,
            workspaces: (0..workspaces).map(|_| Workspace::new()).collect(),
            images: vec![0.0; 3 * pictures],
            alphas: vec![0.0; pictures],
            maps: vec![0.0; CARRIED * pictures],
            pairs: 0,
        }
    }

    /// Draws everything once; milliseconds.
    fn draw(&mut self, scene: &Scene) -> Result<f64, Failure> {
        let pixels = scene.pixels();
        let cameras = scene.camera.as_slices(&[0.0; 3]);
        let settings = RasterSettings::default();
        let start = Instant::now();
        self.pairs = 0;
        if self.passes == Passes::One {
            let images = Images {
                image: &mut self.images,
                alpha: &mut self.alphas,
                depth: None,
                features: Some(&mut self.maps),
            };
            let gaussians = scene.slices(None, true, true);
            self.pairs = rasterize(&gaussians, &cameras, &settings, &mut self.workspaces[0], images)?.pairs;
            return Ok(1e3 * start.elapsed().as_secs_f64());
        }
        let pictures = self.images.chunks_mut(3 * pixels).zip(self.alphas.chunks_mut(pixels));
        let pictures = pictures.zip(self.maps.chunks_mut(CARRIED * pixels)).zip(&mut self.workspaces);
        for (expert, (((image, alpha), maps), workspace)) in pictures.enumerate() {
            if self.passes == Passes::Each {
                let images = Images { image, alpha, depth: None, features: Some(maps) };
                let gaussians = scene.slices(Some(expert), true, true);
                self.pairs += rasterize(&gaussians, &cameras, &settings, workspace, images)?.pairs;
                continue;
            }
            let images = Images { image, alpha: &mut *alpha, depth: None, features: None };
            let gaussians = scene.slices(Some(expert), true, false);
            self.pairs += rasterize(&gaussians, &cameras, &settings, workspace, images)?.pairs;
            let images = Images { image: &mut [], alpha, depth: None, features: Some(maps) };
            rasterize(&scene.slices(Some(expert), false, true), &cameras, &settings, workspace, images)?;
        }
        Ok(1e3 * start.elapsed().as_secs_f64())
    }

    /// Whether both hold the same pictures, to the bit.
    fn same_as(&self, other: &Self) -> bool {
        let bits = |values: &[f32]| values.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        let all = |frame: &Self| [&frame.images, &frame.alphas, &frame.maps].map(|values| bits(values));
        all(self) == all(other)
    }
}

fn name(passes: Passes) -> &'static str {
    match passes {
        Passes::One => "one pass",
        Passes::Each => "a pass for each expert",
        Passes::Apart => "two passes for each expert",
    }
}

fn figures(scene: &Scene, found: &[(Passes, f64)], pairs: u64) -> serde_json::Value {
    let ways = found.iter().map(|(passes, ms)| json!({"passes": name(*passes), "ms": ms, "per_second": 1e3 / ms}));
    json!({
        "n": scene.owners.len(),
        "experts": scene.experts,
        "width": scene.camera.width,
        "height": scene.camera.height,
        "pairs": pairs,
        "ways": ways.collect::<Vec<_>>(),
        "threads": rayon::current_num_threads(),
        "peak_rss_mb": memory::peak_mb(),
    })
}

fn table(scene: &Scene, found: &[(Passes, f64)], pairs: u64) -> String {
    let (n, experts) = (scene.owners.len(), scene.experts);
    let CameraRows { width, height, .. } = scene.camera;
    let threads = rayon::current_num_threads();
    let mut text = format!(
        "{n} Gaussians of {experts} experts, {width}x{height} pixels, {threads} threads\n\n{:<28}{:>10}{:>12}{:>10}\n",
        "", "ms", "frames/s", "times"
    );
    let first = found.first().map_or(f64::NAN, |(_, ms)| *ms);
    for (passes, ms) in found {
        text += &format!("{:<28}{ms:>10.2}{:>12.2}{:>10.2}\n", name(*passes), 1e3 / ms, ms / first);
    }
    text += &format!("\nthe same pictures, to the bit; pairs composited {:.2} M", pairs as f64 / 1e6);
    if let Some(mb) = memory::peak_mb() {
        text += &format!("\npeak memory {mb:.0} MB, inputs and all ways included");
    }
    text
}
