//! A cloud of Gaussians, and a camera before it.

use weaver_fit::align::{Photo, Scene};
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose, sh, trajectory::look_at};
use weaver_kernels::random::Stream;
use weaver_scene::{Color, GaussianSlices};
use weaver_splat::{CpuRasterizer, Images, RasterSettings, Rasterizer};

/// Background, the same for all.
pub const BACKGROUND: [f64; 3] = [0.05, 0.1, 0.15];

pub struct Cloud {
    pub means: Vec<f64>,
    pub quats: Vec<f64>,
    pub scales: Vec<f64>,
    pub opacities: Vec<f64>,
    pub sh: Vec<f64>,
    pub degree: usize,
}

impl Cloud {
    /// `n` Gaussians in the cube from -1 to 1.
    pub fn new(n: usize, degree: usize, seed: u64) -> Self {
        let stream = Stream::new(seed, 0, "cloud");
        let draw = |k: u64, i: usize| stream.fork(k).uniform::<f64>(i as u64);
        let coefficients = sh::coefficients(degree);
        let color = |i: usize| {
            if (i / 3).is_multiple_of(coefficients) { 3.0 * draw(4, i) - 1.5 } else { 0.4 * draw(4, i) - 0.2 }
        };
        Self {
            means: (0..3 * n).map(|i| 2.0 * draw(0, i) - 1.0).collect(),
            quats: (0..4 * n).map(|i| draw(1, i) - 0.5).collect(),
            scales: (0..3 * n).map(|i| 0.05 + 0.15 * draw(2, i)).collect(),
            opacities: (0..n).map(|i| 0.4 + 0.5 * draw(3, i)).collect(),
            sh: (0..3 * coefficients * n).map(color).collect(),
            degree,
        }
    }

    pub fn scene(&self) -> Scene<'_, f64> {
        let Self { means, quats, scales, opacities, sh, degree } = self;
        let color = Color::Sh { coefficients: sh, degree: *degree };
        let gaussians = GaussianSlices { means, quats, scales, opacities, color, features: None, groups: None };
        Scene { gaussians, background: BACKGROUND, settings: RasterSettings::default(), unit: 1.0 }
    }

    pub fn draw(&self, camera: &Camera) -> Vec<f64> {
        let scene = self.scene();
        let pixels = camera.width * camera.height;
        let (mut image, mut alpha) = (vec![0.0; 3 * pixels], vec![0.0; pixels]);
        let rows = camera.pose.rows().concat();
        let k = camera.intrinsics;
        let intrinsics = [k.fx, k.fy, k.cx, k.cy];
        let cameras = weaver_scene::CameraSlices {
            viewmats: &rows,
            intrinsics: &intrinsics,
            background: &BACKGROUND,
            width: camera.width,
            height: camera.height,
            model: weaver_scene::Model::Pinhole,
        };
        let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
        CpuRasterizer.session().forward(&scene.gaussians, &cameras, &scene.settings, images).unwrap();
        image
    }
}

/// A camera at a distance of some three from the middle.
pub fn camera() -> Camera {
    let intrinsics = Intrinsics { fx: 56.0, fy: 56.0, cx: 32.0, cy: 24.0 };
    Camera { pose: look_at(DVec3::new(1.2, -0.8, -2.6), DVec3::ZERO, DVec3::NEG_Y), intrinsics, width: 64, height: 48 }
}

/// The camera turned by so many degrees, and moved by a 60th of three for each, in directions by a seed.
pub fn disturbed(camera: &Camera, degrees: f64, seed: u64) -> Camera {
    let stream = Stream::new(seed, 0, "disturbed");
    let direction = |k: u64| {
        let [x, y, z] = [0, 1, 2].map(|i| stream.fork(k).normal::<f64>(i));
        DVec3::new(x, y, z).normalize()
    };
    let turn = DMat3::from_axis_angle(direction(0), degrees.to_radians());
    let center = camera.pose.center() + direction(1) * 3.0 * degrees / 60.0;
    let rotation = turn * camera.pose.rotation;
    Camera { pose: Pose::new(rotation, -(rotation * center)), ..*camera }
}

/// A photo that all of counts.
pub fn photo(pixels: &[f64], camera: Camera) -> Photo<'_, f64> {
    Photo { pixels, mask: None, camera }
}

/// Distance of a camera from another: degrees, and parts of a distance of three.
pub fn apart(a: &Camera, b: &Camera) -> [f64; 2] {
    let turn = a.pose.relative_to(&b.pose).rotation;
    let degrees = weaver_geometry::so3::log(&turn).length().to_degrees();
    [degrees, (a.pose.center() - b.pose.center()).length() / 3.0]
}
