//! `splatweaver bench surfels`.

use super::workload::Workload;
use super::{median, raster};
use crate::arguments::{BenchSurfels, Synthetic};
use serde_json::json;
use std::time::Instant;
use weaver_command::{Console, Failure, Progress};
use weaver_geometry::Pose;
use weaver_kernels::peak;
use weaver_lidar::{MapSettings, Odometry, Scan, SurfelCamera, TrackSettings};
use weaver_surfel::{Limits, RangeCotangents, RangeImages, Sight, SurfelWorkspace, Surfels};

/// Approximate operations for compositing one surfel at one pixel forward: the ray's direction and the turn of the
/// azimuth (10), the plane and its two coordinates (20), the exponential (10), and the blending of range, normal and
/// opacity (10).
const OPERATIONS: f64 = 50.0;
/// Walls of the hall, meters, beside the sensor when it begins, 1.8 m above the floor.
const LOW: [f64; 3] = [-20.0, -10.0, -1.8];
const HIGH: [f64; 3] = [20.0, 10.0, 6.2];
/// The sensor's way from scan to scan, meters.
const MOTION: [f64; 3] = [0.1, 0.05, 0.0];
/// Ranges that are used, meters.
const RANGE: [f64; 2] = [0.5, 60.0];
/// Optimization steps of a keyframe, as in maps.
const STEPS: usize = 200;
/// The scene of ellipsoids for comparison.
const BESIDE: Synthetic = Synthetic { gaussians: 100_000, width: 640, height: 480 };

pub fn run(arguments: &BenchSurfels, console: &mut Console) -> Result<(), Failure> {
    let [rows, columns] = arguments.size;
    let camera = SurfelCamera::spherical([columns, rows], [-0.4363, 0.0524]);
    let settings = MapSettings { iterations: STEPS - 1, density: arguments.density, ..MapSettings::default() };
    let failed = |error: weaver_lidar::Error| Failure::message(error.to_string());
    let runs = arguments.runs as usize;
    let track = TrackSettings { farthest: f64::INFINITY, least_fitness: 0.0, ..TrackSettings::default() };
    let mut odometry = Odometry::new(&camera, RANGE, settings, track, None).map_err(failed)?;
    let mut seconds = (0..=runs).map(|scan| {
        let scan = hall(&camera, MOTION.map(|x| scan as f64 * x));
        let begun = Instant::now();
        let tracked = odometry.add(&scan, "hall").map_err(failed)?;
        match tracked.lost {
            Some(lost) => Err(Failure::message(lost.to_string())),
            None => Ok(begun.elapsed().as_secs_f64()),
        }
    });
    // The first scan is the keyframe, the others are registered to it.
    let keyframe = seconds.next().expect("at least one scan")?;
    let scan = median(seconds.collect::<Result<Vec<_>, _>>()?);
    let mapped = odometry.mapper().surfels();

    let peak_gflops = peak::fma_gflops_f32(rayon::current_num_threads());
    let mut progress = Progress::new("bench", 0, 2 * runs, console);
    let flat = surfels(mapped, &camera, runs, &mut |done| progress.at(done, 2 * runs, String::new, console))?;
    let workload = Workload::synthetic(BESIDE, true);
    let solid = ellipsoids(&workload, runs, &mut |done| progress.at(runs + done, 2 * runs, String::new, console))?;
    progress.finish();
    let rows = [flat, solid];
    console.print(&match arguments.json {
        true => serde_json::to_string_pretty(&json!({
            "size": arguments.size, "density": arguments.density, "surfels": mapped.len(), "keyframe_s": keyframe, "scan_s": scan,
            "peak_gflops": peak_gflops, "threads": rayon::current_num_threads(),
            "rows": rows.iter().map(|row| row.json(peak_gflops)).collect::<Vec<_>>(),
        }))?,
        false => {
            let title = format!(
                "a hall of 40 x 20 x 8 m, {} x {} pixels, {} surfels; {} threads\n\
                 a keyframe of {STEPS} steps: {keyframe:.2} s; a scan that is registered to it: {:.1} ms, {:.1} a second\n\n",
                arguments.size[0],
                arguments.size[1],
                mapped.len(),
                rayon::current_num_threads(),
                1e3 * scan,
                scan.recip(),
            );
            let head = "                pairs, M  lanes, M  project ms   bin ms  composite ms  backward ms   ns a lane   backward  of the peak\n";
            let lines: String = rows.iter().map(|row| row.line(peak_gflops)).collect();
            format!("{title}{head}{lines}peak {peak_gflops:.0} GFLOP/s, measured in this run; an FMA is two operations")
        }
    })
}

/// Measurements of a sensor at a place in the hall, one in each pixel.
fn hall(camera: &SurfelCamera, at: [f64; 3]) -> Scan {
    let points = (0..camera.pixels()).map(|i| {
        let d = camera.pixel_ray(i % camera.width, i / camera.width).to_array();
        let to = |k: usize| (if d[k] < 0.0 { LOW[k] } else { HIGH[k] } - at[k]) / d[k];
        let range = to(0).min(to(1)).min(to(2));
        d.map(|d| (range * d) as f32)
    });
    Scan::new(points.collect())
}

/// Medians of one kind of primitive.
struct Row {
    name: &'static str,
    pairs: f64,
    lanes: f64,
    /// Milliseconds: project, bin, composite, backward.
    stages: [f64; 4],
    operations: f64,
}

impl Row {
    /// Nanoseconds for each lane that was computed, forward and backward.
    fn each(&self) -> [f64; 2] {
        [self.stages[2], self.stages[3]].map(|ms| 1e6 * ms / self.lanes)
    }

    /// Share of the peak that compositing reaches, at the rate of multiplications and additions fused in pairs.
    fn share(&self, peak_gflops: f64) -> f64 {
        self.lanes * self.operations / (peak_gflops / 2.0 * 1e9) * 1e3 / self.stages[2]
    }

    fn line(&self, peak_gflops: f64) -> String {
        let [project, bin, composite, backward] = self.stages;
        let [each, back] = self.each();
        format!(
            "{:<14}{:>10.2}{:>10.2}{project:>12.2}{bin:>9.2}{composite:>14.2}{backward:>13.2}{each:>12.3}{back:>11.3}{:>11.0} %\n",
            self.name,
            self.pairs / 1e6,
            self.lanes / 1e6,
            100.0 * self.share(peak_gflops)
        )
    }

    fn json(&self, peak_gflops: f64) -> serde_json::Value {
        let [project, bin, composite, backward] = self.stages;
        let [each, back] = self.each();
        json!({
            "primitive": self.name, "pairs": self.pairs, "evaluated": self.lanes, "fraction_of_peak": self.share(peak_gflops),
            "stages_ms": { "project": project, "bin": bin, "composite": composite, "backward": backward },
            "ns_per_lane": each, "backward_ns_per_lane": back,
        })
    }
}

fn medians(samples: &[weaver_splat::Timings]) -> [f64; 4] {
    let ms = |of: fn(&weaver_splat::Timings) -> std::time::Duration| {
        median(samples.iter().map(|times| 1e3 * of(times).as_secs_f64()))
    };
    [ms(|t| t.project), ms(|t| t.bin), ms(|t| t.blend), ms(|t| t.backward)]
}

fn surfels(
    surfels: &Surfels<f32>,
    camera: &SurfelCamera,
    runs: usize,
    done: &mut dyn FnMut(usize),
) -> Result<Row, Failure> {
    let poses = [Pose::IDENTITY];
    let sight = Sight { surfels: surfels.slices(), camera, poses: &poses, limits: Limits::default() };
    let (mut workspace, mut images) = (SurfelWorkspace::new(), RangeImages::default());
    let mut gradients = Surfels::default();
    let mut samples = Vec::with_capacity(runs);
    // An untimed run allocates and touches all memory.
    for run in 0..=runs {
        workspace.draw(&sight, &mut images).map_err(|error| Failure::message(error.to_string()))?;
        let RangeImages { range, opacity, normal } = &images;
        let cotangents = RangeCotangents { range: Some(range), opacity: Some(opacity), normal: Some(normal) };
        workspace.backward(&sight, &cotangents, &mut gradients, None);
        if run > 0 {
            samples.push(workspace.timings());
            done(run);
        }
    }
    let [pairs, lanes] = workspace.work().map(|n| n as f64);
    Ok(Row { name: "surfels", pairs, lanes, stages: medians(&samples), operations: OPERATIONS })
}

fn ellipsoids(workload: &Workload, runs: usize, done: &mut dyn FnMut(usize)) -> Result<Row, Failure> {
    let mut frame = raster::Frame::on_the_processor(workload);
    let mut samples = Vec::with_capacity(runs);
    let mut stats = frame.timed()?.1;
    for run in 1..=runs {
        let (times, drawn) = frame.timed()?;
        samples.push(times);
        stats = drawn;
        done(run);
    }
    let [pairs, lanes] = [stats.pairs, stats.evaluated].map(|n| n as f64);
    Ok(Row { name: "ellipsoids", pairs, lanes, stages: medians(&samples), operations: raster::OPERATIONS })
}
