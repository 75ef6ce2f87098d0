//! Procedural scenes at the smallest training size, and a tuple drawn from it.

use criterion::Criterion;
use std::f64::consts::TAU;
use weaver_data::procedural::{ProceduralOptions, scene, varied_scene};
use weaver_data::{Layout, Scene, training_tuple};
use weaver_geometry::Pose;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_kernels::random::Stream;

/// A scene with so many cameras on a circle.
fn around(scene: &Scene, views: usize) -> Scene {
    let views = (0..views).map(|i| {
        let mut view = scene.views[i % scene.views.len()].clone();
        let rotation = DMat3::from_rotation_y(TAU * i as f64 / views as f64);
        view.camera.pose = Pose::new(rotation, DVec3::Z);
        view
    });
    Scene { views: views.collect(), ..scene.clone() }
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("data");
    let options = ProceduralOptions { width: 64, height: 48, views: 24 };
    group.sample_size(10);
    group.bench_function("procedural scene 24 x 64x48", |b| b.iter(|| scene(1, &options)));
    let fresh = ProceduralOptions { views: 8, ..options };
    let mut seed = 0;
    group.bench_function("varied procedural scene 8 x 64x48", |b| {
        b.iter(|| {
            seed += 1;
            varied_scene(seed, &fresh)
        });
    });

    let scenes = [scene(1, &options)];
    let layouts = [Layout::of(&scenes[0])];
    let rng = Stream::new(1, 0, "bench");
    group.bench_function("training tuple of 24 views", |b| {
        b.iter(|| {
            let tuple = training_tuple(&layouts, rng, 3, 6, 4, 2);
            scenes[0].normalized(&tuple).expect("a scene with points")
        });
    });
    // Drawing a tuple, and the measurements of a scene before the first.
    for views in [50, 2000] {
        let around = around(&scenes[0], views);
        let layouts = [Layout::of(&around)];
        let mut index = 0;
        group.bench_function(format!("tuple of {views} views"), |b| {
            b.iter(|| {
                index += 1;
                training_tuple(&layouts, rng, index, 6, 4, 2)
            });
        });
        group.bench_function(format!("layout of {views} views"), |b| b.iter(|| Layout::of(&around).central_view()));
    }
    group.finish();
    criterion.final_summary();
}
