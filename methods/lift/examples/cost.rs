//! Cost of lifting: time and memory for a large scene, beside the bytes to be moved and the products to be added.
//!
//! `cost [GAUSSIANS] [CHANNELS] [VIEWS] [SOLVER ...]`, solvers of `row-sum`, `squared` and `exact` (three passes).

use std::ops::Range;
use std::time::Instant;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_kernels::random::Stream;
use weaver_kernels::{parallel, peak};
use weaver_lift::{LiftError, LiftOptions, Observations, Operator, Raster, Solver, lift};
use weaver_scene::{ActivatedGaussians, CameraRows, Color, GaussianSlices};
use weaver_splat::{Images, RasterSettings, Workspace, rasterize};

const SIZE: [usize; 2] = [640, 480];
/// Channels at a time.
const BLOCK: usize = 64;
/// Bytes of an `f32`.
const NUMBER: f64 = 4.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let argument = |at: usize, other: usize| std::env::args().nth(at).map_or(Ok(other), |text| text.parse());
    let (splats, channels, views) = (argument(1, 1_000_000)?, argument(2, 64)?, argument(3, 2)?);
    let solvers: Vec<String> = std::env::args().skip(4).collect();
    let scene = scene(splats);
    let cameras: Vec<Camera> = (0..views).map(|view| camera(0.05 * view as f64)).collect();
    let mut raster = Raster::new(scene.as_slices(), &cameras, RasterSettings::default());
    let pixels = SIZE[0] * SIZE[1];
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let (copied, multiplied) = (1e9 * peak::copy_gbs(threads), 1e9 * peak::fma_gflops_f32(threads));
    let pairs = pairs(&scene, &cameras[0])?;
    println!(
        "{splats} Gaussians, {views} views of {} x {}, {channels} channels, {BLOCK} at a time; {pairs:.3e} pairs in the first view",
        SIZE[0], SIZE[1]
    );
    println!(
        "{threads} threads: copying {:.1} GB/s, {:.0} GFLOP/s of products and sums",
        copied / 1e9,
        multiplied / 1e9
    );

    let mut seen = vec![0.0; splats];
    raster.adjoint(0, &vec![1.0; pixels], 1, &mut seen)?;
    let visible = seen.iter().filter(|d| **d > 0.0).count();
    println!("{visible} Gaussians seen by it; memory before lifting: {}", memory());
    for (name, solver, draws) in [
        ("row-sum", Solver::RowSum, 0.0),
        ("squared", Solver::Squared, 0.0),
        // The first pass does not draw.
        ("exact, 3 passes", Solver::exact(3), 2.0),
    ] {
        if !solvers.is_empty() && !solvers.iter().any(|asked| name.starts_with(asked.as_str())) {
            continue;
        }
        let options = LiftOptions { block: BLOCK, ..LiftOptions::with(solver) };
        let passes = solver.passes() as f64;
        let mut marks = Vec::new();
        lift(&mut raster, &mut Waves::new(channels), &options, &mut || marks.push((Instant::now(), processor())))?;
        // A pass over a single channel comes first and finds the seen Gaussians.
        let ((start, before), (end, after)) = (marks[views - 1], marks[marks.len() - 1]);
        let (elapsed, used) = ((end - start).as_secs_f64(), after - before);
        let passed = passes * views as f64;
        // Features of seen Gaussians are read and written in sums, read in drawing; pixels are written and read.
        let gathers = passes * (2.0 * visible as f64 + 2.0 * pixels as f64);
        let bytes =
            NUMBER * channels as f64 * views as f64 * (gathers + draws * (visible as f64 + 2.0 * pixels as f64));
        let operations = 2.0 * pairs * channels as f64 * views as f64 * (passes + draws);
        let busy = used / threads as f64;
        println!(
            "{name}: {elapsed:.1} s, {used:.1} s of processors; {:.2} s of processors a view and pass of all channels",
            used / passed
        );
        println!(
            "  {:.2} GB/s and {:.1} GFLOP/s of busy processors; at least {:.2} s by bytes, {:.2} s by operations: {:.0} % of what was used",
            bytes / busy / 1e9,
            operations / busy / 1e9,
            bytes / copied,
            operations / multiplied,
            100.0 * (bytes / copied).max(operations / multiplied) / busy
        );
        println!("  memory: {}", memory());
    }
    Ok(())
}

/// Features without memory and nearly without time: a saw over pixels and channels.
struct Waves {
    /// The saw, as long as its period and the channels.
    saw: Vec<f32>,
    channels: usize,
}

impl Waves {
    const PERIOD: usize = 256;

    fn new(channels: usize) -> Self {
        let saw = (0..Self::PERIOD + channels).map(|i| (i % Self::PERIOD) as f32 / Self::PERIOD as f32).collect();
        Self { saw, channels }
    }
}

impl Observations<f32> for Waves {
    fn channels(&self) -> usize {
        self.channels
    }

    fn factors(&mut self, _view: usize, factors: &mut [f32]) -> Result<(), LiftError> {
        factors.fill(1.0);
        Ok(())
    }

    fn read(&mut self, view: usize, channels: Range<usize>, out: &mut [f32]) -> Result<(), LiftError> {
        let width = channels.len();
        parallel::for_chunks(out, 1024 * width, |chunk, rows| {
            for (i, row) in rows.chunks_exact_mut(width).enumerate() {
                let phase = (view + chunk * 1024 + i) % Self::PERIOD;
                row.copy_from_slice(&self.saw[phase..][channels.clone()]);
            }
        });
        Ok(())
    }
}

/// Gaussians in a ball, about as large as a pixel or two.
fn scene(splats: usize) -> ActivatedGaussians {
    let stream = Stream::new(1, 0, "lift.cost");
    let normal = |i: usize| stream.normal::<f32>(i as u64);
    ActivatedGaussians {
        means: (0..3 * splats).map(normal).collect(),
        scales: (0..3 * splats).map(|i| 0.006 * (0.5 * normal(3 * splats + i)).exp()).collect(),
        quats: [1.0, 0.0, 0.0, 0.0].repeat(splats),
        opacities: (0..splats).map(|i| 0.05 + 0.9 * stream.fork(1).uniform::<f32>(i as u64)).collect(),
        sh: vec![0.0; 3 * splats],
        degree: 0,
    }
}

/// A camera before the ball.
fn camera(turn: f64) -> Camera {
    let pose = Pose::new(DMat3::from_rotation_y(turn), DVec3::new(0.0, 0.0, 4.0));
    let intrinsics = Intrinsics { fx: 520.0, fy: 520.0, cx: 320.0, cy: 240.0 };
    Camera { pose, intrinsics, width: SIZE[0], height: SIZE[1] }
}

/// Pairs of a Gaussian and a pixel of its footprint in a view.
fn pairs(scene: &ActivatedGaussians, camera: &Camera) -> Result<f64, LiftError> {
    let mut alpha = vec![0.0; camera.width * camera.height];
    let images = Images { image: &mut [], alpha: &mut alpha, depth: None, features: None };
    let gaussians = GaussianSlices { color: Color::None, ..scene.as_slices() };
    let rows = CameraRows::new(std::slice::from_ref(camera));
    let cameras = rows.as_slices(&[0.0; 3]);
    Ok(rasterize(&gaussians, &cameras, &RasterSettings::default(), &mut Workspace::new(), images)?.pairs as f64)
}

/// Processor seconds of this process, if the system reports them: other programs do not count.
fn processor() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = text.rsplit(')').next().unwrap_or_default().split_whitespace();
    let ticks = fields.skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok());
    ticks.sum::<f64>() / 100.0
}

/// Peak memory of this process, if the system reports it.
fn memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.map_or("unknown".into(), |line| line.trim().into())
}
