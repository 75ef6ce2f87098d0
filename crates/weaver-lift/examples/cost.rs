//! What a pass costs: some views of a large scene, one block of channels, beside the bytes that have to move.

use std::time::Instant;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_kernels::peak;
use weaver_kernels::random::Stream;
use weaver_lift::{LiftOptions, Maps, Operator, Raster, Solver, lift};
use weaver_scene::ActivatedGaussians;
use weaver_splat::RasterSettings;

const SIZE: [usize; 2] = [640, 480];
/// Bytes of an `f32`.
const NUMBER: f64 = 4.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let argument = |at: usize, other: usize| std::env::args().nth(at).map_or(Ok(other), |text| text.parse());
    let (splats, channels, views) = (argument(1, 1_000_000)?, argument(2, 64)?, argument(3, 2)?);
    let scene = scene(splats);
    let cameras: Vec<Camera> = (0..views).map(|view| camera(0.05 * view as f64)).collect();
    let mut raster = Raster::new(scene.as_slices(), &cameras, RasterSettings::default());
    let pixels = SIZE[0] * SIZE[1];
    let mut maps = Maps { views: vec![vec![0.5_f32; pixels * channels]; views], channels };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let copied = 1e9 * peak::copy_gbs(threads);
    println!(
        "{splats} Gaussians, {views} views of {} x {}, {channels} channels; copying {:.1} GB/s",
        SIZE[0],
        SIZE[1],
        copied / 1e9
    );

    let mut seen = vec![0.0; splats];
    let start = Instant::now();
    raster.adjoint(0, &vec![1.0; pixels], 1, &mut seen)?;
    let visible = seen.iter().filter(|d| **d > 0.0).count();
    println!("one view, one channel: {:.2} s; {visible} Gaussians seen", start.elapsed().as_secs_f64());
    for (name, solver, passes) in [
        ("row-sum", Solver::RowSum, 1.0),
        ("squared", Solver::Squared, 1.0),
        ("exact, 3 passes", Solver::exact(3), 3.0),
    ] {
        let mut marks = Vec::new();
        lift(&mut raster, &mut maps, &LiftOptions { block: channels, ..LiftOptions::with(solver) }, &mut || {
            marks.push(Instant::now());
        })?;
        // The first views are those of a single channel that find out what is seen.
        let seconds = (marks[marks.len() - 1] - marks[views - 1]).as_secs_f64() / (passes * views as f64);
        // Features of what is seen are read once drawn and once to be added to; pixels are written, read and compared.
        let bytes = NUMBER * channels as f64 * (3.0 * visible as f64 + 4.0 * pixels as f64);
        println!(
            "{name}: {seconds:.2} s a view and pass, {:.2} GB/s, {:.0} times the time of copying as much",
            bytes / seconds / 1e9,
            seconds * copied / bytes
        );
    }
    println!("memory: {}", memory());
    Ok(())
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

/// The most memory that this process has held, where the system tells.
fn memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.map_or("unknown".into(), |line| line.trim().into())
}
