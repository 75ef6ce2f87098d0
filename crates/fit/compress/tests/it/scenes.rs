//! Scenes and cameras of the tests.

use weaver_compress::Pictures;
use weaver_geometry::Camera;
use weaver_kernels::random::Stream;
use weaver_scene::{Gaussians, orbit};

/// A ball of Gaussians of all sizes with harmonics of degree 1.
pub fn scene(count: usize, seed: u64) -> Gaussians {
    let stream = Stream::new(seed, 0, "scene");
    let normal = |i: usize, k: u64| stream.normal::<f64>(64 * i as u64 + k) as f32;
    let row = |i: usize, k: u64| std::array::from_fn(|a| normal(i, k + a as u64));
    Gaussians {
        means: (0..count).map(|i| row(i, 0)).collect(),
        log_scales: (0..count).map(|i| row(i, 3).map(|x| 0.4 * x - 2.5)).collect(),
        quats: (0..count).map(|i| std::array::from_fn(|a| normal(i, 6 + a as u64))).collect(),
        opacity_logits: (0..count).map(|i| 2.0 * normal(i, 10)).collect(),
        sh: (0..count).flat_map(|i| (0..12).map(move |k| 0.3 * normal(i, 11 + k))).collect(),
        degree: 1,
    }
}

pub fn cameras(gaussians: &Gaussians) -> Vec<Camera> {
    orbit(gaussians, 3, [64, 48]).unwrap()
}

pub fn pictures(cameras: &[Camera]) -> Pictures<'_> {
    Pictures { cameras, background: [1.0; 3], settings: Default::default() }
}
