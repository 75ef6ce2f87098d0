use crate::shared;
use proptest::prelude::*;
use std::path::Path;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Distortion, Intrinsics, Pose};
use weaver_io::{Image, Transforms};
use weaver_scene::Frame;

fn scene(folder: &Path) -> Transforms {
    std::fs::create_dir_all(folder.join("images")).unwrap();
    let frames = (0..3)
        .map(|i| {
            let name = format!("images/{i}.png");
            let path = folder.join(&name);
            Image::filled(8, 6, [0.5; 3]).write_png(&path).unwrap();
            let t = f64::from(i);
            let pose = Pose::from_wxyz([1.0, 0.1 * t, 0.2, -0.3], DVec3::new(t, 0.5, 2.0));
            let intrinsics = Intrinsics { fx: 9.0 + t, fy: 8.5, cx: 4.25, cy: 3.0 };
            Frame { path, ..Frame::new(name, Camera { pose, intrinsics, width: 8, height: 6 }) }
        })
        .collect();
    let test_filenames = Some(vec!["images/1.png".to_string()]);
    Transforms { frames, test_filenames, ..Transforms::default() }
}

#[test]
fn round_trip() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("transforms.json");
    let scene = scene(folder.path());
    scene.write(&path).unwrap();
    let back = Transforms::read(&path).unwrap();
    for (x, y) in scene.frames.iter().zip(&back.frames) {
        let (a, b) = (&x.camera, &y.camera);
        assert!((a.pose.rotation - b.pose.rotation).to_cols_array().iter().all(|d| d.abs() < 1e-12));
        assert!((a.pose.translation - b.pose.translation).length() < 1e-12);
        assert_eq!((a.intrinsics, a.width, a.height), (b.intrinsics, b.width, b.height));
        assert_eq!((&x.name, &x.path), (&y.name, &y.path));
    }
    assert_eq!(back.frames.len(), 3);
    assert_eq!(back.test_filenames, scene.test_filenames);
}

/// A file may say that nothing is held out or not say it.
///
/// Promise (photos): a capture may hold nothing out; so do estimated cameras where no held-out photo has a place, and
/// a fit of everything.
#[test]
fn files_may_hold_nothing_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("transforms.json");
    for said in [None, Some(vec![]), Some(vec!["images/2.png".to_string()])] {
        Transforms { test_filenames: said.clone(), ..scene(folder.path()) }.write(&path).unwrap();
        assert_eq!(Transforms::read(&path).unwrap().test_filenames, said);
    }
}

/// Promise (photos): a byte order mark is no part of JSON or text.
#[test]
fn a_byte_order_mark_is_no_part_of_json() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("transforms.json");
    scene(folder.path()).write(&path).unwrap();
    let plain = Transforms::read(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, [b"\xef\xbb\xbf", &bytes[..]].concat()).unwrap();
    assert_eq!(Transforms::read(&path).unwrap(), plain);
}

/// The error message for a scene whose JSON was changed.
fn message(change: impl FnOnce(&mut serde_json::Value)) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("transforms.json");
    scene(folder.path()).write(&path).unwrap();
    let mut root = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    change(&mut root);
    std::fs::write(&path, root.to_string()).unwrap();
    Transforms::read(&path).unwrap_err().to_string()
}

#[test]
fn messages_name_file_and_key() {
    let cases = [
        (message(|r| r["frames"] = 3.into()), "frames: expected a list, found a number"),
        (
            message(|r| r["frames"][1]["transform_matrix"][2][0] = "NaN".into()),
            "frames[1].transform_matrix[2][0]: expected a finite number",
        ),
        (
            message(|r| r["frames"][1]["transform_matrix"][2][0] = 7.into()),
            "frames[1].transform_matrix: expected a rigid",
        ),
        (
            message(|r| r["frames"][0]["file_path"] = "images/9.png".into()),
            "frames[0].file_path: expected an image file",
        ),
        (
            message(|r| r["frames"][2]["fl_x"] = serde_json::Value::Null),
            "frames[2].fl_x: expected a number, found null",
        ),
        (
            message(|r| drop(r["frames"][2].as_object_mut().unwrap().remove("fl_x"))),
            "frames[2].fl_x: expected fl_x or camera_angle_x, found neither",
        ),
        (message(|r| r["k4"] = 0.1.into()), "frames[0].k4: expected 0 for OPENCV; k4 to k6 belong to FULL_OPENCV"),
        (
            message(|r| r["camera_model"] = "EQUIRECTANGULAR".into()),
            "frames[0].camera_model: expected PINHOLE, OPENCV,",
        ),
        (message(|r| r["camera_model"] = 3.into()), "frames[0].camera_model: expected a name"),
        (message(|r| r["frames"][1]["mask_path"] = 3.into()), "frames[1].mask_path: expected a string"),
        (message(|r| r["ply_file_path"] = 3.into()), "ply_file_path: expected a string"),
        (message(|r| r["frames"][0]["w"] = 0.5.into()), "frames[0].w: expected a size"),
    ];
    for (message, expected) in cases {
        assert!(message.contains("transforms.json: ") && message.contains(expected), "{message}\n{expected}");
    }
}

/// The scene read after a change of its JSON.
fn changed(change: impl FnOnce(&mut serde_json::Value)) -> Transforms {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("transforms.json");
    scene(folder.path()).write(&path).unwrap();
    let mut root = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    change(&mut root);
    std::fs::write(&path, root.to_string()).unwrap();
    Transforms::read(&path).unwrap()
}

/// Promise of `distorted_cameras`.
#[test]
fn lenses_are_read_at_the_top_and_in_frames() {
    let lenses = |scene: Transforms| scene.frames.iter().map(|frame| frame.distortion).collect::<Vec<_>>();
    let opencv = changed(|r| {
        r["camera_model"] = "OPENCV".into();
        (r["k1"], r["k2"], r["p1"], r["p2"]) = (0.1.into(), (-0.2).into(), 0.01.into(), 0.02.into());
        r["frames"][1]["k1"] = 0.3.into();
        r["frames"][2]["k3"] = 0.5.into();
    });
    let radial = |k1, k3| Some(Distortion::Radial { k: [k1, -0.2, k3, 0.0, 0.0, 0.0], p: [0.01, 0.02] });
    assert_eq!(lenses(opencv), [radial(0.1, 0.0), radial(0.3, 0.0), radial(0.1, 0.5)]);
    let fisheye = Some(Distortion::Fisheye { k: [0.1, 0.0, 0.0, -0.2] });
    for name in ["OPENCV_FISHEYE", "is_fisheye"] {
        let read = changed(|r| {
            if name == "is_fisheye" {
                r[name] = true.into()
            } else {
                r["camera_model"] = name.into()
            }
            (r["k1"], r["k4"]) = (0.1.into(), (-0.2).into());
        });
        assert_eq!(lenses(read), [fisheye; 3]);
    }
    let full = changed(|r| (r["camera_model"], r["k6"]) = ("FULL_OPENCV".into(), 0.3.into()));
    let k6 = Distortion::Radial { k: [0.0, 0.0, 0.0, 0.0, 0.0, 0.3], p: [0.0; 2] };
    assert_eq!(lenses(full), [Some(k6); 3]);
    let fov = changed(|r| (r["camera_model"], r["omega"]) = ("FOV".into(), 0.9.into()));
    assert_eq!(lenses(fov), [Some(Distortion::Fov { omega: 0.9 }); 3]);
    let thin = changed(|r| (r["camera_model"], r["sx1"]) = ("THIN_PRISM_FISHEYE".into(), 0.2.into()));
    assert_eq!(lenses(thin), [Some(Distortion::ThinPrismFisheye { k: [0.0; 4], p: [0.0; 2], s: [0.2, 0.0] }); 3]);
    let none = changed(|r| (r["camera_model"], r["k1"]) = ("OPENCV".into(), 0.into()));
    assert_eq!(lenses(none), [None; 3]);
}

#[test]
fn lenses_masks_and_points_are_carried_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("transforms.json");
    let mut scene = scene(folder.path());
    scene.point_cloud = Some("sparse_pc.ply".into());
    scene.frames[1].mask = Some("masks/a \"b\".png".into());
    let lenses = [
        None,
        Some(Distortion::radial(0.125)),
        Some(Distortion::Radial { k: [0.1, 0.2, 0.3, 0.0, 0.0, 0.0], p: [0.4, 0.5] }),
        Some(Distortion::Radial { k: [0.0, 0.0, 0.0, 0.1, 0.0, 0.2], p: [0.0; 2] }),
        Some(Distortion::Fisheye { k: [0.1, -0.2, 0.0, 0.3] }),
        Some(Distortion::ThinPrismFisheye { k: [0.1, -0.2, 0.0, 0.3], p: [0.4, 0.0], s: [0.0, 0.5] }),
        Some(Distortion::Fov { omega: 0.9 }),
        Some(Distortion::RadTanThinPrism { k: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], p: [0.0, 0.7], s: [0.8, 0.0, 0.9, 1.0] }),
    ];
    for first in 0..lenses.len() {
        // Also where the first frame's lens is the odd one out.
        (0..3).for_each(|i| scene.frames[i].distortion = lenses[(first + i) % lenses.len()]);
        scene.write(&path).unwrap();
        let back = Transforms::read(&path).unwrap();
        assert_eq!(back.point_cloud, scene.point_cloud);
        for (a, b) in scene.frames.iter().zip(&back.frames) {
            assert_eq!((a.distortion, &a.mask, &a.extras), (b.distortion, &b.mask, &b.extras));
        }
    }
}

#[test]
fn nerf_synthetic_form() {
    let folder = tempfile::tempdir().unwrap();
    Image::filled(20, 10, [0.0; 3]).write_png(folder.path().join("r_0.png")).unwrap();
    let path = folder.path().join("transforms_train.json");
    let angle = 2.0 * (0.5f64).atan();
    std::fs::write(
        &path,
        format!(
            r#"{{"camera_angle_x": {angle}, "frames": [{{"file_path": "./r_0",
            "transform_matrix": [[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]}}]}}"#
        ),
    )
    .unwrap();
    let scene = Transforms::read(&path).unwrap();
    let frame = &scene.frames[0];
    assert_eq!((frame.camera.width, frame.camera.height), (20, 10));
    assert!(
        (frame.camera.intrinsics.fx - 20.0).abs() < 1e-12 && frame.camera.intrinsics.fx == frame.camera.intrinsics.fy
    );
    assert_eq!((frame.camera.intrinsics.cx, frame.camera.intrinsics.cy), (10.0, 5.0));
    // A camera at (1, 2, 3) that looks along -z of the world, y up.
    assert_eq!(frame.camera.pose.center(), DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(frame.camera.pose.apply(DVec3::new(1.0, 3.0, 1.0)), DVec3::new(0.0, -1.0, 2.0));
}

#[test]
fn real_scenes() {
    if let Some(folder) = shared::data("lego-synthetic") {
        let scene = Transforms::read(folder.join("transforms_train.json")).unwrap();
        assert_eq!(scene.frames.len(), 100);
        for frame in &scene.frames {
            // Every camera is 4.031 from the origin and looks at it.
            assert!((frame.camera.pose.center().length() - 4.031).abs() < 1e-3);
            let origin = frame.camera.pose.apply(DVec3::ZERO);
            assert!((origin - DVec3::new(0.0, 0.0, 4.031)).length() < 2e-3, "{origin}");
            assert!((frame.camera.intrinsics.fx - 355.5555).abs() < 1e-3);
        }
    }
    if let Some(folder) = shared::data("fox") {
        let scene = Transforms::read(folder.join("transforms.json")).unwrap();
        assert_eq!((scene.frames.len(), scene.test_filenames.unwrap().len()), (50, 7));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 10))]

    #[test]
    fn hostile_files_never_panic(cut in 0.0..1.0f64, at in 0.0..1.0f64, byte in any::<u8>(), truncate in any::<bool>()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("transforms.json");
        scene(folder.path()).write(&path).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        let index = (at * bytes.len() as f64) as usize;
        bytes[index] = byte;
        if truncate { bytes.truncate((cut * bytes.len() as f64) as usize); }
        std::fs::write(&path, &bytes).unwrap();
        let _ = Transforms::read(&path);
    }
}

#[test]
fn cameras_alone_need_no_images() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("transforms.json");
    let scene = scene(folder.path());
    scene.write(&path).unwrap();
    std::fs::remove_file(&scene.frames[1].path).unwrap();
    assert!(Transforms::read(&path).unwrap_err().to_string().contains("images/1.png"));
    let cameras = Transforms::read_cameras(&path).unwrap();
    assert_eq!((cameras.frames.len(), cameras.frames[1].camera.intrinsics), (3, scene.frames[1].camera.intrinsics));
}

#[test]
fn a_time_a_number_and_unknown_keys_survive() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("transforms.json");
    let mut scene = scene(folder.path());
    scene.frames[1].time = Some(0.25);
    scene.frames[1].number = Some(7);
    let extras = [("colmap_im_id", "3"), ("sharpness", "81.25"), ("mask", r#"{"path":"m.png"}"#)];
    scene.frames[2].extras = extras.map(|(key, text)| (key.to_string(), text.to_string())).into();
    scene.write(&path).unwrap();
    let back = Transforms::read(&path).unwrap();
    for (a, b) in scene.frames.iter().zip(&back.frames) {
        assert_eq!((a.time, a.number, &a.extras), (b.time, b.number, &b.extras));
    }
    let cases = [
        ("mask", "{", "frames[2].mask to write: expected JSON, found what is not ("),
        ("cx", "1", "frames[2].cx to write: expected a key"),
    ];
    for (key, text, expected) in cases {
        scene.frames[2].extras = [(key.to_string(), text.to_string())].into();
        let message = scene.write(&path).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
    let message = message(|r| r["frames"][0]["time"] = "noon".into());
    assert!(message.contains("frames[0].time: expected a number"), "{message}");
}

/// A photo that is named twice with two cameras is refused with both entries, and one that is repeated counts once.
///
/// Promise (files): a photo that a transforms.json names twice has one camera.
#[test]
fn a_photo_has_one_camera() {
    let of = |change: fn(&mut Vec<Frame>)| {
        let folder = tempfile::tempdir().unwrap();
        let mut scene = scene(folder.path());
        change(&mut scene.frames);
        let path = folder.path().join("transforms.json");
        scene.write(&path).unwrap();
        // A path of cameras may have one name for all its pictures.
        assert_eq!(Transforms::read_cameras(&path).unwrap().frames.len(), scene.frames.len());
        Transforms::read(&path).map(|found| found.frames.len()).map_err(|error| error.to_string())
    };
    let again = |frames: &mut Vec<Frame>| frames.push(Frame { name: "./images/1.png".into(), ..frames[1].clone() });
    assert_eq!(of(again), Ok(3));
    let moved = |frames: &mut Vec<Frame>| frames.push(Frame { name: "./images/1.png".into(), ..frames[2].clone() });
    let message = of(moved).unwrap_err();
    for part in ["frames[3].file_path: expected", "frames[1]", "\"./images/1.png\" again with another camera"] {
        assert!(message.contains(part), "{part}: {message}");
    }
}

/// NaN and infinities, which Python writes, are called by their name and key.
///
/// Promise (files): NaN and infinities in JSON are named with their key.
#[test]
fn numbers_that_json_lacks_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("transforms.json");
    scene(folder.path()).write(&path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let cases = [
        ("\"fl_y\": 8.5", "\"fl_y\": NaN", "expected JSON, found NaN in \"fl_y\", a number that JSON has no word for"),
        ("\"cx\": 4.25", "\"cx\": -Infinity", "found -Infinity in \"cx\""),
        ("\"cy\": 3.0", "\"cy\":nan", "found nan in \"cy\""),
        ("1.0\n", "Infinity\n", "found Infinity in \"transform_matrix\""),
        ("\"cx\": 4.25", "\"cx\": nothing", "found what is not ("),
    ];
    for (number, word, expected) in cases {
        assert!(text.contains(number), "{number}: {text}");
        std::fs::write(&path, text.replacen(number, word, 1)).unwrap();
        let message = Transforms::read(&path).unwrap_err().to_string();
        assert!(message.contains(expected) && message.contains("transforms.json: line "), "{message}");
    }
}
