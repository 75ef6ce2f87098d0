//! One file of Gaussians against photos: photos that are pictures of it, so that the figures are known.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_io::{Background, Image, Transforms, write_gaussians};
use weaver_scene::{Frame, Gaussians};
use weaver_splat::{RasterSettings, Workspace, render};

const WIDTH: usize = 40;
const HEIGHT: usize = 30;
/// A color that eight bits hold exactly.
const GRAY: [f32; 3] = [0.4; 3];

fn splatweaver(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_splatweaver")).current_dir(folder).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The figures of a comparison with these flags.
fn evaluate(folder: &Path, flags: &[&str]) -> Value {
    let done = splatweaver(folder, &[&["compare", "--json"], flags].concat());
    assert!(done.status.success(), "{flags:?}: {}", text(&done.stderr));
    serde_json::from_slice(&done.stdout).unwrap()
}

fn psnr(report: &Value) -> f64 {
    report["mean"]["psnr"].as_f64().unwrap()
}

/// Large and small Gaussians in several colors, at depths of 2 to 3.
pub fn gaussians() -> Gaussians {
    let mut scene = Gaussians { degree: 0, ..Gaussians::default() };
    for i in 0..24 {
        let at = |step: usize| (i * step % 24) as f32 / 24.0;
        scene.means.push([at(5) * 2.0 - 1.0, at(7) * 1.5 - 0.75, 2.0 + at(11)]);
        scene.log_scales.push([if i % 2 == 0 { -1.8 } else { -4.5 }; 3]);
        scene.quats.push([1.0, 0.0, 0.0, 0.0]);
        scene.opacity_logits.push(1.0);
        scene.sh.extend([at(1) * 3.0 - 1.5, at(13) * 3.0 - 1.5, 1.0 - at(17)]);
    }
    scene
}

fn frames() -> Vec<Frame> {
    let intrinsics = Intrinsics { fx: 36.0, fy: 36.0, cx: 20.0, cy: 15.0 };
    let camera = |i: usize| {
        let mut pose = Pose::IDENTITY;
        pose.translation.x = 0.05 * i as f64;
        Camera { pose, intrinsics, width: WIDTH, height: HEIGHT }
    };
    (0..10).map(|i| Frame::new(format!("{i:02}.png"), camera(i))).collect()
}

/// A folder with scene.ply, and in `capture` its pictures by these settings, with `held_out` listed for the test.
pub fn folder(settings: &RasterSettings, held_out: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let capture = folder.path().join("capture");
    std::fs::create_dir(&capture).unwrap();
    write_gaussians(folder.path().join("scene.ply"), &gaussians()).unwrap();
    let frames = frames();
    for frame in &frames {
        let drawn =
            render(&gaussians().to_activated(), &[frame.camera], GRAY, settings, &mut Workspace::new()).unwrap();
        let image = Image { width: WIDTH, height: HEIGHT, pixels: drawn.concat() };
        image.write_png(capture.join(&frame.name)).unwrap();
    }
    let test_filenames = (!held_out.is_empty()).then(|| held_out.iter().map(|name| (*name).into()).collect());
    Transforms { frames, test_filenames, ..Transforms::default() }.write(capture.join("transforms.json")).unwrap();
    folder
}

const SCENE: &[&str] = &["scene.ply", "--data", "capture"];

#[test]
fn a_scene_meets_its_own_pictures() {
    let folder = folder(&RasterSettings::default(), &["03.png", "07.png"]);
    let flags = [SCENE, &["--background", "0.4,0.4,0.4"]].concat();
    let report = evaluate(folder.path(), &flags);
    // Rounding to 8 bits leaves 10 log10(255^2 12) = 58.9 dB where Gaussians are, and more with the background.
    assert!((58.0..75.0).contains(&psnr(&report)), "{report}");
    assert!(report["mean"]["ssim"].as_f64().unwrap() > 0.999, "{report}");
    assert_eq!(report["mean"]["lpips"], Value::Null);
    assert_eq!(
        (&report["scene"], &report["gaussians"], &report["held_out"]),
        (&"scene.ply".into(), &24.into(), &true.into())
    );
    let views = report["views"].as_array().unwrap();
    let names: Vec<&str> = views.iter().map(|view| view["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["03.png", "07.png"]);
    let mean = views.iter().map(|view| view["psnr"].as_f64().unwrap()).sum::<f64>() / 2.0;
    assert!((mean - psnr(&report)).abs() < 1e-12);

    let table = text(&splatweaver(folder.path(), &[&["compare"], &flags[..]].concat()).stdout);
    let rows: Vec<&str> = table.lines().collect();
    assert_eq!(rows.len(), 5, "{table}");
    assert!(rows[0].starts_with("view") && rows[1].starts_with("03.png") && rows[3].starts_with("mean"), "{table}");
    assert!(rows[3].contains(&format!("{:.2}", psnr(&report))), "{table}");
    assert!(rows[4].contains("2 (held out)") && rows[4].contains("24"), "{table}");
}

#[test]
fn flags_say_how_the_scene_is_drawn() {
    let settings = RasterSettings { antialiased: true, near: 2.5, ..RasterSettings::default() };
    let folder = folder(&settings, &["03.png"]);
    let drawn = ["--background=0.4,0.4,0.4", "--antialiased", "--near=2.5"];
    let right = psnr(&evaluate(folder.path(), &[SCENE, &drawn].concat()));
    assert!(right > 58.0, "{right}");
    // Each of them counts.
    for left_out in 0..3 {
        let flags: Vec<&str> = (0..3).filter(|i| *i != left_out).map(|i| drawn[i]).collect();
        let wrong = psnr(&evaluate(folder.path(), &[SCENE, &flags].concat()));
        assert!(wrong < right - 10.0, "without {}: {wrong}", drawn[left_out]);
    }
    // Nothing but the background: the error can be computed.
    let empty = psnr(&evaluate(folder.path(), &[SCENE, &["--near", "1e6", "--background", "black"]].concat()));
    let photo = Image::read(folder.path().join("capture/03.png"), Background::White).unwrap();
    let squares = photo.pixels.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>() / photo.pixels.len() as f64;
    assert!((empty + 10.0 * squares.log10()).abs() < 1e-3, "{empty}");
}

#[test]
fn a_summary_beside_the_scene_says_it_unless_flags_do() {
    let settings = RasterSettings { antialiased: true, near: 2.5, ..RasterSettings::default() };
    let folder = folder(&settings, &["03.png"]);
    let summary = folder.path().join("summary.json");
    std::fs::write(&summary, r#"{"antialiased": true, "near": 2.5, "background": [0.4, 0.4, 0.4], "steps": 1}"#)
        .unwrap();
    let by_summary = evaluate(folder.path(), SCENE);
    assert!(psnr(&by_summary) > 58.0, "{by_summary}");
    for flag in ["--antialiased=false", "--near=0.01", "--background=black"] {
        let other = evaluate(folder.path(), &[SCENE, &[flag]].concat());
        assert!(psnr(&other) < psnr(&by_summary) - 10.0, "{flag}: {other}");
    }
    // The summary of a training run has none of these keys.
    std::fs::write(&summary, r#"{"preset": "micro"}"#).unwrap();
    let without = evaluate(folder.path(), SCENE);
    std::fs::remove_file(&summary).unwrap();
    assert_eq!(without, evaluate(folder.path(), SCENE));
}

#[test]
fn photos_are_shrunk_and_every_format_is_read() {
    let folder = folder(&RasterSettings::default(), &["03.png"]);
    let flags = ["--data", "capture", "--background", "0.4,0.4,0.4"];
    let small = evaluate(folder.path(), &[&["scene.ply", "--long-side", "20"], &flags[..]].concat());
    let whole = evaluate(folder.path(), &[&["scene.ply", "--long-side", "40"], &flags[..]].concat());
    // A shrunk photo and a small drawing differ in their blur.
    assert!((15.0..45.0).contains(&psnr(&small)) && psnr(&whole) > 58.0, "{small} {whole}");
    for name in ["scene.splat", "scene.spz"] {
        write_gaussians(folder.path().join(name), &gaussians()).unwrap();
        let report = evaluate(folder.path(), &[&[name], &flags[..]].concat());
        assert!(psnr(&report) > 30.0 && report["gaussians"] == 24, "{name}: {report}");
    }
    // Too small for SSIM's window.
    let tiny = evaluate(folder.path(), &[&["scene.ply", "--long-side", "8"], &flags[..]].concat());
    assert_eq!(tiny["mean"]["ssim"], Value::Null);
}

#[test]
fn photos_that_are_not_judged_are_not_decoded() {
    let folder = folder(&RasterSettings::default(), &["03.png"]);
    let whole = evaluate(folder.path(), SCENE);
    // The header is whole, so that cameras and sizes fit; the pixels are gone.
    let other = folder.path().join("capture/04.png");
    let bytes = std::fs::read(&other).unwrap();
    std::fs::write(&other, &bytes[..64]).unwrap();
    assert_eq!(evaluate(folder.path(), SCENE), whole);
}

#[test]
fn every_view_counts_where_none_is_held_out() {
    let folder = folder(&RasterSettings::default(), &[]);
    // By default an eighth is held out ...
    let report = evaluate(folder.path(), SCENE);
    assert_eq!((report["views"].as_array().unwrap().len(), &report["held_out"]), (2, &true.into()));
    // ... and nothing on request.
    let split = folder.path().join("split");
    std::fs::create_dir(&split).unwrap();
    let transforms = std::fs::read_to_string(folder.path().join("capture/transforms.json")).unwrap();
    let transforms = transforms.replace("\"file_path\": \"", "\"file_path\": \"../capture/");
    std::fs::write(split.join("transforms_train.json"), &transforms).unwrap();
    let none = Transforms { frames: Vec::new(), ..Transforms::default() };
    none.write(split.join("transforms_test.json")).unwrap();
    let done = splatweaver(folder.path(), &["compare", "scene.ply", "--data", "split", "--json"]);
    let stderr = text(&done.stderr);
    assert!(stderr.contains("split: no photo is held out"), "{stderr}");
    let report: Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!((report["views"].as_array().unwrap().len(), &report["held_out"]), (10, &false.into()));
}

#[test]
fn wrong_usage_is_code_2() {
    let folder = folder(&RasterSettings::default(), &[]);
    for (flags, part) in [
        (&["--data", "capture"][..], "SCENE"),
        (&["scene.ply"], "--data"),
        (&["scene.ply", "--data", "capture", "--data", "capture"], "cannot be used multiple times"),
        (&["scene.ply", "--data", "capture", "--near", "0"], "expected a positive number"),
        (&["scene.ply", "--data", "capture", "--background", "gray"], "white or black"),
        (&["scene.ply", "--data", "capture", "--long-side", "0"], "--long-side"),
        // Flags of networks.
        (&["scene.ply", "--data", "capture", "--run", "a"], "--run"),
        (&["scene.ply", "--data", "capture", "--views", "3"], "--views"),
    ] {
        let done = splatweaver(folder.path(), &[&["compare"], flags].concat());
        let stderr = text(&done.stderr);
        assert_eq!(done.status.code(), Some(2), "{flags:?}: {stderr}");
        assert!(stderr.contains(part), "{flags:?}: {stderr}");
    }
}

#[test]
fn bad_files_are_named_in_one_line() {
    let folder = folder(&RasterSettings::default(), &[]);
    let write = |name: &str, content: &str| std::fs::write(folder.path().join(name), content).unwrap();
    write("broken.ply", "ply\nformat ascii 1.0\nelement vertex many\nend_header\n");
    write("weights.safetensors", "nothing");
    let fails = |flags: &[&str], parts: &[&str]| {
        let done = splatweaver(folder.path(), &[&["compare"], flags].concat());
        let stderr = text(&done.stderr);
        assert_eq!((done.status.code(), stderr.lines().count(), done.stdout.len()), (Some(1), 1, 0), "{stderr}");
        assert!(parts.iter().all(|part| stderr.contains(part)), "{stderr}");
    };
    fails(&["missing.ply", "--data", "capture"], &["missing.ply"]);
    fails(&["broken.ply", "--data", "capture"], &["broken.ply"]);
    fails(&["scene.ply", "--data", "nowhere"], &["nowhere"]);
    fails(&[SCENE, &["--lpips", "weights.safetensors"]].concat(), &["weights.safetensors"]);
    write("summary.json", "{\"near\": \"far\"}");
    fails(SCENE, &["summary.json: near: expected a positive number, found \"far\""]);
    std::fs::remove_file(folder.path().join("summary.json")).unwrap();
    std::fs::remove_file(folder.path().join("capture/00.png")).unwrap();
    fails(SCENE, &["00.png"]);
}
