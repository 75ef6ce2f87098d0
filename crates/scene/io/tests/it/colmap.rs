use crate::shared;
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Distortion, Intrinsics, Pose};
use weaver_io::colmap::{CameraModel, ImageRecord, Model, Point};
use weaver_io::ply::write_points;
use weaver_scene::{Frame, PointCloud};

/// A small model.
pub fn model() -> Model {
    let intrinsics = Intrinsics { fx: 100.0, fy: 101.5, cx: 32.0, cy: 24.25 };
    let cameras = BTreeMap::from([(3, CameraModel { width: 64, height: 48, intrinsics, distortion: None })]);
    let image = |id: u32, points| ImageRecord {
        id,
        name: format!("photo {id}.jpg"),
        camera_id: 3,
        pose: Pose::from_wxyz([0.9, 0.1, -0.2, f64::from(id) / 10.0], DVec3::new(0.1, 0.2, 0.3)),
        points,
    };
    let images = vec![image(1, vec![(1.5, 2.5, Some(7)), (3.0, 4.0, None)]), image(2, vec![])];
    let point = Point { id: 7, xyz: [0.1, -2.0, 3.0], rgb: [1, 2, 255], error: 0.5, track: vec![(1, 0)] };
    Model { cameras, images, points: vec![point] }
}

fn assert_close(a: &Model, b: &Model) {
    assert_eq!((&a.cameras, &a.points), (&b.cameras, &b.points));
    assert_eq!(a.images.len(), b.images.len());
    for (a, b) in a.images.iter().zip(&b.images) {
        assert_eq!((a.id, &a.name, a.camera_id, &a.points), (b.id, &b.name, b.camera_id, &b.points));
        assert_eq!(a.pose.translation, b.pose.translation);
        assert!((a.pose.rotation - b.pose.rotation).to_cols_array().iter().all(|d| d.abs() < 1e-14));
    }
}

#[test]
fn both_forms_round_trip() {
    let folder = tempfile::tempdir().unwrap();
    model().write_text(folder.path()).unwrap();
    model().write_binary(folder.path()).unwrap();
    assert_close(&Model::read(folder.path()).unwrap(), &model());
    for stem in ["cameras", "images", "points3D"] {
        std::fs::remove_file(folder.path().join(stem).with_extension("bin")).unwrap();
    }
    assert_close(&Model::read(folder.path()).unwrap(), &model());
}

fn camera_line(line: &str) -> Result<Model, String> {
    let folder = tempfile::tempdir().unwrap();
    Model { cameras: BTreeMap::new(), ..model() }.write_text(folder.path()).unwrap();
    std::fs::write(folder.path().join("cameras.txt"), line).unwrap();
    Model::read(folder.path()).map_err(|e| e.to_string())
}

#[test]
fn camera_models() {
    let radial = camera_line("3 SIMPLE_RADIAL 64 48 90 32 24 0").unwrap().cameras[&3];
    assert_eq!(radial.intrinsics, Intrinsics { fx: 90.0, fy: 90.0, cx: 32.0, cy: 24.0 });
    let opencv = camera_line("3 OPENCV 64 48 90 91 32 24 0 0 0 0").unwrap().cameras[&3];
    assert_eq!(opencv.intrinsics.fy, 91.0);
    let cases = [
        ("3 FOV 64 48 90 91 32 24 3.2", "camera 3 (FOV): expected a field of view from 0 to pi, found 3.2"),
        ("3 THIN_PRISM_FISHEYE 64 48 90 91 32 24 0.1", "expected 12 parameters of THIN_PRISM_FISHEYE, found 5"),
        ("3 RADIAL 64 48 90 32 24 0.1 inf", "camera 3 (RADIAL): expected finite distortion"),
        ("3 PINHOLE 64 48 90 91 32", "line 1: expected 4 parameters of PINHOLE, found 3"),
        ("3 PINHOLE 64 48 90 NaN 32 24", "expected finite intrinsics"),
        ("3 MAGIC 64 48 90 91 32", "line 1: expected a camera model of COLMAP, found MAGIC"),
        ("3 PINHOLE 0 48 90 90 32 24", "expected an image size in pixels, found 0x48"),
        ("4 PINHOLE 64 48 90 90 32 24", "image 1 (photo 1.jpg): expected a camera of the model"),
    ];
    for (line, expected) in cases {
        let message = camera_line(line).unwrap_err();
        assert!(message.contains(expected), "{message}\n{expected}");
    }
}

/// Promise (photos): distortion is read from COLMAP's models and from transforms.json, for all photos or for one.
#[test]
fn distorted_cameras() {
    let radial = |k, p| Some(Distortion::Radial { k, p });
    let cases = [
        ("SIMPLE_RADIAL", "90 32 24 0.01", Some(Distortion::radial(0.01)), "OPENCV"),
        ("RADIAL", "90 32 24 0.01 -0.02", radial([0.01, -0.02, 0.0, 0.0, 0.0, 0.0], [0.0; 2]), "OPENCV"),
        ("OPENCV", "90 91 32 24 0.1 0.2 0.3 0.4", radial([0.1, 0.2, 0.0, 0.0, 0.0, 0.0], [0.3, 0.4]), "OPENCV"),
        (
            "FULL_OPENCV",
            "90 91 32 24 0.1 0.2 0.3 0.4 0.5 0.6 0.7 0.8",
            radial([0.1, 0.2, 0.5, 0.6, 0.7, 0.8], [0.3, 0.4]),
            "FULL_OPENCV",
        ),
        (
            "OPENCV_FISHEYE",
            "90 91 32 24 0.1 0.2 0.3 0.4",
            Some(Distortion::Fisheye { k: [0.1, 0.2, 0.3, 0.4] }),
            "OPENCV_FISHEYE",
        ),
        (
            "SIMPLE_RADIAL_FISHEYE",
            "90 32 24 0.1",
            Some(Distortion::Fisheye { k: [0.1, 0.0, 0.0, 0.0] }),
            "OPENCV_FISHEYE",
        ),
        ("RADIAL_FISHEYE", "90 32 24 0.1 0.2", Some(Distortion::Fisheye { k: [0.1, 0.2, 0.0, 0.0] }), "OPENCV_FISHEYE"),
        ("SIMPLE_FISHEYE", "90 32 24", Some(Distortion::Fisheye { k: [0.0; 4] }), "OPENCV_FISHEYE"),
        ("FOV", "90 91 32 24 0.9", Some(Distortion::Fov { omega: 0.9 }), "FOV"),
        (
            "THIN_PRISM_FISHEYE",
            "90 91 32 24 0.1 0.2 0.3 0.4 0.5 0.6 0.7 0.8",
            Some(Distortion::ThinPrismFisheye { k: [0.1, 0.2, 0.5, 0.6], p: [0.3, 0.4], s: [0.7, 0.8] }),
            "THIN_PRISM_FISHEYE",
        ),
        (
            "RAD_TAN_THIN_PRISM_FISHEYE",
            "90 91 32 24 0.1 0.2 0.3 0.4 0.5 0.6 0.7 0.8 0.9 1 1.1 1.2",
            Some(Distortion::RadTanThinPrism {
                k: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6],
                p: [0.7, 0.8],
                s: [0.9, 1.0, 1.1, 1.2],
            }),
            "RAD_TAN_THIN_PRISM_FISHEYE",
        ),
        ("OPENCV", "90 91 32 24 0 0 0 0", None, "PINHOLE"),
    ];
    for (name, parameters, expected, written) in cases {
        let read = camera_line(&format!("3 {name} 64 48 {parameters}")).unwrap();
        assert_eq!(read.cameras[&3].distortion, expected, "{name}");
        assert!(read.frames().iter().all(|frame| frame.distortion == expected), "{name}");
        // Both forms carry it on, also by way of frames.
        let folder = tempfile::tempdir().unwrap();
        read.write_text(folder.path()).unwrap();
        let text = std::fs::read_to_string(folder.path().join("cameras.txt")).unwrap();
        assert!(text.contains(&format!("\n3 {written} 64 48 90 9")), "{text}");
        assert_close(&Model::read(folder.path()).unwrap(), &read);
        let folder = tempfile::tempdir().unwrap();
        Model::from_frames(&read.frames()).write_binary(folder.path()).unwrap();
        let back = Model::read(folder.path()).unwrap();
        assert!(back.cameras.values().all(|camera| *camera == read.cameras[&3]), "{name}");
    }
}

/// Promise (photos): photos of one lens share a camera of COLMAP.
#[test]
fn frames_of_one_lens_share_a_camera() {
    let intrinsics = Intrinsics { fx: 90.0, fy: 90.0, cx: 32.0, cy: 24.0 };
    let camera = |view: f64, fx: f64, width: usize| {
        let pose = Pose::from_wxyz([1.0, view, 0.0, 0.0], DVec3::new(view, 0.0, 0.0));
        Camera { pose, intrinsics: Intrinsics { fx, ..intrinsics }, width, height: 48 }
    };
    let next = f64::from_bits(90.0_f64.to_bits() + 1);
    let bent = |k1| Some(Distortion::radial(k1));
    let frames: Vec<Frame> = [
        (camera(0.0, 90.0, 64), None),
        (camera(0.1, next, 64), None),
        (camera(0.2, 90.0, 64), None),
        (camera(0.3, 90.0, 65), None),
        (camera(0.4, 90.0, 64), bent(0.1)),
        (camera(0.5, 90.0, 64), Some(Distortion::Fisheye { k: [0.1, 0.0, 0.0, 0.0] })),
        (camera(0.6, 90.0, 64), bent(0.1)),
        (camera(0.7, next, 64), None),
    ]
    .into_iter()
    .enumerate()
    .map(|(i, (camera, distortion))| Frame { distortion, ..Frame::new(format!("{i}.jpg"), camera) })
    .collect();
    let model = Model::from_frames(&frames);
    let of = model.images.iter().map(|image| image.camera_id).collect::<Vec<_>>();
    assert_eq!(of, [1, 2, 1, 3, 4, 5, 4, 2]);
    assert_eq!(model.cameras.keys().copied().collect::<Vec<_>>(), [1, 2, 3, 4, 5]);
    assert_eq!(model.images.iter().map(|image| image.id).collect::<Vec<_>>(), [1, 2, 3, 4, 5, 6, 7, 8]);
    for (back, frame) in model.frames().iter().zip(&frames) {
        assert_eq!((&back.name, back.camera, back.distortion), (&frame.name, frame.camera, frame.distortion));
    }
}

/// Promise of `point_clouds_beside_transforms_are_points`.
#[test]
fn a_point_cloud_takes_the_place_of_missing_points() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    model().write_binary(folder).unwrap();
    let cloud = PointCloud { positions: vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.5]], colors: vec![[1, 2, 3], [4, 5, 6]] };
    write_points(folder.join("points3D.ply"), &cloud).unwrap();
    assert_eq!(Model::read(folder).unwrap().points, model().points, "points with observations are better");
    std::fs::remove_file(folder.join("points3D.bin")).unwrap();
    let points = Model::read(folder).unwrap().points;
    assert_eq!(
        points.iter().map(|p| (p.xyz, p.rgb)).collect::<Vec<_>>(),
        [([1.0, 2.0, 3.0], [1, 2, 3]), ([4.0, 5.0, 6.5], [4, 5, 6])]
    );
    std::fs::remove_file(folder.join("points3D.ply")).unwrap();
    assert!(Model::read(folder).unwrap_err().to_string().contains("points3D.bin"));
}

/// A count too large is an error before any allocation.
#[test]
fn a_count_too_large_is_an_error_at_once() {
    let folder = tempfile::tempdir().unwrap();
    model().write_binary(folder.path()).unwrap();
    let path = folder.path().join("points3D.bin");
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    std::fs::write(&path, bytes).unwrap();
    let message = Model::read(folder.path()).unwrap_err().to_string();
    assert!(message.contains("points3D.bin: byte 0: expected at most 1 points"), "{message}");
}

#[test]
fn real_models_reproject() {
    for name in ["fox", "fountain-p11"] {
        let Some(folder) = shared::data(name) else {
            return;
        };
        let model = Model::read(folder.join("sparse/0")).unwrap();
        let by_id: BTreeMap<u64, &Point> = model.points.iter().map(|p| (p.id, p)).collect();
        let (mut sum, mut count) = (0.0, 0);
        for image in &model.images {
            let camera = model.cameras[&image.camera_id];
            for &(x, y, id) in &image.points {
                let Some(point) = id.map(|id| by_id[&id]) else {
                    continue;
                };
                let pixel = camera.intrinsics.project(image.pose.apply(point.xyz.into()));
                sum += (pixel.x - x).hypot(pixel.y - y);
                count += 1;
            }
        }
        let facts = std::fs::read(folder.join("facts.json")).unwrap();
        let facts: serde_json::Value = serde_json::from_slice(&facts).unwrap();
        assert_eq!(model.images.len() as u64, facts["views"]);
        assert_eq!(model.points.len() as u64, facts["points"]);
        let mean = sum / f64::from(count);
        assert!((mean - facts["mean_reproj_px"].as_f64().unwrap()).abs() < 1e-3, "{name}: {mean}");
    }
}

/// Changes one byte of one file and cuts it; reading must not panic.
fn damage(folder: &Path, extension: &str, file: usize, at: f64, byte: u8, keep: f64) {
    let path = folder.join(["cameras", "images", "points3D"][file]).with_extension(extension);
    let mut bytes = std::fs::read(&path).unwrap();
    let index = (at * bytes.len() as f64) as usize;
    bytes[index] = byte;
    bytes.truncate((keep * 2.0 * bytes.len() as f64) as usize);
    std::fs::write(&path, &bytes).unwrap();
    let _ = Model::read(folder);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 10))]

    #[test]
    fn hostile_files_never_panic(file in 0usize..3, at in 0.0..1.0f64, byte in any::<u8>(), keep in 0.0..1.0f64) {
        let folder = tempfile::tempdir().unwrap();
        model().write_text(folder.path()).unwrap();
        damage(folder.path(), "txt", file, at, byte, keep);
        let folder = tempfile::tempdir().unwrap();
        model().write_binary(folder.path()).unwrap();
        damage(folder.path(), "bin", file, at, byte, keep);
    }
}
