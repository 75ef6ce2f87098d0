//! Features of files lifted to a file of Gaussians, and queries; mismatched inputs are refused by name.

use crate::command::{printed, refused, splatweaver, text};
use std::path::Path;
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_io::safetensors::Tensors;
use weaver_io::{Image, Transforms, write_gaussians};
use weaver_scene::{Frame, Gaussians};

const WIDTH: usize = 32;
const HEIGHT: usize = 24;
const CAMERAS: usize = 3;
const SPLATS: usize = 24;

const LIFT: &str = "lift scene.ply --cameras transforms.json --features features -o lifted.safetensors";
const QUERY: &str =
    "query scene.ply --features lifted.safetensors --prompts prompts.npy --cameras transforms.json -o maps";

fn npy(path: &Path, shape: &[usize], kind: &str, data: &[u8]) {
    let shape: String = shape.iter().map(|side| format!("{side}, ")).collect();
    let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}), }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend(data);
    std::fs::write(path, bytes).unwrap();
}

fn floats(path: &Path, shape: &[usize], values: &[f32]) {
    npy(path, shape, "<f4", &values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>());
}

/// Two channels: the left half of each photo, and the right half.
fn halves() -> Vec<f32> {
    (0..HEIGHT * WIDTH).flat_map(|pixel| if pixel % WIDTH < WIDTH / 2 { [3.0, 0.0] } else { [0.0, 0.5] }).collect()
}

fn gaussians() -> Gaussians {
    let mut scene = Gaussians::default();
    for i in 0..SPLATS {
        let (x, y) = ((i % 6) as f32 - 2.5, (i / 6) as f32 - 1.5);
        scene.means.push([0.45 * x, 0.45 * y, 2.5]);
        scene.log_scales.push([-1.7; 3]);
        scene.quats.push([1.0, 0.0, 0.0, 0.0]);
        scene.opacity_logits.push(3.0);
        scene.sh.extend([0.3, 0.1, -0.2]);
    }
    scene
}

/// A scene, cameras, features in both formats, prompts.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_gaussians(at("scene.ply"), &gaussians()).unwrap();
    let intrinsics = Intrinsics { fx: 28.0, fy: 28.0, cx: 16.0, cy: 12.0 };
    let camera = Camera { pose: Pose::IDENTITY, intrinsics, width: WIDTH, height: HEIGHT };
    let frames = (0..CAMERAS).map(|i| Frame::new(format!("images/{i}.png"), camera)).collect();
    Transforms { frames, ..Transforms::default() }.write(at("transforms.json")).unwrap();
    std::fs::create_dir(at("features")).unwrap();
    floats(&at("features/0.npy"), &[HEIGHT, WIDTH, 2], &halves());
    let mut tensors = Tensors::default();
    tensors.insert("clip", &[HEIGHT, WIDTH, 2], halves());
    tensors.write(at("features/1.safetensors")).unwrap();
    // Two pixels, in half precision.
    npy(&at("features/2.npy"), &[1, 2, 2], "<f2", &[0x00, 0x3c, 0, 0, 0, 0, 0x00, 0x3c]);
    floats(&at("prompts.npy"), &[2, 2], &[2.0, 0.0, 1.0, 1.0]);
    folder
}

fn lifted(folder: &Path) -> Tensors {
    Tensors::read(folder.join("lifted.safetensors")).unwrap()
}

#[test]
fn features_are_lifted_and_asked_for() {
    let folder = folder();
    let report = printed(folder.path(), LIFT);
    assert!(report.contains("2 channels to 24 Gaussians in 5 passes; 0 Gaussians unseen"), "{report}");
    let file = lifted(folder.path());
    let features = file.values::<f32>("features", &[SPLATS, 2]).unwrap();
    for (i, row) in features.chunks_exact(2).enumerate() {
        let (own, other) = if i % 6 < 3 { (row[0], row[1]) } else { (row[1], row[0]) };
        assert!(own > 0.7 && other < 0.4, "{i}: {row:?}");
    }
    assert!(file.values::<f32>("seen", &[SPLATS]).unwrap().iter().all(|seen| *seen > 1.0));
    for (key, value) in [("solver", "exact"), ("passes", "5"), ("lambda", "1"), ("aggregated", "false")] {
        assert_eq!(file.metadata[key], value);
    }
    for camera in 0..CAMERAS {
        assert!(folder.path().join(format!("lifted-pictures/{camera}.png")).is_file());
    }

    let report = printed(folder.path(), QUERY);
    assert!(report.contains("2 prompts in 3 views"), "{report}");
    let maps = Tensors::read(folder.path().join("maps/1.safetensors")).unwrap();
    let scores = maps.values::<f32>("scores", &[HEIGHT, WIDTH, 2]).unwrap();
    let middle = |x: usize| &scores[2 * (12 * WIDTH + x)..][..2];
    assert!(middle(6)[0] > 0.7 && middle(25)[0] < 0.2, "{:?} {:?}", middle(6), middle(25));
    // The second prompt is as near to both.
    assert!((middle(6)[1] - middle(25)[1]).abs() < 0.05);
    assert!(folder.path().join("maps/2-1.png").is_file());
}

/// Every solver runs and neither threads nor blocks count.
#[test]
fn every_solver_runs_at_any_threads_and_blocks() {
    let folder = folder();
    let bytes = |flags: &str| {
        printed(folder.path(), &format!("{LIFT} {flags}"));
        std::fs::read(folder.path().join("lifted.safetensors")).unwrap()
    };
    let mut all = std::collections::BTreeSet::new();
    for flags in [
        "",
        "--solver row-sum",
        "--solver squared",
        "--conjugate",
        "--solver damped --mu 0.5",
        "--unit",
        "--tikhonov 1.5",
    ] {
        let one = bytes(&format!("{flags} --threads 1"));
        assert_eq!(one, bytes(&format!("{flags} --threads 2 --block 1")), "{flags}");
        assert!(all.insert(one), "{flags} changes nothing");
    }
    printed(folder.path(), &format!("{LIFT} --unit"));
    let file = lifted(folder.path());
    for row in file.values::<f32>("features", &[SPLATS, 2]).unwrap().chunks_exact(2) {
        assert!((row[0].hypot(row[1]) - 1.0).abs() < 1e-5);
    }
}

/// Left and right half are objects; one photo has a mask of both, with a wrong feature.
#[test]
fn masks_clean_features() {
    let folder = folder();
    let masks = folder.path().join("masks");
    std::fs::create_dir(&masks).unwrap();
    let write = |name: &str, inside: Vec<Vec<u8>>, features: Vec<f32>| {
        let mut tensors = Tensors::default();
        tensors.insert("masks", &[inside.len(), HEIGHT, WIDTH], inside.concat());
        tensors.insert("features", &[inside.len(), 2], features);
        tensors.write(masks.join(name)).unwrap();
    };
    let half = |left: bool| (0..HEIGHT * WIDTH).map(|p| u8::from((p % WIDTH < WIDTH / 2) == left)).collect::<Vec<u8>>();
    write("0.safetensors", vec![half(true), half(false)], vec![1.0, 0.0, 0.0, 1.0]);
    write("2.safetensors", vec![vec![1; HEIGHT * WIDTH]], vec![-1.0, 0.0]);
    let report = printed(folder.path(), &format!("{LIFT} --solver row-sum --aggregate masks --smallest 5"));
    assert!(report.contains("of 3 masks agree"), "{report}");
    let kept = |flags: &str| {
        let report = printed(folder.path(), &format!("{LIFT} --solver row-sum --aggregate masks --smallest 5 {flags}"));
        let before = report.split(" of 3 masks agree").next().unwrap().to_string();
        before.rsplit(' ').next().unwrap().parse::<usize>().unwrap()
    };
    assert!(kept("--overlap 0.99") < kept("--overlap 0.1"));
    assert_eq!(lifted(folder.path()).metadata["aggregated"], "true");

    let refused = |part: &str| {
        let message = refused(folder.path(), &format!("{LIFT} --aggregate masks"), 1);
        assert!(message.contains(part) && message.lines().count() == 1, "{message}");
    };
    write("7.safetensors", vec![half(true)], vec![1.0, 0.0]);
    refused("expected files named as the cameras (0, 1, 2), found also 7");
    std::fs::remove_file(masks.join("7.safetensors")).unwrap();
    write("0.safetensors", vec![half(true)], vec![f32::NAN, 0.0]);
    refused("0.safetensors: expected features that are numbers, found NaN for mask 0");
    let mut tensors = Tensors::default();
    tensors.insert("masks", &[1, HEIGHT, WIDTH], vec![1.0_f32; HEIGHT * WIDTH]);
    tensors.write(masks.join("0.safetensors")).unwrap();
    refused("expected masks of type U8 [masks, height, width], found F32 [1, 24, 32]");
    ["0", "2"].iter().for_each(|name| std::fs::remove_file(masks.join(format!("{name}.safetensors"))).unwrap());
    refused("expected NAME.safetensors with masks for some cameras, found none");
}

#[test]
fn pixels_without_numbers_do_not_count() {
    let folder = folder();
    let mut values = halves();
    values[2 * 5] = f32::NAN;
    values[2 * 700 + 1] = f32::INFINITY;
    floats(&folder.path().join("features/0.npy"), &[HEIGHT, WIDTH, 2], &values);
    let report = printed(folder.path(), LIFT);
    assert!(report.contains("of which 2 masked"), "{report}");
    assert!(lifted(folder.path()).values::<f32>("features", &[SPLATS, 2]).unwrap().iter().all(|x| x.is_finite()));
    // All of all photos.
    for name in ["0.npy", "1.npy", "2.npy"] {
        floats(&folder.path().join("features").join(name), &[1, 1, 2], &[f32::NAN, 0.0]);
    }
    std::fs::remove_file(folder.path().join("features/1.safetensors")).unwrap();
    let message = refused(folder.path(), LIFT, 1);
    assert!(message.contains("expected pixels that count, found all 2304 masked"), "{message}");
    // Features of length 0 are features.
    for name in ["0.npy", "1.npy", "2.npy"] {
        floats(&folder.path().join("features").join(name), &[1, 1, 2], &[0.0, 0.0]);
    }
    printed(folder.path(), LIFT);
    assert!(lifted(folder.path()).values::<f32>("features", &[SPLATS, 2]).unwrap().iter().all(|x| *x == 0.0));
}

/// A dark part of a picture beside the features does not count, at any size of the picture.
#[test]
fn masked_pixels_do_not_count() {
    let folder = folder();
    let masks = folder.path().join("valid");
    std::fs::create_dir(&masks).unwrap();
    let flags = format!("{LIFT} --mask-dir valid");
    let refused = |part: &str| {
        let message = refused(folder.path(), &flags, 1);
        assert!(message.contains(part) && message.lines().count() == 1, "{message}");
    };
    refused("valid: expected pictures that are white where photos count, found none");
    // The left half counts in the first photo, nothing in the second, all in the third, which has no picture.
    let picture = |width: usize, height: usize, white: &dyn Fn(usize) -> bool| Image {
        width,
        height,
        pixels: (0..3 * width * height).map(|i| f32::from(u8::from(white(i / 3 % width)))).collect(),
    };
    picture(4, 2, &|x| x < 2).write_png(masks.join("0.png")).unwrap();
    picture(WIDTH, HEIGHT, &|_| false).write_png(masks.join("1.png")).unwrap();
    let report = printed(folder.path(), &flags);
    let masked = HEIGHT * WIDTH * 3 / 2;
    assert!(report.contains(&format!("of which {masked} masked")), "{report}");
    let with_masks = lifted(folder.path()).values::<f32>("seen", &[SPLATS]).unwrap().to_vec();
    printed(folder.path(), LIFT);
    let without = lifted(folder.path()).values::<f32>("seen", &[SPLATS]).unwrap().to_vec();
    for (i, (with_masks, without)) in with_masks.iter().zip(&without).enumerate() {
        let part = if i % 6 < 3 { 2.0 / 3.0 } else { 1.0 / 3.0 };
        assert!((with_masks / without - part).abs() < 0.07, "{i}: {with_masks} of {without}");
    }
    picture(2, 2, &|_| true).write_png(masks.join("7.png")).unwrap();
    refused("valid: expected files named as the cameras (0, 1, 2), found also 7");
    std::fs::rename(masks.join("7.png"), masks.join("2.png")).unwrap();
    std::fs::write(masks.join("2.png"), b"no picture").unwrap();
    refused("2.png");
}

#[test]
fn what_it_takes_is_said_beforehand() {
    let folder = folder();
    let plan = printed(folder.path(), &format!("{LIFT} --dry-run --block 1"));
    for part in ["24 Gaussians, 3 views, 2 channels in 2 blocks", "at most 11 passes", "memory, about"] {
        assert!(plan.contains(part), "{plan}");
    }
    assert!(!folder.path().join("lifted.safetensors").exists() && !folder.path().join("lifted-pictures").exists());
}

#[test]
fn features_that_do_not_fit_the_cameras_are_refused() {
    let folder = folder();
    let features = folder.path().join("features");
    let refused = |part: &str| {
        let message = refused(folder.path(), LIFT, 1);
        assert!(message.contains(part) && message.lines().count() == 1, "{message}");
        assert!(!folder.path().join("lifted.safetensors").exists());
    };
    let second = features.join("2.npy");
    std::fs::rename(&second, features.join("x.npy")).unwrap();
    refused("expected files named as the cameras (0, 1, 2), found also x");
    std::fs::remove_file(features.join("x.npy")).unwrap();
    refused("features: expected features for each camera, found none for 2");
    floats(&second, &[1, 1, 3], &[1.0; 3]);
    refused("2.npy: expected 2 channels, as features/0.npy has, found 3");
    floats(&second, &[1, 1, 0], &[]);
    refused("2.npy: expected pixels with at least one channel, found [1, 1, 0]");
    floats(&second, &[1, 2], &[1.0; 2]);
    refused("2.npy: expected an array [height, width, channels], found [1, 2]");
    npy(&second, &[1, 1, 2], "<f8", &[0; 16]);
    refused("2.npy: descr: expected <f4 or <f2");
    std::fs::write(&second, b"nothing of the kind").unwrap();
    refused("2.npy: header: expected a complete NPY file");
    let mut tensors = Tensors::default();
    tensors.insert("features", &[1, 1, 2], vec![1_i32, 2]);
    tensors.write(features.join("2.safetensors")).unwrap();
    refused("expected one file for each camera");
    std::fs::remove_file(&second).unwrap();
    refused("tensor features: expected F32, F16 or BF16, found I32");
    std::fs::remove_dir_all(&features).unwrap();
    refused("features");
}

#[test]
fn scenes_and_settings_that_make_no_sense_are_refused() {
    let folder = folder();
    for (flags, part) in [
        ("--tikhonov 0", "positive"),
        ("--mu=-1", "--mu"),
        ("--passes 0", "--passes"),
        ("--smallest 9", "--aggregate"),
        ("--overlap 0.5", "--aggregate"),
        ("--aggregate masks --overlap 1", "expected a number of at least 0 and below 1"),
    ] {
        let message = refused(folder.path(), &format!("{LIFT} {flags}"), 2);
        assert!(message.contains(part), "{message}");
    }
    assert!(refused(folder.path(), "lift scene.ply", 2).contains("--features"));
    assert!(refused(folder.path(), "lift --demo 1 --features features", 2).contains("cannot be used"));
    let mut behind = gaussians();
    behind.means.iter_mut().for_each(|mean| mean[2] -= 50.0);
    write_gaussians(folder.path().join("scene.ply"), &behind).unwrap();
    let message = refused(folder.path(), LIFT, 1);
    assert!(message.contains("cameras: expected views that see some of the 24 Gaussians, found none"), "{message}");
    write_gaussians(folder.path().join("scene.ply"), &Gaussians::default()).unwrap();
    assert!(refused(folder.path(), LIFT, 1).contains("scene.ply: expected Gaussians, found none"));
}

#[test]
fn queries_that_do_not_fit_are_refused() {
    let folder = folder();
    printed(folder.path(), LIFT);
    let refused = |part: &str| {
        let message = refused(folder.path(), QUERY, 1);
        assert!(message.contains(part) && !folder.path().join("maps").exists(), "{message}");
    };
    let prompts = folder.path().join("prompts.npy");
    floats(&prompts, &[1, 3], &[1.0; 3]);
    refused("prompts.npy: expected prompts [prompts, 2], found [1, 3]");
    floats(&prompts, &[2, 2], &[1.0, 0.0, 0.0, 0.0]);
    refused("prompts.npy: expected prompts of some length, found 0 for prompt 1");
    floats(&prompts, &[1, 2], &[1.0, 0.0]);
    let mut fewer = gaussians();
    write_gaussians(folder.path().join("other.ply"), &fewer).unwrap();
    fewer.means.truncate(20);
    fewer.log_scales.truncate(20);
    fewer.quats.truncate(20);
    fewer.opacity_logits.truncate(20);
    fewer.sh.truncate(60);
    write_gaussians(folder.path().join("scene.ply"), &fewer).unwrap();
    refused("lifted.safetensors: expected features of 20 Gaussians, as scene.ply has, found 24");
    // The same number of Gaussians, but moved.
    let mut moved = gaussians();
    moved.means[0][0] += 0.1;
    write_gaussians(folder.path().join("scene.ply"), &moved).unwrap();
    let done = splatweaver(folder.path(), QUERY);
    assert!(
        done.status.success() && text(&done.stderr).contains("lifted to other Gaussians"),
        "{}",
        text(&done.stderr)
    );
    Tensors::default().write(folder.path().join("lifted.safetensors")).unwrap();
    assert!(text(&splatweaver(folder.path(), QUERY).stderr).contains("lifted.safetensors: tensor features"));
}
