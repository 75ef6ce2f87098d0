//! `fit`: results, determinism, going on after a stop, and bad input.

mod in_time;
#[cfg(unix)]
mod interrupted;

use crate::capture;
use crate::in_process::{Outcome, splatweaver};
use serde_json::Value;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use weaver_io::Image;

/// A fit of a small capture in a few steps.
fn fit(capture: &Path, out: &Path, more: &[&dyn AsRef<OsStr>]) -> Outcome {
    let mut line: Vec<&dyn AsRef<OsStr>> = vec![&"fit", &capture, &"-o", &out];
    line.extend(more);
    splatweaver(&line)
}

fn small(capture: &Path, out: &Path, more: &[&dyn AsRef<OsStr>]) -> Outcome {
    let mut all: Vec<&dyn AsRef<OsStr>> =
        vec![&"--steps", &"60", &"--gaussians", &"300", &"--set", &"density.rounds=6"];
    all.extend(more);
    fit(capture, out, &all)
}

fn captured(folder: &Path) -> PathBuf {
    let capture = folder.join("capture");
    std::fs::create_dir_all(&capture).unwrap();
    capture::colmap(&capture, capture::VIEWS);
    capture
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// A capture becomes a scene with all promised outputs.
#[test]
fn a_capture_becomes_a_scene() {
    let folder = tempfile::tempdir().unwrap();
    let (capture, out) = (captured(folder.path()), folder.path().join("out"));
    let done = small(&capture, &out, &[&"--also", &"splat", &"--also", &"spz", &"--exposure", &"--antialiased"]).fine();
    assert!(done.stdout.contains("held out") && done.stdout.contains("scene.ply"), "{}", done.stdout);
    let summary = json(&out.join("summary.json"));
    assert_eq!((&summary["steps"], &summary["size"]), (&60.into(), &serde_json::json!([40, 32])));
    assert_eq!((&summary["train"]["views"], &summary["test"]["views"]), (&8.into(), &2.into()));
    assert!(summary["gaussians"].as_u64().unwrap() <= 300);
    assert!(summary["train"]["psnr"].as_f64().unwrap() > 15.0, "{summary}");
    assert!(summary["test"]["ssim"].as_f64().is_some() && summary["test"]["lpips"].is_null());
    assert_eq!(summary["poses"]["refined"], false);
    for name in ["scene.ply", "scene.splat", "scene.spz", "run.json", "metrics.jsonl", "checkpoint.safetensors"] {
        assert!(out.join(name).is_file(), "{name}");
    }
    let report = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(report.contains("Held-out photos") && report.contains("data:image/png") && report.contains("<svg"));
    // The output is a capture and a scene again.
    let renders = folder.path().join("renders");
    let cameras = out.join("transforms.json");
    splatweaver(&[&"render", &out.join("scene.ply"), &"--cameras", &cameras, &"-o", &renders]).fine();
    splatweaver(&[&"info", &out.join("sparse/0")]).fine();
    small(&cameras, &folder.path().join("again"), &[&"--init", &out.join("scene.spz")]).fine();
    small(&cameras, &folder.path().join("predicted"), &[&"--init", &"network"]).fine();
    // Nothing is overwritten.
    small(&capture, &out, &[]).refused(2, &["a run exists there already", "--resume"]);
}

/// The same seed gives the same bits at any number of threads and another seed others.
#[test]
fn seeds_decide_the_bits_and_threads_do_not() {
    let folder = tempfile::tempdir().unwrap();
    let capture = captured(folder.path());
    let scene = |name: &str, more: &[&dyn AsRef<OsStr>]| {
        let out = folder.path().join(name);
        small(&capture, &out, more).fine();
        std::fs::read(out.join("scene.ply")).unwrap()
    };
    let one = scene("one", &[&"--threads", &"1"]);
    assert!(one == scene("two", &[&"--threads", &"2"]) && one == scene("three", &[&"--threads", &"3"]));
    assert!(one != scene("other", &[&"--seed", &"1"]));
    // A time becomes steps, some of them left out, and a start: a fit with the same steps and start gives the same
    // bits.
    let timed = folder.path().join("timed");
    fit(&capture, &timed, &[&"--minutes", &"0.05", &"--gaussians", &"300"]).fine();
    let settings = json(&timed.join("run.json"));
    let (steps, init) = (settings["fit"]["steps"].to_string(), settings["init"].as_str().unwrap());
    let left_out = settings["fit"]["thinned"].as_array().into_iter().flatten();
    let left_out: String =
        left_out.map(|of| format!("[[thinned]]\nat = {}\nkept = {}\n", of["at"], of["kept"])).collect();
    let (again, config) = (folder.path().join("timed-again"), folder.path().join("fit.toml"));
    std::fs::write(&config, left_out).unwrap();
    let line: [&dyn AsRef<OsStr>; 8] =
        [&"--steps", &steps, &"--init", &init, &"--gaussians", &"300", &"--config", &config];
    fit(&capture, &again, &line).fine();
    let read = |folder: &Path| std::fs::read(folder.join("scene.ply")).unwrap();
    assert!(read(&timed) == read(&again));
}

#[test]
fn masked_photos_a_size_and_few_views_are_respected() {
    let folder = tempfile::tempdir().unwrap();
    let (capture, out) = (captured(folder.path()), folder.path().join("out"));
    small(&capture, &out, &[&"--masks"]).refused(1, &["mask", "masks/", "no such file"]);
    std::fs::create_dir(capture.join("masks")).unwrap();
    for i in 0..capture::VIEWS {
        Image::filled(40, 32, [1.0; 3]).write_png(capture.join(format!("masks/{i:02}.png"))).unwrap();
    }
    small(&capture, &out, &[&"--masks", &"--long-side", &"20", &"--max-photos", &"3", &"--background", &"black"])
        .fine();
    let summary = json(&out.join("summary.json"));
    assert_eq!((&summary["size"], &summary["train"]["views"]), (&serde_json::json!([20, 16]), &3.into()));
    for i in 0..capture::VIEWS {
        Image::filled(40, 32, [0.0; 3]).write_png(capture.join(format!("masks/{i:02}.png"))).unwrap();
    }
    small(&capture, &folder.path().join("dark"), &[&"--masks"]).refused(1, &["photos", "pixels that count"]);
}

/// A dry run reports its cost and writes nothing.
#[test]
fn a_dry_run_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (capture, out) = (captured(folder.path()), folder.path().join("out"));
    let done = small(&capture, &out, &[&"--dry-run"]).fine();
    assert!(done.stdout.contains("8 photos of at most 40x32, 2 held out") && done.stdout.contains("at most"));
    let timed = done.stdout.contains("a step") && done.stdout.contains("by a rehearsal");
    assert!(timed && done.stdout.contains("between processes"), "{}", done.stdout);
    assert!(!out.exists());
}

#[test]
fn what_cannot_be_fitted_is_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let (capture, out) = (captured(folder.path()), folder.path().join("out"));
    let nothing = folder.path().join("nothing");
    fit(&nothing, &out, &[]).refused(1, &["nothing", "capture"]);
    std::fs::create_dir(&nothing).unwrap();
    fit(&nothing, &out, &[]).refused(1, &["cameras", "transforms.json"]);
    fit(&capture, &out, &[&"--gaussians", &"0"]).refused(2, &["--gaussians"]);
    fit(&capture, &out, &[&"--set", &"gaussians=0"]).refused(1, &["gaussians", "at least 1"]);
    fit(&capture, &out, &[&"--minutes", &"1", &"--steps", &"5"]).refused(2, &["--minutes", "--steps"]);
    fit(&capture, &out, &[&"--set", &"density.untill=0.5"]).refused(1, &["density.untill", "until"]);
    fit(&capture, &out, &[&"--set", &"density.until=7"]).refused(1, &["density.until", "0 to 1", "7"]);
    fit(&capture, &out, &[&"--refine-focal"]).refused(2, &["--refine-focal", "--refine-cameras"]);
    fit(&capture, &out, &[&"--init", &"nowhere.ply"]).refused(1, &["--init nowhere.ply", "found none"]);
    let other = folder.path().join("points.ply");
    std::fs::write(&other, "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n").unwrap();
    fit(&capture, &out, &[&"--init", &other]).refused(1, &["points.ply"]);
    splatweaver(&[&"fit", &"--resume", &nothing]).refused(1, &["run.json"]);
    // Too few photos: the only one is held out; with --all it is fitted, with a warning.
    let single = folder.path().join("single");
    std::fs::create_dir(&single).unwrap();
    capture::transforms(&single, 1);
    small(&single, &out, &[]).refused(1, &["photos", "1 held out"]);
    // A start from points is refused, as there are none.
    small(&single, &out, &[&"--hold-out", &"none", &"--init", &"points"]).refused(1, &["points", "none"]);
    // A pose that is no number.
    let transforms = single.join("transforms.json");
    let text = std::fs::read_to_string(&transforms).unwrap();
    let broken = folder.path().join("broken");
    std::fs::create_dir(&broken).unwrap();
    std::fs::write(broken.join("transforms.json"), text.replacen("1.0", "null", 1)).unwrap();
    small(&broken, &out, &[&"--hold-out", &"none"]).refused(1, &["transforms.json"]);
    assert!(!out.exists(), "nothing is left behind");
    let done = small(&single, &out, &[&"--hold-out", &"none"]).fine();
    assert!(done.stderr.contains("warning: one photo"), "{}", done.stderr);
}

#[test]
fn a_photo_of_something_else_is_named_in_the_report() {
    let folder = tempfile::tempdir().unwrap();
    let (capture, out) = (captured(folder.path()), folder.path().join("out"));
    let noise: Vec<f32> = (0..3 * 40 * 32).map(|i| ((i * 7919) % 256) as f32 / 255.0).collect();
    Image { width: 40, height: 32, pixels: noise }.write_png(capture.join("images/03.png")).unwrap();
    let done = fit(&capture, &out, &[&"--steps", &"400", &"--gaussians", &"600"]).fine();
    assert!(done.stderr.contains("03.png is met far worse"), "{}", done.stderr);
    assert!(std::fs::read_to_string(out.join("report.html")).unwrap().contains("met far worse than the others"));
}

#[test]
fn a_scene_without_harmonics_begins_a_fit() {
    let folder = tempfile::tempdir().unwrap();
    let (capture, out, again) = (captured(folder.path()), folder.path().join("out"), folder.path().join("again"));
    small(&capture, &out, &[&"--sh", &"0"]).fine();
    let scene = out.join("scene.ply");
    assert!(!String::from_utf8_lossy(&std::fs::read(&scene).unwrap()).contains("f_rest"), "no harmonics are written");
    small(&capture, &again, &[&"--init", &scene]).fine();
    assert_eq!(weaver_io::read_gaussians(again.join("scene.ply")).unwrap().degree, 3);
}

/// More memory than there is is refused before anything is written.
#[test]
fn too_much_memory_is_refused_before_writing() {
    let folder = tempfile::tempdir().unwrap();
    let (capture, out) = (captured(folder.path()), folder.path().join("out"));
    fit(&capture, &out, &[&"--set", &"gaussians=1000000000000"]).refused(75, &["memory"]);
    assert!(!out.exists());
}

#[test]
fn refined_cameras_are_told_of() {
    let folder = tempfile::tempdir().unwrap();
    let (capture, out) = (captured(folder.path()), folder.path().join("out"));
    let done = small(&capture, &out, &[&"--refine-cameras"]).fine();
    assert!(
        done.stderr.contains("matching 10 photos") && done.stderr.contains("cameras adjusted to"),
        "{}",
        done.stderr
    );
    let poses = &json(&out.join("summary.json"))["poses"];
    assert!(poses["refined"] == true && poses["points"].is_u64() && poses["focal"] == 1.0, "{poses}");
    assert!(
        std::fs::read_to_string(out.join("report.html")).unwrap().contains("Cameras were refined: photos agree about")
    );
}
