//! `convert`: every pair of formats, its errors, and edits of Gaussians on the way.

use crate::compare::gaussians;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use weaver_io::colmap::Model;
use weaver_io::{Image, SCENE_FORMATS, Transforms, read_gaussians, write_gaussians};

fn splatweaver(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_splatweaver")).current_dir(folder).args(arguments).output().unwrap()
}

fn convert(folder: &Path, arguments: &[&str]) -> Value {
    let done = splatweaver(folder, &[&["convert", "--json"], arguments].concat());
    assert!(done.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&done.stderr));
    serde_json::from_slice(&done.stdout).unwrap()
}

/// A folder with the scene of [`gaussians`] as scene.ply.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_gaussians(folder.path().join("scene.ply"), &gaussians()).unwrap();
    folder
}

/// Promise (kept): scenes pass from every format to every other within each format's rounding, and `convert` reports
/// the errors.
#[test]
fn every_pair_of_formats() {
    let folder = folder();
    let file = |name: &str, extension: &str| match extension {
        "meta.json" | "lod-meta.json" => format!("{name}/{extension}"),
        extension => format!("{name}.{extension}"),
    };
    let written: Vec<_> = SCENE_FORMATS.iter().filter(|format| format.is_written()).collect();
    for from in &written {
        let first = file("first", from.extension);
        let report = convert(folder.path(), &["scene.ply", &first]);
        assert_eq!((&report["gaussians"], &report["format"]), (&24.into(), &from.name.into()));
        for to in &written {
            let report = convert(folder.path(), &[&first, &file("second", to.extension)]);
            let largest = |what: &str| report[what]["largest"].as_f64().unwrap_or(0.0);
            // Quantization steps of .wsz follow the visibility of a Gaussian.
            let coarse = [from.name, to.name].contains(&"wsz");
            let (position, color) = if coarse { (5e-3, 0.08) } else { (2e-3, 0.02) };
            assert!(largest("position") < position && largest("color") < color, "{from} to {to}: {report}");
            // Where both formats keep floats, the round trip is exact.
            if from.name == "glb" && to.name == "ply" {
                let back = read_gaussians(folder.path().join("second.ply")).unwrap();
                assert_eq!((&back.means, &back.sh), (&gaussians().means, &gaussians().sh));
            }
        }
    }
}

/// Promise (kept): flags of `convert` are applied in the promised order.
#[test]
fn edits_happen_in_their_order() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    let report = convert(folder.path(), &["scene.ply", "scene.ply", "both.ply"]);
    assert_eq!((&report["read"], &report["gaussians"]), (&48.into(), &48.into()));
    // Half a turn about z, twice as large, moved by 10 along x: then a box around the Gaussians from x > 0.
    let flags = ["--rotate", "0,0,180", "--scale", "2", "--translate", "10,0,0", "--crop", "-100,-100,-100,10,100,100"];
    convert(folder.path(), &[&["scene.ply", "moved.ply"], &flags[..]].concat());
    let (scene, moved) = (gaussians(), read_gaussians(path("moved.ply")).unwrap());
    let right: Vec<usize> = (0..24).filter(|&i| scene.means[i][0] >= 0.0).collect();
    assert_eq!(moved.len(), right.len());
    for (found, &i) in moved.means.iter().zip(&right) {
        let [x, y, z] = scene.means[i];
        for (a, b) in found.iter().zip([10.0 - 2.0 * x, -2.0 * y, 2.0 * z]) {
            assert!((a - b).abs() < 1e-5, "{found:?}");
        }
    }
    convert(folder.path(), &["scene.ply", "some.ply", "--keep", "0.5", "--by", "importance"]);
    let some = read_gaussians(path("some.ply")).unwrap();
    assert!(some.len() == 12 && some.log_scales.iter().all(|s| s[0] == -1.8), "the large ones");
    assert_eq!(convert(folder.path(), &["scene.ply", "few.ply", "--keep", "7", "--drop-floaters"])["gaussians"], 7);
}

/// Gaussians that no camera sees go first, large ones too.
#[test]
fn what_shows_stays() {
    let folder = folder();
    let mut scene = gaussians();
    // Behind the only camera, at the origin.
    (0..6).for_each(|i| scene.means[4 * i][2] = -3.0);
    (0..24).filter(|i| i % 4 != 0).for_each(|i| scene.means[i] = [0.05 * i as f32 - 0.6, 0.0, 3.0]);
    write_gaussians(folder.path().join("scene.ply"), &scene).unwrap();
    let cameras = r#"{"fl_x":60,"fl_y":60,"cx":32,"cy":24,"w":64,"h":48,"frames":[{"file_path":"a.png",
        "transform_matrix":[[1,0,0,0],[0,-1,0,0],[0,0,-1,0],[0,0,0,1]]}]}"#;
    std::fs::write(folder.path().join("cameras.json"), cameras).unwrap();
    let flags = ["--keep", "18", "--by", "contribution", "--cameras", "cameras.json"];
    convert(folder.path(), &[&["scene.ply", "seen.ply"][..], &flags].concat());
    let seen = read_gaussians(folder.path().join("seen.ply")).unwrap();
    assert!(seen.len() == 18 && seen.means.iter().all(|mean| mean[2] == 3.0));
}

/// Promise of `every_pair_of_formats`.
#[test]
fn harmonics_that_are_left_out_are_counted() {
    let folder = folder();
    let mut scene = gaussians().with_degree(2);
    scene.sh.chunks_exact_mut(27).for_each(|row| row[3] = 0.5);
    write_gaussians(folder.path().join("scene.ply"), &scene).unwrap();
    let report = convert(folder.path(), &["scene.ply", "scene.splat"]);
    assert_eq!(report["degree"], 0);
    assert!(report["color"]["mean"].as_f64().unwrap() > 0.5 / (12.0 * std::f64::consts::PI).sqrt() - 0.01, "{report}");
    assert_eq!(convert(folder.path(), &["scene.ply", "scene.spz", "--degree", "1"])["degree"], Value::Null);
    assert_eq!(read_gaussians(folder.path().join("scene.spz")).unwrap().degree, 1);
    let done = splatweaver(folder.path(), &["convert", "scene.ply", "scene.splat"]);
    let text = String::from_utf8_lossy(&done.stdout).into_owned();
    assert!(
        text.contains("off by (mean, largest): positions 0.00e0") && text.contains("no harmonics beyond degree 0"),
        "{text}"
    );
}

#[test]
fn failures_are_one_line() {
    let folder = folder();
    for (arguments, code, expected) in [
        (&["convert", "scene.ply", "scene.ksplat"][..], 1, "ksplat, which is read only"),
        (&["convert", "scene.ply", "scene.obj"], 1, "file name: expected .ply"),
        (&["convert", "scene.ply", "scene.ply"], 2, "expected a place apart from what is read"),
        (&["convert", "gone.spz", "scene.splat"], 1, "gone.spz"),
    ] {
        let done = splatweaver(folder.path(), arguments);
        let text = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.code() == Some(code) && text.contains(expected) && text.lines().count() == 1, "{text}");
    }
    for wrong in [
        &["convert", "scene.ply"][..],
        &["convert", "scene.ply", "a.spz", "--crop", "1,2"],
        &["convert", "scene.ply", "a.spz", "--by", "opacity"],
        &["convert", "scene.ply", "a.spz", "--keep", "3", "--by", "contribution"],
    ] {
        assert_eq!(splatweaver(folder.path(), wrong).status.code(), Some(2), "{wrong:?}");
    }
}

/// Values that the target format cannot hold are refused, and an existing file stays.
///
/// Promise of `what_cannot_be_read_again_replaces_nothing`.
#[test]
fn what_a_format_cannot_hold_is_not_written() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    let mut wide = gaussians();
    wide.log_scales[5] = [100.0; 3];
    write_gaussians(path("wide.ply"), &wide).unwrap();
    for (arguments, name) in [
        (&["scene.ply", "old.ply", "--scale", "1e300"][..], "old.ply"),
        (&["scene.ply", "old.ply", "--translate", "1e39,0,0"], "old.ply"),
        (&["wide.ply", "old.glb"], "old.glb"),
        (&["wide.ply", "old.gltf"], "old.gltf"),
        (&["wide.ply", "old.splat"], "old.splat"),
    ] {
        std::fs::write(path(name), "old").unwrap();
        let done = splatweaver(folder.path(), &[&["convert"], arguments].concat());
        let text = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.code() == Some(1) && done.stdout.is_empty(), "{arguments:?}: {text}");
        assert!(text.starts_with(&format!("error: {name}: ")) && text.contains("finite numbers"), "{text}");
        assert_eq!(std::fs::read_to_string(path(name)).unwrap(), "old", "{arguments:?}");
    }
    let hidden = |name: &std::ffi::OsStr| name.as_encoded_bytes().starts_with(b".");
    let names = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name());
    assert_eq!(names.filter(|name| hidden(name)).count(), 0, "a temporary file was left");
}

/// Flags that leave no Gaussians are refused, and a scene that has none is written with a warning.
///
/// Promise (files): flags that leave no Gaussians are refused; a scene without any is written with a warning.
#[test]
fn an_empty_scene_is_not_written_without_a_word() {
    let folder = folder();
    for (flags, code, expected) in [
        (
            &["--crop", "90,90,90,1"][..],
            1,
            "--crop: expected Gaussians in the region, found none of 24, which lie from [",
        ),
        (&["--keep", "0.001"], 1, "--keep: expected a share that leaves Gaussians, found none of 24"),
        (&["--keep", "0"], 2, "expected a number of Gaussians, or a share above 0.0"),
        (&["--keep", "0.0"], 2, "expected a number of Gaussians, or a share above 0.0"),
    ] {
        let done = splatweaver(folder.path(), &[&["convert", "scene.ply", "none.ply"], flags].concat());
        let text = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.code() == Some(code) && text.contains(expected), "{flags:?}: {text}");
        assert!(!folder.path().join("none.ply").exists(), "{flags:?}");
    }
    write_gaussians(folder.path().join("empty.ply"), &gaussians().select(&[])).unwrap();
    let done = splatweaver(folder.path(), &["convert", "empty.ply", "none.spz", "--crop", "0,0,0,1", "--keep", "0.5"]);
    let text = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(done.status.success() && text.contains("warning: none.spz: a scene without Gaussians"), "{text}");
}

/// Promise (kept): `convert` writes cameras of other programs as transforms.json and COLMAP, with points, tracks and
/// the origin of the world; the photos stay where they are.
#[test]
fn cameras_of_other_programs_become_captures() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::create_dir(path("photos")).unwrap();
    for name in ["photos/a.png", "photos/b.png"] {
        Image { width: 60, height: 80, pixels: vec![0.5; 60 * 80 * 3] }.write_png(path(name)).unwrap();
    }
    let bundle = "# Bundle file v0.3\n2 1\n100 0.1 0\n1 0 0\n0 1 0\n0 0 1\n0 0 0\n200 0 0\n1 0 0\n0 1 0\n0 0 1\n-1 0 0\n\
        0 0 -10\n255 128 0\n2 0 5 0 0 1 0 -20 0\n";
    std::fs::write(path("bundle.out"), bundle).unwrap();
    std::fs::write(path("list.txt"), "photos/a.png\nphotos/b.png\n").unwrap();
    let report = convert(folder.path(), &["bundle.out", "made/capture"]);
    assert_eq!((&report["photos"], &report["points"]), (&2.into(), &1.into()));
    let model = Model::read(path("made/capture/sparse/0")).unwrap();
    assert_eq!(
        (model.points[0].track.as_slice(), model.images[0].name.as_str()),
        (&[(1, 0), (2, 0)][..], "../../photos/a.png")
    );
    let transforms = Transforms::read(path("made/capture/transforms.json")).unwrap();
    assert_eq!(transforms.frames[0].distortion, Some(weaver_geometry::Distortion::radial(0.1)));
    assert!((transforms.frames[1].camera.pose.center().x - 1.0).abs() < 1e-12);
    // From one to the other, moved.
    convert(folder.path(), &["made/capture", "moved.json", "--scale", "2", "--translate", "0,0,5"]);
    let moved = Transforms::read(path("moved.json")).unwrap();
    assert!((moved.frames[1].camera.pose.center() - weaver_geometry::glam::DVec3::new(2.0, 0.0, 5.0)).length() < 1e-9);
    // Far worlds keep their origin.
    let table =
        "#name,x,y,alt,heading,pitch,roll,f\na.png,500000,5400000,300,0,0,0,18\nb.png,500010,5400000,300,0,0,0,18\n";
    std::fs::write(path("cameras.csv"), table).unwrap();
    let report = convert(folder.path(), &["cameras.csv", "far.json"]);
    let offset = serde_json::json!([500005.0, 5400000.0, 300.0]);
    assert_eq!(report["origin"]["offset"], offset);
    let report = convert(folder.path(), &["far.json", "far"]);
    assert_eq!(report["origin"]["offset"], offset);
    assert_eq!(Transforms::read(path("far/transforms.json")).unwrap().frames[0].name, "../photos/a.png");
    let refused = splatweaver(folder.path(), &["convert", "cameras.csv", "far.json", "--keep", "5"]);
    assert_eq!(refused.status.code(), Some(2));
    // The files are captures as they are.
    assert!(splatweaver(folder.path(), &["info", "cameras.csv"]).status.success());
}
