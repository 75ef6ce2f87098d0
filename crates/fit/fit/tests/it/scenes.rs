//! Small scenes to fit.

use weaver_fit::{Fit, FitSettings, Photo, StrategyKind};
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_kernels::random::Stream;
use weaver_scene::Gaussians;

/// Width and height of photos.
pub const SIZE: [usize; 2] = [32, 24];

/// A camera that looks along z, at this place and turned by this angle about y.
pub fn camera(x: f64, angle: f64) -> Camera {
    let rotation = DMat3::from_rotation_y(angle);
    let pose = Pose::new(rotation, rotation * DVec3::new(-x, 0.0, 0.0));
    let intrinsics = Intrinsics { fx: 30.0, fy: 30.0, cx: 16.0, cy: 12.0 };
    Camera { pose, intrinsics, width: SIZE[0], height: SIZE[1] }
}

/// Gaussians about four units before the cameras.
pub fn cloud(count: usize, seed: u64) -> Gaussians {
    let stream = Stream::new(seed, 0, "test.cloud");
    let between = |i: usize, from: f32, to: f32| from + (to - from) * stream.uniform::<f32>(i as u64);
    let row = |n: usize, j: usize, from: f32, to: f32| between(16 * n + j, from, to);
    Gaussians {
        means: (0..count).map(|n| [row(n, 0, -2.0, 2.0), row(n, 1, -1.5, 1.5), row(n, 2, 3.0, 5.0)]).collect(),
        log_scales: (0..count).map(|n| std::array::from_fn(|i| row(n, 3 + i, -2.5, -0.8))).collect(),
        quats: (0..count).map(|n| std::array::from_fn(|i| row(n, 6 + i, -1.0, 1.0))).collect(),
        opacity_logits: (0..count).map(|n| row(n, 10, -1.0, 3.0)).collect(),
        sh: (0..3 * count).map(|i| row(i / 3, 11 + i % 3, -1.5, 1.5)).collect(),
        degree: 0,
    }
}

/// Settings without a schedule: no coarse part, colors without a direction.
pub fn plain(strategy: StrategyKind, steps: usize, gaussians: usize) -> FitSettings {
    let mut settings = FitSettings { steps, gaussians, sh_degree: 0, coarse_until: 0.0, ..FitSettings::default() };
    settings.density.strategy = strategy;
    settings
}

/// Renders of Gaussians.
pub fn render(gaussians: &Gaussians, cameras: &[Camera]) -> Vec<Vec<f32>> {
    let [width, height] = SIZE;
    let black = Photo {
        name: "black".into(),
        camera: cameras[0],
        rgb: vec![0; 3 * width * height].into(),
        mask: None,
        lens: None,
    };
    let settings = plain(StrategyKind::Keep, 1, gaussians.len());
    let mut fit = Fit::new(vec![black], gaussians, settings).expect("a scene");
    cameras.iter().map(|camera| fit.render(camera).expect("an image")).collect()
}

/// Photos of a cloud by cameras side by side.
pub fn photos(count: usize, cloud: &Gaussians) -> Vec<Photo> {
    let middle = (count as f64 - 1.0) / 2.0;
    let cameras: Vec<Camera> = (0..count).map(|i| (i as f64 - middle) * 0.6).map(|x| camera(x, 0.2 * x)).collect();
    let bytes = |image: Vec<f32>| image.iter().map(|x| (255.0 * x).round().clamp(0.0, 255.0) as u8).collect();
    let images = render(cloud, &cameras);
    let all = cameras.into_iter().zip(images).enumerate();
    all.map(|(i, (camera, image))| Photo {
        name: format!("photo {i}"),
        camera,
        rgb: bytes(image),
        mask: None,
        lens: None,
    })
    .collect()
}

/// Does all steps that are left.
pub fn finish(fit: &mut Fit) {
    while fit.steps_done() < fit.settings().steps {
        fit.step().expect("a step");
    }
}
