//! Milliseconds of the parts of a step of mapping:
//! `cargo run --release -p weaver-lidar --example steps [ROWS COLUMNS DENSITY]`.
//!
//! The scan is of a hall of 40 x 20 x 8 m with all pixels filled.

use std::time::Instant;
use weaver_geometry::Pose;
use weaver_lidar::{Frame, MapSettings, Mapper, Scan, SurfelCamera};
use weaver_surfel::{Limits, RangeCotangents, RangeImages, Sight, SurfelWorkspace, Surfels};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let numbers: Vec<f64> = std::env::args().skip(1).map(|x| x.parse()).collect::<Result<_, _>>()?;
    let [rows, columns, density] = *numbers.first_chunk().unwrap_or(&[64.0, 1024.0, 0.3]);
    let camera = SurfelCamera::spherical([columns as usize, rows as usize], [-0.4363, 0.0524]);
    let points = (0..camera.pixels()).map(|i| {
        let d = camera.pixel_ray(i % camera.width, i / camera.width).to_array();
        let to = |d: f64, half: f64| (half / d).abs();
        let r = to(d[0], 20.0).min(to(d[1], 10.0)).min(to(d[2], if d[2] < 0.0 { 1.8 } else { 6.2 }));
        d.map(|d| (r * d) as f32)
    });
    let frame = Frame::new(&Scan::new(points.collect()), &camera, "hall")?.with_normals();
    for iterations in [0, 199] {
        let mut mapper = Mapper::new(&camera, MapSettings { iterations, density, ..MapSettings::default() })?;
        let begun = Instant::now();
        let report = mapper.add(0, frame.clone(), Pose::IDENTITY)?;
        println!(
            "keyframe of {} steps: {:.2} s, {} surfels",
            iterations + 1,
            begun.elapsed().as_secs_f64(),
            report.surfels
        );
        let (surfels, poses) = (mapper.surfels().clone(), [Pose::IDENTITY]);
        let sight = Sight { surfels: surfels.slices(), camera: &camera, poses: &poses, limits: Limits::default() };
        let (mut workspace, mut images, mut gradients) =
            (SurfelWorkspace::new(), RangeImages::default(), Surfels::default());
        let mut best = [f64::INFINITY; 2];
        for _ in 0..10 {
            let begun = Instant::now();
            workspace.draw(&sight, &mut images)?;
            best[0] = best[0].min(begun.elapsed().as_secs_f64());
            let begun = Instant::now();
            let (range, normal) = (Some(&images.opacity[..]), Some(&images.normal[..]));
            workspace.backward(&sight, &RangeCotangents { range, opacity: range, normal }, &mut gradients, None);
            best[1] = best[1].min(begun.elapsed().as_secs_f64());
        }
        let [pairs, evaluated] = workspace.work();
        let [draw, back] = best.map(|s| 1e3 * s);
        println!("  draw {draw:.1} ms, backward {back:.1} ms; {pairs} pairs, {evaluated} looked at");
    }
    Ok(())
}
