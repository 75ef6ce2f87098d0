//! From how far cameras come back: `cargo run --release -p weaver-fit --features align --example planted [DRAWS
//! [SCENE.ply TRANSFORMS.json]]`.
//!
//! The photo is a render of the scene itself, 300 random Gaussians or a file's; the guess is off by r degrees about a
//! random axis, and by r/60 of the mean depth. For each method: the share of draws that ends within 0.3 degrees and
//! 0.005 of the depth / within 0.05 degrees and 0.001, and the median angle that is left.

use weaver_fit::align::{Method, Options, Photo, Scene, align, mean_square};
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose, so3, trajectory::look_at};
use weaver_kernels::random::Stream;
use weaver_losses::Photometric;
use weaver_scene::{ActivatedGaussians, CameraSlices, Color, GaussianSlices, Model};
use weaver_splat::{CpuRasterizer, Images, RasterSettings, Rasterizer};

/// Width of the photos.
const WIDTH: usize = 64;

/// Loss between photos.
type Loss<'a> = dyn FnMut(&[f64], &[f64], [usize; 2], &mut [f64]) -> f64 + 'a;

/// Gaussians in f64.
struct Cloud {
    means: Vec<f64>,
    quats: Vec<f64>,
    scales: Vec<f64>,
    opacities: Vec<f64>,
    sh: Vec<f64>,
    degree: usize,
}

impl Cloud {
    fn random() -> Self {
        let stream = Stream::new(3, 0, "planted");
        let draw = |k: u64, count: usize, low: f64, high: f64| -> Vec<f64> {
            (0..count).map(|i| low + (high - low) * stream.fork(k).uniform::<f64>(i as u64)).collect()
        };
        let n = 300;
        Self {
            means: draw(0, 3 * n, -1.0, 1.0),
            quats: draw(1, 4 * n, -0.5, 0.5),
            scales: draw(2, 3 * n, 0.03, 0.15),
            opacities: draw(3, n, 0.4, 0.9),
            sh: draw(4, 3 * n, -1.7, 1.7),
            degree: 0,
        }
    }

    fn of(gaussians: &ActivatedGaussians) -> Self {
        let wide = |values: &[f32]| values.iter().map(|x| f64::from(*x)).collect();
        let ActivatedGaussians { means, scales, quats, opacities, sh, degree } = gaussians;
        let [means, scales, quats, opacities, sh] = [means, scales, quats, opacities, sh].map(|v| wide(v));
        Self { means, quats, scales, opacities, sh, degree: *degree }
    }

    fn slices(&self) -> GaussianSlices<'_, f64> {
        let Self { means, quats, scales, opacities, sh, degree } = self;
        let color = Color::Sh { coefficients: sh, degree: *degree };
        GaussianSlices { means, quats, scales, opacities, color, features: None, groups: None }
    }
}

/// A render, and the mean depth of its pixels.
fn draw(scene: &Scene<'_, f64>, camera: &Camera) -> Result<(Vec<f64>, f64), Box<dyn std::error::Error>> {
    let pixels = camera.width * camera.height;
    let (mut image, mut alpha, mut depth) = (vec![0.0; 3 * pixels], vec![0.0; pixels], vec![0.0; pixels]);
    let k = camera.intrinsics;
    let cameras = CameraSlices {
        viewmats: &camera.pose.rows().concat(),
        intrinsics: &[k.fx, k.fy, k.cx, k.cy],
        background: &scene.background,
        width: camera.width,
        height: camera.height,
        model: Model::Pinhole,
    };
    let images = Images { image: &mut image, alpha: &mut alpha, depth: Some(&mut depth), features: None };
    CpuRasterizer.session().forward(&scene.gaussians, &cameras, &scene.settings, images)?;
    Ok((image, depth.iter().sum::<f64>() / alpha.iter().sum::<f64>()))
}

/// A camera off by so many degrees, and by a length.
fn disturbed(camera: &Camera, degrees: f64, length: f64, stream: &Stream) -> Camera {
    let direction = |k: u64| {
        let [x, y, z] = [0, 1, 2].map(|i| stream.fork(k).normal::<f64>(i));
        DVec3::new(x, y, z).normalize()
    };
    let rotation = DMat3::from_axis_angle(direction(0), degrees.to_radians()) * camera.pose.rotation;
    let center = camera.pose.center() + length * direction(1);
    Camera { pose: Pose::new(rotation, -(rotation * center)), ..*camera }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let draws: u64 = arguments.first().map_or(Ok(20), |draws| draws.parse())?;
    let (cloud, cameras) = match &arguments[1.min(arguments.len())..] {
        [scene, cameras] => {
            let gaussians = weaver_io::read_gaussians(scene)?.to_activated();
            let small = |camera: Camera| {
                let factor = WIDTH as f64 / camera.width as f64;
                let height = (camera.height as f64 * factor).round() as usize;
                let intrinsics = camera.intrinsics.resized(factor, height as f64 / camera.height as f64);
                Camera { intrinsics, width: WIDTH, height, ..camera }
            };
            let frames = weaver_io::read_cameras(cameras)?;
            (Cloud::of(&gaussians), frames.into_iter().map(|frame| small(frame.camera)).collect())
        }
        _ => {
            let intrinsics = Intrinsics { fx: 56.0, fy: 56.0, cx: 32.0, cy: 24.0 };
            let pose = look_at(DVec3::new(1.2, -0.8, -2.6), DVec3::ZERO, DVec3::NEG_Y);
            (Cloud::random(), vec![Camera { pose, intrinsics, width: WIDTH, height: 48 }])
        }
    };
    let largest = cloud.means.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    let settings = RasterSettings::default();
    let scene = Scene { gaussians: cloud.slices(), background: [1.0; 3], settings, unit: largest };
    let own = Options::of(Method::Own);
    // Absolute differences, and structure with this weight.
    let by = |structure: f64| {
        let mut photometric = Photometric::new();
        move |image: &[f64], photo: &[f64], size: [usize; 2], gradient: &mut [f64]| {
            photometric.value_and_gradient(image, photo, size, structure, gradient).loss
        }
    };
    let methods: [(_, _, &mut Loss<'_>); 6] = [
        ("own", own, &mut by(0.2)),
        ("own, no blur", Options { blur: false, ..own }, &mut by(0.2)),
        ("own, squares", own, &mut mean_square),
        ("own, SSIM", own, &mut by(1.0)),
        ("NoPoSplat", Options::of(Method::NoPoSplat), &mut mean_square),
        ("2Xplat", Options::of(Method::TwoXplat), &mut mean_square),
    ];
    println!("{:<14} {}", "degrees off", [1, 2, 4, 8, 16].map(|r| format!("{r:>20}")).concat());
    for (name, options, loss) in methods {
        let mut line = format!("{name:<14} ");
        for degrees in [1.0, 2.0, 4.0, 8.0, 16.0] {
            let (mut near, mut nearest, mut left) = (0, 0, Vec::new());
            for seed in 0..draws {
                let truth = cameras[seed as usize % cameras.len()];
                let (photo, depth) = draw(&scene, &truth)?;
                let camera = disturbed(&truth, degrees, degrees / 60.0 * depth, &Stream::new(seed, 0, "off"));
                let photo = Photo { pixels: &photo, mask: None, camera };
                let found = &align(&CpuRasterizer, &scene, &[photo], &options, &mut *loss)?[0];
                let angle = so3::log(&found.camera.pose.relative_to(&truth.pose).rotation).length().to_degrees();
                let distance = found.camera.pose.center().distance(truth.pose.center()) / depth;
                near += usize::from(angle < 0.3 && distance < 0.005);
                nearest += usize::from(angle < 0.05 && distance < 1e-3);
                left.push(angle);
            }
            left.sort_by(f64::total_cmp);
            let percent = |count: usize| 100.0 * count as f64 / draws as f64;
            let median = left[left.len() / 2];
            line += &format!("{:>5.0}/{:>3.0} %  {median:>6.3}", percent(near), percent(nearest));
        }
        println!("{line}");
    }
    Ok(())
}
