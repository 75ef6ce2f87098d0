//! Captures of Nerfies and HyperNeRF.

use std::fs;
use std::path::Path;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_io::nerfies::Capture;

pub const CAMERA: &str = r#"{"orientation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]], "position": [1.0, 2.0, 3.0], "focal_length": 40.0,
    "principal_point": [10.0, 7.5], "pixel_aspect_ratio": 1.1, "skew": 0.0, "radial_distortion": [0.0, 0.0, 0.0],
    "tangential_distortion": [0.0, 0.0], "image_size": [20, 16]}"#;

/// A capture of two photos by one camera.
pub fn written(folder: &Path) {
    fs::create_dir(folder.join("camera")).unwrap();
    for (name, text) in [
        ("scene.json", r#"{"scale": 0.5, "center": [0.0, 2.0, 1.0], "near": 0.1}"#),
        ("dataset.json", r#"{"count": 3, "ids": ["a", "b", "c"], "train_ids": ["a"], "val_ids": ["b"]}"#),
        ("metadata.json", r#"{"a": {"warp_id": 3, "camera_id": 0}, "b": {"time_id": 4}, "c": {}}"#),
        ("camera/a.json", CAMERA),
        ("camera/b.json", CAMERA),
    ] {
        fs::write(folder.join(name), text).unwrap();
    }
}

#[test]
fn cameras_are_centered_and_scaled() {
    let folder = tempfile::tempdir().unwrap();
    written(folder.path());
    let capture = Capture::read(folder.path()).unwrap();
    assert_eq!((capture.frames.len(), capture.unused), (2, 1));
    let [a, b] = &capture.frames[..] else { panic!("{:?}", capture.frames) };
    assert_eq!((a.moment, b.moment, a.validation, b.validation), (3.0, 4.0, false, true));
    // (1, 2, 3) is centered to (1, 0, 2) and scaled.
    assert!(a.camera.pose.center().distance(DVec3::new(0.5, 0.0, 1.0)) < 1e-12);
    // A point 2 before the camera and 0.1 along the world's y axis, which is the camera's -x.
    let seen = a.camera.intrinsics.project(a.camera.pose.apply(DVec3::new(0.5, 0.1, 3.0)));
    assert!(seen.distance(DVec2::new(10.0 - 0.1 / 2.0 * 40.0, 7.5)) < 1e-9, "{seen}");
    let across = a.camera.intrinsics.project(a.camera.pose.apply(DVec3::new(0.6, 0.0, 3.0)));
    assert!(across.distance(DVec2::new(10.0, 7.5 + 0.1 / 2.0 * 44.0)) < 1e-9, "{across}");

    assert_eq!(capture.points(folder.path()).unwrap(), None);
    weaver_io::write_npy(folder.path().join("points.npy"), &[1, 3], &[2.0, 2.0, 2.0]).unwrap();
    assert_eq!(capture.points(folder.path()).unwrap(), Some(vec![DVec3::new(1.0, 0.0, 0.5)]));
    weaver_io::write_npy(folder.path().join("points.npy"), &[3], &[2.0, 2.0, 2.0]).unwrap();
    let error = capture.points(folder.path()).unwrap_err().to_string();
    assert!(error.contains("points.npy: shape: expected [points, 3], found [3]"), "{error}");
}

#[test]
fn what_cannot_be_used_is_refused_by_its_key() {
    for (file, from, to, said) in [
        ("camera/a.json", r#""skew": 0.0"#, r#""skew": 0.1"#, "a.json: skew: expected 0"),
        ("camera/b.json", "[0.0, 0.0, 0.0]", "[0.0, 0.02, 0.0]", "b.json: radial_distortion: expected zeros"),
        ("camera/a.json", "[0.0, 0.0],", "[0.0, 1e-3],", "a.json: tangential_distortion: expected zeros"),
        ("camera/a.json", "[[0, -1, 0]", "[[0, 1, 0]", "a.json: orientation: expected the rows of a rotation"),
        ("camera/a.json", "[0, 0, 1]]", "[0, 0]]", "a.json: orientation: expected 3 rows of 3 numbers"),
        (
            "camera/a.json",
            r#""focal_length": 40.0"#,
            r#""focal_length": -1"#,
            "a.json: focal_length: expected a positive",
        ),
        ("camera/a.json", "[20, 16]", "[20, 0]", "a.json: image_size: expected width and height"),
        ("camera/a.json", r#""position""#, r#""place""#, "a.json: position: expected 3 numbers, found nothing"),
        ("scene.json", "0.5", "0", "scene.json: scale: expected a positive number, found 0"),
        ("scene.json", "[0.0, 2.0, 1.0]", "[0.0, 2.0]", "scene.json: center: expected 3 numbers, found [0.0,2.0]"),
        ("metadata.json", r#""warp_id": 3"#, r#""warp": 3"#, "metadata.json: a: expected warp_id or time_id"),
        ("dataset.json", "train_ids", "training", "dataset.json: train_ids: expected a list of strings, found nothing"),
        ("dataset.json", r#"["b"]"#, r#"["d"]"#, "d.json"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        written(folder.path());
        let text = fs::read_to_string(folder.path().join(file)).unwrap();
        assert!(text.contains(from), "{file}: {from}");
        fs::write(folder.path().join(file), text.replacen(from, to, 1)).unwrap();
        let error = Capture::read(folder.path()).unwrap_err().to_string();
        assert!(error.contains(said), "{file}: {to}: {error}");
    }
}
