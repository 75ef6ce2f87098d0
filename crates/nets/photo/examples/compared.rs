//! The untrained network on a drawn scene: what comparison finds, and the time of each part.
//!
//! `cargo run --release -p weaver-photo --example compared`

use std::time::Instant;
use weaver_data::View;
use weaver_geometry::Camera;
use weaver_inference::{Density, Photos, planar};
use weaver_kernels::random::Stream;
use weaver_photo::{Comparison, PhotoConfig, PhotoPredictor};
use weaver_procedural::{ProceduralOptions, varied_scene};
use weaver_router::AllocationKind;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let options = ProceduralOptions { width: 128, height: 96, views: 4 };
    let mut start = Instant::now();
    let mut done = |name: &str| {
        println!("{name}: {:.2} s", start.elapsed().as_secs_f64());
        start = Instant::now();
    };
    for seed in 0..4 {
        let scene = varied_scene(seed, &options);
        done("scene");
        let planes = planar(scene.views.iter().map(|view| &view.image));
        let photos = Photos { planes: &planes, inside: None, height: 96, width: 128 };
        let first = scene.views[0].camera.pose;
        let relative = |view: &View| Camera { pose: view.camera.pose.relative_to(&first), ..view.camera };
        let cameras: Vec<Camera> = scene.views.iter().map(relative).collect();
        let truth: Vec<f32> = scene.views.iter().flat_map(|view| view.depth.clone().unwrap_or_default()).collect();
        let real = Comparison::of(photos, &cameras, &scene.points_seen(&[0, 1, 2, 3], 1.0))?;
        done("comparison");
        let drawn = Comparison::simulated(photos, &cameras, &truth, Stream::new(seed, 0, "example"));
        done("simulated");
        for (name, found) in [("comparison", &real), ("simulated", &drawn)] {
            let mut errors: Vec<f32> = found
                .depth
                .iter()
                .zip(&truth)
                .filter(|(found, truth)| **found > 0.0 && found.is_finite() && **truth > 0.0)
                .map(|(found, truth)| (found / truth).ln().abs())
                .collect();
            errors.sort_by(f32::total_cmp);
            let at = |part: f64| errors.get((part * errors.len() as f64) as usize).copied().unwrap_or(f32::NAN);
            println!(
                "seed {seed}, {name}: {:.0} % of the pixels; error of log depth: median {:.4}, of one in ten above {:.4}, of \
                 one in fifty above {:.4}",
                100.0 * found.coverage(),
                at(0.5),
                at(0.9),
                at(0.98)
            );
        }
        let config = PhotoConfig::preset("photo-128").ok_or("no such preset")?;
        let mut predictor = PhotoPredictor::untrained(config, AllocationKind::Quadtree, 0.5);
        done("network");
        let stream = Stream::new(seed, 0, "example");
        let made = predictor.predict_compared(photos, &cameras, &real, Density::default(), stream)?;
        done("prediction");
        println!("{} Gaussians", made.gaussians.opacities.len());
    }
    Ok(())
}
