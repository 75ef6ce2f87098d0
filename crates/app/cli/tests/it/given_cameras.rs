//! Given cameras: which photo has which, how long they are, and the points that come with them.

use crate::capture;
use crate::in_process::splatweaver;
use crate::run::Run;
use std::path::{Path, PathBuf};
use weaver_data::capture::CaptureOptions;
use weaver_data::{Scene, evaluation_tuples};
use weaver_geometry::glam::DVec3;
use weaver_inference::{Density, Prediction, Predictor, SplatWeaverPredictor};
use weaver_io::{Background, Image, Transforms};
use weaver_kernels::random::Stream;
use weaver_scene::Frame;
use weaver_trainer::{CameraMode, Example};

/// A capture at the size of a run's network.
fn loaded(run: &Path, capture: &Path) -> Scene {
    let [height, width] = SplatWeaverPredictor::open(run).unwrap().image_size();
    let options = CaptureOptions { width, height, ..CaptureOptions::default() };
    weaver_data::capture::load(capture, &options).unwrap()
}

/// Result of an evaluation with points for the first held-out view's context, and the names of its photos.
fn evaluated(run: &Path, capture: &Path) -> (Vec<PathBuf>, Prediction, Vec<Image>) {
    let mut predictor = SplatWeaverPredictor::open(run).unwrap();
    let scene = loaded(run, capture);
    let tuple = evaluation_tuples(&scene, 0, 3).remove(0);
    let photos = tuple.context.iter().map(|v| capture.join("images").join(&scene.views[*v].name)).collect();
    let (example, measured) = Example::for_evaluation(&scene, tuple).unwrap();
    let points = example.points(&scene);
    let source = example.camera_source(CameraMode::Given, measured, points.as_ref());
    let stream = Stream::new(0, 0, "test");
    let prediction = predictor.predict(example.context_photos(), source, Density::default(), stream).unwrap();
    let renders = predictor.render(&prediction, &prediction.cameras).unwrap();
    (photos, prediction, renders)
}

/// Promise (results): `infer --cameras` with a capture that has points takes its scale from the points that the
/// photos see, and renders what `eval` renders of the same photos.
#[test]
fn infer_and_eval_make_the_same_of_the_same_photos() {
    let run = Run::shared();
    let (photos, prediction, renders) = evaluated(&run.path(), &run.data());
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path();
    let (a, b, c) = (&photos[0], &photos[1], &photos[2]);
    let done = splatweaver(&[&"infer", &"--run", &run.path(), a, b, c, &"--cameras", &run.data(), &"-o", &out]).fine();
    for said in ["the points that the photos see is 1", "depth was brought to the points"] {
        assert!(done.stderr.contains(said), "{}", done.stderr);
    }
    assert!(prediction.points_used.iter().all(|n| *n > 5), "{:?}", prediction.points_used);
    let written = Transforms::read(out.join("transforms.json")).unwrap().frames;
    for (frame, camera) in written.iter().zip(&prediction.cameras) {
        let apart = frame.camera.pose.center().distance(camera.pose.center());
        assert!(apart < 1e-5, "{apart}");
    }
    // The factor is from the capture's units to units in which the visible points lie at a mean distance of 1.
    let scene = loaded(&run.path(), &run.data());
    let [from, to] = [0, 1].map(|i| {
        let name = photos[i].file_name().unwrap().to_string_lossy().into_owned();
        scene.views.iter().find(|view| view.name == name).unwrap().camera.pose.center()
    });
    let used = written[0].camera.pose.center().distance(written[1].camera.pose.center());
    let factor = said_factor(&done.stderr);
    assert!((factor - used / from.distance(to)).abs() < 1e-3 * factor, "{factor} {used} {from} {to}");
    for (photo, render) in photos.iter().zip(&renders) {
        let written = Image::read(out.join("render").join(photo.file_name().unwrap()), Background::White).unwrap();
        assert_eq!(written.to_bytes(), render.to_bytes(), "{}", photo.display());
    }
}

/// Without points cameras are as long as the predicted ones.
///
/// Promise (results): `infer --cameras` without points takes the scale of the predicted cameras, and prints the factor.
#[test]
fn without_points_predicted_cameras_set_the_scale() {
    let run = Run::shared();
    let folder = tempfile::tempdir().unwrap();
    let transforms = capture::transforms(&folder.path().join("capture"), capture::VIEWS);
    let (photos, out) = (folder.path().join("capture/images"), folder.path().join("out"));
    let done = splatweaver(&[&"infer", &"--run", &run.path(), &photos, &"--cameras", &transforms, &"-o", &out]).fine();
    assert!(done.stderr.contains("equals that of the predicted ones"), "{}", done.stderr);
    assert!(!done.stderr.contains("points"), "{}", done.stderr);
    let centers = |path: &Path| -> Vec<DVec3> {
        Transforms::read(path).unwrap().frames.iter().map(|frame| frame.camera.pose.center()).collect()
    };
    let mean = |centers: &[DVec3]| -> f64 {
        centers[1..].iter().map(|center| center.distance(centers[0])).sum::<f64>() / (centers.len() - 1) as f64
    };
    let alone = folder.path().join("alone");
    splatweaver(&[&"infer", &"--run", &run.path(), &photos, &"-o", &alone]).fine();
    let [given, used, predicted] =
        [transforms, out.join("transforms.json"), alone.join("transforms.json")].map(|path| mean(&centers(&path)));
    assert!((used - predicted).abs() < 1e-4 * predicted, "{used} {predicted}");
    assert!((said_factor(&done.stderr) - used / given).abs() < 1e-3, "{} {used} {given}", done.stderr);
}

/// The factor that `infer` says it scaled centers by.
fn said_factor(stderr: &str) -> f64 {
    let said = stderr.split("centers were scaled by ").nth(1).unwrap();
    said.split(',').next().unwrap().parse().unwrap()
}

/// Photos of one name in two folders have cameras of their own.
///
/// Promise (results): photos of one name in two folders have cameras of their own; ambiguous names are listed.
#[test]
fn photos_of_one_name_in_two_folders() {
    let run = Run::shared();
    let folder = tempfile::tempdir().unwrap();
    let read = Transforms::read(capture::transforms(&folder.path().join("capture"), 4)).unwrap().frames;
    let names = ["a/1.png", "a/2.png", "b/1.png"];
    for (name, frame) in names.iter().zip(&read) {
        let photo = folder.path().join("photos").join(name);
        std::fs::create_dir_all(photo.parent().unwrap()).unwrap();
        std::fs::copy(&frame.path, photo).unwrap();
    }
    let frames = names.iter().zip(&read).map(|(name, frame)| Frame::new(*name, frame.camera)).collect();
    let cameras = folder.path().join("photos/cameras.json");
    Transforms { frames, ..Transforms::default() }.write(&cameras).unwrap();
    let [a, two, b] = names.map(|name| folder.path().join("photos").join(name));
    let out = folder.path().join("out");
    splatweaver(&[&"infer", &"--run", &run.path(), &a, &b, &"--cameras", &cameras, &"-o", &out]).fine();
    let written = Transforms::read(out.join("transforms.json")).unwrap().frames;
    let turned = written[0].camera.pose.angle_to(&written[1].camera.pose);
    let expected = read[0].camera.pose.angle_to(&read[2].camera.pose);
    assert!(expected > 0.01 && (turned - expected).abs() < 1e-6, "{turned} {expected}");

    // The same folder without one of the names, and a photo elsewhere.
    let elsewhere = folder.path().join("1.png");
    std::fs::copy(&a, &elsewhere).unwrap();
    let out = folder.path().join("none");
    let infer = |photo: &Path| {
        splatweaver(&[&"infer", &"--run", &run.path(), &photo, &two, &"--cameras", &cameras, &"-o", &out])
    };
    infer(&elsewhere).refused(1, &["cameras.json", "several", "a/1.png", "b/1.png"]);
    infer(&read[3].path).refused(1, &["cameras.json", "none for", "03.png"]);
    assert!(!out.exists());
}

#[test]
fn an_evaluation_with_points_says_so() {
    let run = Run::shared();
    let eval = |more: &[&str]| {
        let path = run.path();
        let mut arguments: Vec<&dyn AsRef<std::ffi::OsStr>> = vec![&"eval", &"--run", &path];
        arguments.extend(more.iter().map(|argument| argument as &dyn AsRef<std::ffi::OsStr>));
        splatweaver(&arguments)
    };
    let figures = |more: &[&str]| -> serde_json::Value { serde_json::from_str(&eval(more).fine().stdout).unwrap() };
    let without = figures(&["--cameras", "given", "--json"]);
    let with = figures(&["--cameras", "given", "--points", "--json"]);
    assert!(without.get("points").is_none() && with["points"] == true);
    assert_ne!(without["mean"]["psnr"], with["mean"]["psnr"]);
    let table = eval(&["--cameras", "given", "--points"]).fine().stdout;
    assert!(table.contains("cameras given with points"), "{table}");
    eval(&["--cameras", "predicted", "--points"]).refused(2, &["--points", "given"]);
}
