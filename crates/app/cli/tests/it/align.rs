//! Photos of a scene on disk are located in it; mismatched inputs are refused by name.

use crate::command::{printed, refused};
use std::path::Path;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_io::{Image, Transforms, read_cameras, write_gaussians};
use weaver_scene::{Frame, Gaussians};

const ALIGN: &str = "align scene.ply --photos photos --cameras guess.json --background black -o aligned";

/// Gaussians of many colors in a box before the camera.
fn gaussians() -> Gaussians {
    let mut scene = Gaussians::default();
    for i in 0..120 {
        let place = |k: usize| ((i * 37 + k * 61) % 101) as f32 / 50.5 - 1.0;
        scene.means.push([1.2 * place(1), 0.9 * place(2), 3.0 + 0.8 * place(3)]);
        scene.log_scales.push([-1.9; 3]);
        scene.quats.push([1.0, 0.0, 0.0, 0.0]);
        scene.opacity_logits.push(2.0);
        scene.sh.extend([place(4), place(5), place(6)]);
    }
    scene
}

fn camera(i: usize) -> Camera {
    let intrinsics = Intrinsics { fx: 40.0, fy: 40.0, cx: 24.0, cy: 18.0 };
    let rotation = DMat3::from_rotation_y(0.1 * i as f64);
    Camera { pose: Pose::new(rotation, DVec3::new(0.1, -0.05, 0.2)), intrinsics, width: 48, height: 36 }
}

fn write(path: &Path, cameras: &[(&str, Camera)]) {
    let frames = cameras.iter().map(|(name, camera)| Frame::new(*name, *camera)).collect();
    Transforms { frames, ..Transforms::default() }.write(path).unwrap();
}

/// A scene, two photos of it, and guesses that are a degree off.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_gaussians(at("scene.ply"), &gaussians()).unwrap();
    let photos = [("photos/0.png", camera(0)), ("photos/1.png", camera(1))];
    write(&at("transforms.json"), &photos);
    printed(folder.path(), "render scene.ply --cameras transforms.json --background black -o photos");
    let off = |camera: Camera| {
        let turn = DMat3::from_axis_angle(DVec3::new(0.6, 0.8, 0.0), 1_f64.to_radians());
        Camera { pose: Pose::new(turn * camera.pose.rotation, camera.pose.translation + 0.03), ..camera }
    };
    write(&at("guess.json"), &photos.map(|(name, camera)| (name, off(camera))));
    folder
}

/// Error of a file's cameras against the photos' own, degrees at most.
fn error(file: &Path) -> f64 {
    let frames = read_cameras(file).unwrap();
    assert_eq!(frames.len(), 2);
    frames.iter().enumerate().map(|(i, f)| f.camera.pose.angle_to(&camera(i).pose).to_degrees()).fold(0.0, f64::max)
}

#[test]
fn photos_are_located() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    // All is about as far away, where a turn and a shift look alike: it takes many steps to separate them.
    let table = printed(folder.path(), &format!("{ALIGN} --steps 1000"));
    assert!(error(&at("guess.json")) > 0.9);
    assert!(error(&at("aligned/transforms.json")) < 0.1, "{}", error(&at("aligned/transforms.json")));
    assert!(error(&at("aligned/sparse/0")) < 0.1);
    let rows: Vec<&str> = table.lines().filter(|line| line.ends_with("kept")).collect();
    assert!(rows.len() == 2 && rows[0].starts_with("photos/0.png"), "{table}");
    let render = Image::read(at("aligned/renders/1.png"), weaver_io::Background::White).unwrap();
    let photo = Image::read(at("photos/1.png"), weaver_io::Background::White).unwrap();
    let square: f32 = render.pixels.iter().zip(&photo.pixels).map(|(a, b)| (a - b) * (a - b)).sum();
    assert!(square / (photo.pixels.len() as f32) < 1e-4, "{square}");
    let report: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(at("aligned/align.json")).unwrap()).unwrap();
    assert_eq!(report[0]["outcome"], "kept");
    assert!(report[0]["psnr"][1].as_f64().unwrap() > 10.0 + report[0]["psnr"][0].as_f64().unwrap());
    assert!(report[0]["loss"][1].as_f64().unwrap() < 0.1 * report[0]["loss"][0].as_f64().unwrap());
}

/// A model in `sparse/0`, as a fit leaves one: a transforms.json beside the scene must be of its world, a file of first
/// guesses may be of any.
#[test]
fn guesses_may_lie_beside_a_model_that_knows_better() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir_all(at("sparse/0")).unwrap();
    let frames = read_cameras(at("transforms.json")).unwrap();
    weaver_io::colmap::Model::from_frames(&frames).write_binary(at("sparse/0")).unwrap();
    let table = printed(folder.path(), &format!("{ALIGN} --steps 10"));
    assert!(table.contains("photos/1.png"), "{table}");
    std::fs::rename(at("guess.json"), at("transforms.json")).unwrap();
    let message = refused(folder.path(), &ALIGN.replace("guess", "transforms"), 1);
    assert!(message.contains("sparse/0: photos/0.png: expected the pose in transforms.json"), "{message}");
}

/// Promise of `aligned_cameras_are_judged_by_the_datas`.
#[test]
fn photos_may_be_compared_by_their_structure() {
    let folder = folder();
    let table = printed(folder.path(), &format!("{ALIGN} --loss ssim --steps 1000"));
    assert!(table.contains("dB before"), "{table}");
    let error = error(&folder.path().join("aligned/transforms.json"));
    assert!(error < 0.1, "{error}");
    let message = refused(folder.path(), &format!("{ALIGN} --loss ssim --long-side 12"), 1);
    assert!(message.contains("expected photos of at least 11 x 11 pixels, found 12 x 9"), "{message}");
}

#[test]
fn the_scenes_own_cameras_are_guesses() {
    let folder = folder();
    printed(folder.path(), "align scene.ply --photos photos/1.png photos/0.png --background black --steps 20 -o again");
    let frames = read_cameras(folder.path().join("again/transforms.json")).unwrap();
    // Each photo was taken from one of them.
    assert!(frames[0].camera.pose.angle_to(&camera(1).pose) < 1e-3);
    std::fs::remove_file(folder.path().join("transforms.json")).unwrap();
    let message = refused(folder.path(), "align scene.ply --photos photos -o aligned", 2);
    assert!(
        message.contains("--cameras: expected first guesses, or the scene's own cameras in transforms.json"),
        "{message}"
    );
}

/// Photos of another size take their cameras along or are refused.
#[test]
fn photos_of_another_size() {
    let folder = folder();
    let twice = |i| {
        let camera: Camera = camera(i);
        let intrinsics = camera.intrinsics.resized(2.0, 2.0);
        Camera { intrinsics, width: 96, height: 72, ..camera }
    };
    write(&folder.path().join("guess.json"), &[("photos/0.png", twice(0)), ("photos/1.png", twice(1))]);
    printed(folder.path(), &format!("{ALIGN} --steps 10"));
    let frames = read_cameras(folder.path().join("aligned/transforms.json")).unwrap();
    assert_eq!((frames[0].camera.width, frames[0].camera.intrinsics.fx), (48, 40.0));
    let square = Camera { height: 96, ..twice(1) };
    write(&folder.path().join("guess.json"), &[("photos/0.png", twice(0)), ("photos/1.png", square)]);
    let message = refused(folder.path(), ALIGN, 1);
    assert!(message.contains("1.png") && message.contains("the proportions of its camera, 96x96"), "{message}");
}

#[test]
fn no_photos_make_an_empty_table() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("empty")).unwrap();
    let table = printed(folder.path(), "align scene.ply --photos empty --cameras guess.json -o none");
    assert_eq!(table.lines().count(), 2, "{table}");
    let report = std::fs::read_to_string(folder.path().join("none/align.json")).unwrap();
    assert_eq!(report.trim(), "[]");
}

#[test]
fn a_photo_of_which_nothing_is_seen_keeps_its_guess() {
    let folder = folder();
    let behind = Pose::new(DMat3::from_rotation_y(std::f64::consts::PI), DVec3::ZERO);
    let away = Camera { pose: behind, ..camera(1) };
    write(&folder.path().join("guess.json"), &[("photos/0.png", camera(0)), ("photos/1.png", away)]);
    let table = printed(folder.path(), &format!("{ALIGN} --steps 10"));
    assert!(table.contains("failed: nothing seen"), "{table}");
    let frames = read_cameras(folder.path().join("aligned/transforms.json")).unwrap();
    assert!(frames[1].camera.pose.angle_to(&behind) < 1e-6);
}
