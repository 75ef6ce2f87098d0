//! Given cameras: which photo has which, how long they are, and the points that come with them.

use crate::capture;
use crate::command::splatweaver;
use crate::run::Run;
use std::path::{Path, PathBuf};
use weaver_data::capture::CaptureOptions;
use weaver_data::{Scene, evaluation_tuples};
use weaver_inference::{Density, Prediction, Predictor, SplatWeaverPredictor};
use weaver_io::{Background, Image, Transforms};
use weaver_kernels::random::Stream;
use weaver_scene::Frame;
use weaver_trainer::{CameraMode, Example};

/// What an evaluation with points makes of the first held-out view's context, and the names of its photos.
fn evaluated(run: &Path, capture: &Path) -> (Vec<PathBuf>, Prediction, Vec<Image>) {
    let mut predictor = SplatWeaverPredictor::open(run).unwrap();
    let [height, width] = predictor.image_size();
    let options = CaptureOptions { width, height, ..CaptureOptions::default() };
    let scene: Scene = weaver_data::capture::load(capture, &options).unwrap();
    let tuple = evaluation_tuples(&scene, 0, 3).remove(0);
    let photos = tuple.context.iter().map(|v| capture.join("images").join(&scene.views[*v].name)).collect();
    let (example, measured) = Example::for_evaluation(&scene, tuple).unwrap();
    let points = example.points(&scene);
    let source = example.camera_source(CameraMode::Given, measured, points.as_ref());
    let stream = Stream::new(0, 0, "test");
    let prediction = predictor.predict(example.context_photos(), source, Density::default(), stream).unwrap();
    let renders = predictor.render(&prediction.gaussians, &prediction.cameras).unwrap();
    (photos, prediction, renders)
}

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
    for (photo, render) in photos.iter().zip(&renders) {
        let written = Image::read(out.join("render").join(photo.file_name().unwrap()), Background::White).unwrap();
        let largest = written.pixels.iter().zip(&render.pixels).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(largest <= 1.0 / 255.0, "{largest}");
    }
}

#[test]
fn without_points_cameras_are_as_long_as_the_predicted_ones() {
    let run = Run::shared();
    let folder = tempfile::tempdir().unwrap();
    let transforms = capture::transforms(&folder.path().join("capture"), capture::VIEWS);
    let (photos, out) = (folder.path().join("capture/images"), folder.path().join("out"));
    let done = splatweaver(&[&"infer", &"--run", &run.path(), &photos, &"--cameras", &transforms, &"-o", &out]).fine();
    assert!(done.stderr.contains("equals that of the predicted ones"), "{}", done.stderr);
    assert!(!done.stderr.contains("points"), "{}", done.stderr);
}

#[test]
fn photos_of_one_name_in_two_folders_have_cameras_of_their_own() {
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
