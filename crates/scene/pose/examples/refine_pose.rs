//! Finds out where a photo was taken: `cargo run --release -p weaver-pose --example refine_pose`.
//!
//! A scene of Gaussians is known, and a photo of it, but the camera only roughly: 8 degrees and a tenth of the distance
//! off. Gradient descent through the rasterizer moves the camera, field of view included, until the render is the
//! photo: on a tape, where the camera may be any function of anything, and by `weaver_fit::align` without one. Writes
//! refine_pose.png (the photo, the render from the first guess, those from both ends) and prints the errors.

use std::time::Instant;
use weaver_autograd::{Params, Tape, Var};
use weaver_fit::align::{AlignError, Aligned, Method, Options, Photo, Scene, align, mean_square};
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose, fov, trajectory::look_at};
use weaver_io::Image;
use weaver_kernels::random::Stream;
use weaver_nn::{AdamW, Group, WarmupCosine};
use weaver_scene::{Color, GaussianSlices};
use weaver_splat::{CpuRasterizer, GaussianVars, RasterSettings, Rasterize, WorkspacePool};

const WIDTH: usize = 128;
const HEIGHT: usize = 96;
const GAUSSIANS: usize = 300;
const STEPS: u64 = 2000;
/// Horizontal field of view of the first guess, radians.
const GUESSED_FOV: f64 = 0.8;

/// Means, quaternions, scales, opacities and colors of a cloud of Gaussians around the origin.
fn cloud() -> [Vec<f32>; 5] {
    let stream = Stream::new(3, 0, "refine_pose");
    let draw = |k: u64, i: usize| stream.fork(k).uniform::<f32>(i as u64);
    let n = GAUSSIANS;
    [
        (0..3 * n).map(|i| 2.0 * draw(0, i) - 1.0).collect(),
        (0..4 * n).map(|i| draw(1, i) - 0.5).collect(),
        (0..3 * n).map(|i| 0.03 + 0.12 * draw(2, i)).collect(),
        (0..n).map(|i| 0.4 + 0.5 * draw(3, i)).collect(),
        (0..3 * n).map(|i| draw(4, i)).collect(),
    ]
}

/// The render from the camera with this pose code `[1, 9]`, `[1, H, W, 3]`.
fn render<'t>(scene: &[Vec<f32>; 5], code: Var<'t>, workspaces: &WorkspacePool<f32>) -> Var<'t> {
    let (tape, n) = (code.tape(), GAUSSIANS);
    let gaussians = GaussianVars {
        means: tape.constant(&scene[0], [n, 3]),
        quats: tape.constant(&scene[1], [n, 4]),
        scales: tape.constant(&scene[2], [n, 3]),
        opacities: tape.constant(&scene[3], [n]),
        colors: tape.constant(&scene[4], [n, 3]),
    };
    let camera = weaver_pose::cameras(code, HEIGHT, WIDTH);
    let background = tape.constant(&[0.05; 3], [3]);
    Rasterize::new(WIDTH, HEIGHT, RasterSettings::default(), workspaces).apply(&gaussians, &camera, background).image
}

/// Vertical and horizontal, of a horizontal one.
fn fields_of_view(fov: f64) -> [f64; 2] {
    [fov * HEIGHT as f64 / WIDTH as f64, fov]
}

fn code(pose: &Pose, fov: f64) -> Vec<f32> {
    let ([w, x, y, z], t) = (pose.wxyz(), pose.translation);
    let [vertical, horizontal] = fields_of_view(fov);
    [t.x, t.y, t.z, x, y, z, w, vertical, horizontal].map(|v| v as f32).to_vec()
}

/// Rotation error in degrees, position error in parts of the distance, error of the field of view in degrees.
fn errors(code: &[f32], truth: &Pose, fov: f64) -> [f64; 3] {
    let c: Vec<f64> = code.iter().map(|x| f64::from(*x)).collect();
    let pose = Pose::from_wxyz([c[6], c[3], c[4], c[5]], DVec3::new(c[0], c[1], c[2]));
    let distance = (pose.center() - truth.center()).length() / truth.center().length();
    [pose.angle_to(truth).to_degrees(), distance, (c[8] - fov).abs().to_degrees()]
}

/// The same by `weaver_fit::align`: no tape, no codes.
fn without_a_tape(scene: &[Vec<f32>; 5], photo: &[f32], guess: &Pose) -> Result<Aligned<f32>, AlignError> {
    let [means, quats, scales, opacities, colors] = scene;
    let gaussians =
        GaussianSlices { means, quats, scales, opacities, color: Color::Plain(colors), features: None, groups: None };
    let scene = Scene { gaussians, background: [0.05; 3], settings: RasterSettings::default(), unit: 1.0 };
    let [vertical, horizontal] = fields_of_view(GUESSED_FOV);
    let [fx, fy] =
        [(horizontal, WIDTH), (vertical, HEIGHT)].map(|(a, size)| fov::focal_length(a, size as f64, 0.0, f64::tan));
    let intrinsics = Intrinsics { fx, fy, cx: 0.5 * WIDTH as f64, cy: 0.5 * HEIGHT as f64 };
    let camera = Camera { pose: *guess, intrinsics, width: WIDTH, height: HEIGHT };
    let options = Options { intrinsics: true, steps: STEPS as usize, ..Options::of(Method::Own) };
    let photo = Photo { pixels: photo, mask: None, camera };
    Ok(align(&CpuRasterizer, &scene, &[photo], &options, mean_square)?.remove(0))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (scene, workspaces) = (cloud(), WorkspacePool::new());
    let (truth, fov) = (look_at(DVec3::new(1.5, -1.0, -3.0), DVec3::ZERO, DVec3::NEG_Y), 0.9);
    let turn = DMat3::from_axis_angle(DVec3::new(0.4, 1.0, 0.3).normalize(), 8_f64.to_radians());
    let guess = Pose::new(turn * truth.rotation, truth.translation + DVec3::new(0.2, -0.15, 0.25));

    let mut tape = Tape::<f32>::new();
    let photo = render(&scene, tape.constant(&code(&truth, fov), [1, 9]), &workspaces).to_vec();
    tape.reset();

    let mut params = Params::<f32>::new();
    let id = params.add("camera", [1, 9], code(&guess, GUESSED_FOV));
    let group = Group { params: vec![id], lr_scale: 0.01, weight_decay: 0.0 };
    let mut optimizer = AdamW::new(vec![group], 0.9, 0.99, 1e-12);
    let schedule = WarmupCosine { warmup: 1, total: STEPS, floor: 0.01 };
    let mut pictures = vec![photo.clone()];
    let start = Instant::now();
    for step in 0..=STEPS {
        let image = render(&scene, tape.param(&params, id), &workspaces);
        let loss = (image - tape.constant(&photo, image.shape())).square().mean();
        if step % 400 == 0 {
            let [angle, distance, zoom] = errors(params.get(id).value(), &truth, fov);
            let psnr = -10.0 * loss.item().log10();
            println!(
                "step {step:3}: {psnr:5.1} dB, {angle:7.4} degrees, {distance:.5} of the distance, fov {zoom:.4} degrees"
            );
        }
        if step == 0 || step == STEPS {
            pictures.push(image.to_vec());
        }
        loss.backward();
        optimizer.step(&mut params, &mut tape, schedule.factor(step));
        tape.reset();
    }
    println!("on a tape: {:.2?}", start.elapsed());

    let start = Instant::now();
    let aligned = without_a_tape(&scene, &photo, &guess)?;
    let Camera { pose, intrinsics, .. } = aligned.camera;
    let [angle, distance, zoom] = errors(&code(&pose, intrinsics.fov(WIDTH, HEIGHT)[1]), &truth, fov);
    println!(
        "without: {:.2?}, {} steps, {angle:7.4} degrees, {distance:.5} of the distance, fov {zoom:.4} degrees",
        start.elapsed(),
        aligned.losses.len() - 1
    );
    pictures.push(aligned.image);
    let images = pictures.into_iter().map(|pixels| Image { width: WIDTH, height: HEIGHT, pixels }).collect::<Vec<_>>();
    Image::mosaic(&images.iter().collect::<Vec<_>>()).write_png("refine_pose.png")?;
    Ok(())
}
