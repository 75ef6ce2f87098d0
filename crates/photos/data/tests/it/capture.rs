//! Captures written to a temporary folder: each kind loads, and each mistake is named.

use std::fs;
use std::path::Path;
use tempfile::TempDir;
use weaver_data::Scene;
use weaver_data::capture::{CaptureOptions, HoldOut, has_cameras, load, load_cameras, load_images};
use weaver_data::posed;
use weaver_io::Transforms;
use weaver_io::colmap::{CAMERA_ID, CameraModel, ImageRecord, Model, Point};
use weaver_io::realestate::{Clip, ClipFrame};
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::Frame;

const SIZE: ProceduralOptions = ProceduralOptions { width: 40, height: 30, views: 10 };
const OPTIONS: CaptureOptions =
    CaptureOptions { width: 40, height: 30, scene_scale: None, hold_out: HoldOut::Listed, masks: false };

fn write_photos(scene: &Scene, folder: &Path, name: impl Fn(usize) -> String) {
    fs::create_dir_all(folder).unwrap();
    for (i, view) in scene.views.iter().enumerate() {
        view.image.write_png(folder.join(name(i))).unwrap();
    }
}

fn write_transforms(scene: &Scene, path: &Path, views: &[usize], test: &[usize]) {
    let name = |i: &usize| format!("images/{i:02}.png");
    let frames = views.iter().map(|i| Frame::new(name(i), scene.views[*i].camera));
    let test_filenames = (!test.is_empty()).then(|| test.iter().map(name).collect());
    Transforms { frames: frames.collect(), test_filenames, ..Transforms::default() }.write(path).unwrap();
}

fn write_sparse(scene: &Scene, folder: &Path) {
    fs::create_dir_all(folder).unwrap();
    let camera = &scene.views[0].camera;
    let camera =
        CameraModel { width: camera.width, height: camera.height, intrinsics: camera.intrinsics, distortion: None };
    let images = scene.views.iter().zip(&scene.visible).zip(0..).map(|((view, visible), i)| ImageRecord {
        id: i + 1,
        name: format!("{i:02}.png"),
        camera_id: 1,
        pose: view.camera.pose,
        points: visible.iter().map(|&p| (0.0, 0.0, Some(u64::from(p) + 7))).collect(),
    });
    let points = scene.points.iter().zip(0..).map(|(p, i)| {
        let seen = scene.visible.iter().zip(0..).filter(|(visible, _)| visible.contains(&i));
        let track = seen.map(|(visible, view)| (view + 1, visible.binary_search(&i).unwrap() as u32));
        Point { id: u64::from(i) + 7, xyz: p.to_array(), rgb: [0; 3], error: 0.0, track: track.collect() }
    });
    let model = Model { cameras: [(1, camera)].into(), images: images.collect(), points: points.collect() };
    model.write_binary(folder).unwrap();
}

/// A nerfstudio capture with a sparse model, views 1 and 5 for testing.
fn capture() -> (TempDir, Scene) {
    let scene = scene(11, &SIZE);
    let folder = TempDir::new().unwrap();
    write_photos(&scene, &folder.path().join("images"), |i| format!("{i:02}.png"));
    write_transforms(&scene, &folder.path().join("transforms.json"), &Vec::from_iter(0..10), &[1, 5]);
    write_sparse(&scene, &folder.path().join("sparse/0"));
    (folder, scene)
}

fn assert_same_views(loaded: &Scene, truth: &Scene) {
    assert_eq!(loaded.views.len(), truth.views.len());
    for (a, b) in loaded.views.iter().zip(&truth.views) {
        assert_eq!(a.image.to_bytes(), b.image.to_bytes());
        let (p, q) = (a.camera.pose, b.camera.pose);
        assert!(p.angle_to(&q) < 1e-6 && p.center().distance(q.center()) < 1e-9);
        let (k, l) = (a.camera.intrinsics, b.camera.intrinsics);
        for (x, y) in [(k.fx, l.fx), (k.fy, l.fy), (k.cx, l.cx), (k.cy, l.cy)] {
            assert!((x - y).abs() < 1e-9);
        }
    }
}

fn error(folder: &Path) -> String {
    let message = load(folder, &OPTIONS).expect_err("a broken capture").to_string();
    println!("{message}");
    message
}

#[test]
fn transforms_with_points() {
    let (folder, truth) = capture();
    let loaded = load(folder.path(), &OPTIONS).unwrap();
    assert_same_views(&loaded, &truth);
    assert_eq!(loaded.held_out_views(), [1, 5]);
    assert_eq!(loaded.visible, truth.visible);
    assert_eq!(loaded.points, truth.points);
    // The nearest of the points in each pixel, and nothing elsewhere.
    for (v, view) in loaded.views.iter().enumerate() {
        let mut expected = vec![f64::INFINITY; 40 * 30];
        for &p in &truth.visible[v] {
            let local = view.camera.pose.apply(truth.points[p as usize]);
            let pixel = view.camera.intrinsics.project(local);
            let cell = &mut expected[pixel.y as usize * 40 + pixel.x as usize];
            *cell = cell.min(local.z);
        }
        for (e, d) in expected.iter().zip(view.depth.as_ref().unwrap()) {
            assert_eq!(if e.is_finite() { *e as f32 } else { 0.0 }, *d);
        }
    }
}

#[test]
fn a_transforms_json_of_any_name_is_a_capture() {
    let (folder, truth) = capture();
    fs::rename(folder.path().join("transforms.json"), folder.path().join("some.json")).unwrap();
    let loaded = load(folder.path().join("some.json"), &OPTIONS).unwrap();
    assert_same_views(&loaded, &truth);
    assert_eq!((loaded.held_out_views(), &loaded.visible), (vec![1, 5], &truth.visible));
    assert_eq!(loaded.name, folder.path().file_name().unwrap().to_str().unwrap());
}

#[test]
fn held_out_views_can_be_chosen() {
    let (folder, _) = capture();
    let held_out = |hold_out| load(folder.path(), &CaptureOptions { hold_out, ..OPTIONS }).unwrap().held_out_views();
    assert_eq!(held_out(HoldOut::Every(4)), [0, 4, 8]);
    assert_eq!(held_out(HoldOut::Nothing), [0_usize; 0]);
}

#[test]
fn colmap_alone_holds_out_every_eighth() {
    let (folder, truth) = capture();
    fs::remove_file(folder.path().join("transforms.json")).unwrap();
    let loaded = load(folder.path(), &OPTIONS).unwrap();
    assert_same_views(&loaded, &truth);
    assert_eq!(loaded.visible, truth.visible);
    assert_eq!(loaded.held_out_views(), [0, 8]);
}

#[test]
fn separate_training_and_test_files() {
    let (folder, truth) = capture();
    let write = |name, views: &[usize]| write_transforms(&truth, &folder.path().join(name), views, &[]);
    write("transforms_train.json", &[0, 1, 2, 4, 5, 6, 8]);
    write("transforms_test.json", &[3, 7, 9]);
    fs::remove_file(folder.path().join("transforms.json")).unwrap();
    let loaded = load(folder.path(), &CaptureOptions { scene_scale: Some(4.0), ..OPTIONS }).unwrap();
    assert_same_views(&loaded, &truth);
    assert_eq!(loaded.held_out_views(), [3, 7, 9]);
    assert!(loaded.points.is_empty() && loaded.views[0].depth.is_none());
    assert_eq!(loaded.scale, Some(4.0));
}

#[test]
fn realestate_clips() {
    let truth = scene(12, &SIZE);
    let folder = TempDir::new().unwrap();
    write_photos(&truth, &folder.path().join("images"), |i| format!("{}.png", 1_000_000 + 33_000 * i));
    let frames = truth.views.iter().zip(0..).map(|(view, i)| {
        let (k, w, h) = (view.camera.intrinsics, 40.0, 30.0);
        let normalized = [k.fx / w, k.fy / h, k.cx / w, k.cy / h];
        ClipFrame { timestamp: 1_000_000 + 33_000 * i, normalized, pose: view.camera.pose }
    });
    let clip = Clip { url: "https://example.org/clip".into(), frames: frames.collect() };
    let cameras = folder.path().join("0123456789abcdef.txt");
    clip.write(&cameras).unwrap();
    fs::write(folder.path().join("README.txt"), "not a clip").unwrap();
    assert_same_views(&load(folder.path(), &OPTIONS).unwrap(), &truth);

    fs::remove_file(folder.path().join("images/1033000.png")).unwrap();
    let message = error(folder.path());
    assert!(message.contains("0123456789abcdef.txt") && message.contains("1033000"));
    let text = fs::read_to_string(&cameras).unwrap();
    let number = text.lines().nth(1).and_then(|line| line.split(' ').nth(9)).unwrap();
    fs::write(&cameras, text.replacen(number, "NaN", 1)).unwrap();
    assert!(error(folder.path()).contains("line 2"));
}

#[test]
fn photos_without_cameras() {
    let (folder, truth) = capture();
    let paths = ["images/03.png", "images/01.png"].map(|p| folder.path().join(p));
    let images = load_images(&paths, 40, 30).unwrap();
    assert_eq!(images[0].to_bytes(), truth.views[3].image.to_bytes());
    assert_eq!(load_images(&paths, 16, 16).unwrap()[1].pixels.len(), 16 * 16 * 3);
    assert!(load_images(&[], 40, 30).unwrap_err().to_string().contains("at least one"));
    let missing = folder.path().join("images/none.png");
    assert!(load_images(&[missing], 40, 30).unwrap_err().to_string().contains("none.png"));
}

#[test]
fn cameras_of_some_photos_are_those_of_the_capture() {
    let (folder, _) = capture();
    let options = CaptureOptions { width: 16, height: 16, ..OPTIONS };
    let scene = load(folder.path(), &options).unwrap();
    let views = [4, 0, 7];
    let photos: Vec<_> = views.iter().map(|v| folder.path().join(format!("images/{v:02}.png"))).collect();
    let first = scene.views[views[0]].camera.pose;
    for file in [folder.path().join("transforms.json"), folder.path().to_path_buf(), folder.path().join("sparse/0")] {
        let found = load_cameras(&file, &photos, [16, 16], false).unwrap();
        for (camera, v) in found.cameras.iter().zip(views) {
            let expected = scene.views[v].camera;
            let pose = expected.pose.relative_to(&first);
            assert!(camera.pose.center().distance(pose.center()) < 1e-9 && camera.pose.angle_to(&pose) < 1e-6);
            assert_eq!((camera.intrinsics, camera.width, camera.height), (expected.intrinsics, 16, 16));
        }
        let expected = scene.points_seen(&views, 1.0);
        assert_eq!(found.points.visible, expected.visible);
        assert!(found.points.positions.iter().zip(&expected.positions).all(|(a, b)| a.distance(*b) < 1e-9));
        assert!(expected.visible.iter().all(|seen| !seen.is_empty()));
    }
    // Without the model beside it, a transforms.json has no points.
    fs::remove_dir_all(folder.path().join("sparse")).unwrap();
    let found = load_cameras(&folder.path().join("transforms.json"), &photos, [16, 16], false).unwrap();
    assert!(found.points.positions.is_empty() && found.points.visible == vec![Vec::<u32>::new(); 3]);
}

#[test]
fn mistakes_in_folders() {
    let folder = TempDir::new().unwrap();
    let absent = error(&folder.path().join("absent"));
    assert!(absent.contains("absent") && absent.contains("expected a folder or a file of cameras, found nothing"));
    assert!(error(folder.path()).contains("transforms.json"));
    fs::write(folder.path().join("transforms.json"), r#"{"frames": []}"#).unwrap();
    assert!(error(folder.path()).contains("expected at least one, found none"));
}

#[test]
fn mistakes_in_photos() {
    let (folder, _) = capture();
    let photo = folder.path().join("images/04.png");
    let smaller = scene(1, &ProceduralOptions { width: 20, height: 15, views: 1 });
    smaller.views[0].image.write_png(&photo).unwrap();
    let message = error(folder.path());
    assert!(message.contains("04.png") && message.contains("40x30") && message.contains("20x15"));
    fs::remove_file(&photo).unwrap();
    assert!(error(folder.path()).contains("04.png"));
}

#[test]
fn mistakes_in_transforms() {
    let (folder, truth) = capture();
    let path = folder.path().join("transforms.json");
    let text = fs::read_to_string(&path).unwrap();
    let broken = |from: &str, to: &str| {
        assert!(text.contains(from));
        fs::write(&path, text.replacen(from, to, 1)).unwrap();
        let message = error(folder.path());
        assert!(message.contains("transforms.json"));
        message
    };
    assert!(broken("\"fl_x\"", "\"unknown\"").contains("fl_x"));
    assert!(broken("[\n    \"images/01.png\"", "[\n    \"images/99.png\"").contains("test_filenames"));
    let number =
        text.split("transform_matrix").nth(1).and_then(|t| t.split([' ', ',']).find(|w| w.contains("0."))).unwrap();
    assert!(broken(number, "NaN").contains("line"));
    assert!(broken(number, "null").contains("transform_matrix"));
    // The same photos in another world than the sparse model's.
    let mut moved = truth.clone();
    moved.views.iter_mut().for_each(|view| view.camera.pose.translation.x += 1.0);
    write_transforms(&moved, &path, &Vec::from_iter(0..10), &[]);
    assert!(error(folder.path()).contains("the pose in transforms.json"));
}

#[test]
fn mistakes_in_sparse_models() {
    let (folder, _) = capture();
    for file in ["cameras.bin", "images.bin", "points3D.bin"] {
        let path = folder.path().join("sparse/0").join(file);
        let bytes = fs::read(&path).unwrap();
        fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        assert!(error(folder.path()).contains(file));
        fs::write(&path, &bytes).unwrap();
    }
    // A rotation of NaN in the first image record: count (8 bytes), id (4), then the quaternion.
    fs::remove_file(folder.path().join("transforms.json")).unwrap();
    let path = folder.path().join("sparse/0/images.bin");
    let mut bytes = fs::read(&path).unwrap();
    bytes[12..20].copy_from_slice(&f64::NAN.to_le_bytes());
    fs::write(&path, &bytes).unwrap();
    let message = error(folder.path());
    assert!(message.contains("images.bin") && message.contains("NaN"));
}

/// Times numbers and further entries reach views and photos.
#[test]
fn further_entries_reach_views_and_photos() {
    let truth = scene(3, &SIZE);
    let folder = tempfile::tempdir().unwrap();
    write_photos(&truth, folder.path(), |i| format!("{i:02}.png"));
    let frame = |(i, view): (usize, &weaver_data::View)| Frame {
        time: Some(i as f64 / 10.0),
        number: (i % 2 == 0).then_some(i as u64),
        extras: [("sharpness".to_string(), format!("{i}.5"))].into(),
        ..Frame::new(format!("{i:02}.png"), view.camera)
    };
    let frames = truth.views.iter().enumerate().map(frame).collect();
    Transforms { frames, ..Transforms::default() }.write(folder.path().join("transforms.json")).unwrap();
    let scene = load(folder.path(), &OPTIONS).unwrap();
    for (i, view) in scene.views.iter().enumerate() {
        assert_eq!((view.time, view.number), (Some(i as f64 / 10.0), (i % 2 == 0).then_some(i as u64)));
        assert_eq!(view.extras["sharpness"], format!("{i}.5"));
    }
    for (photo, view) in posed::load(folder.path(), &Default::default()).unwrap().photos.iter().zip(&scene.views) {
        assert_eq!((photo.frame.time, photo.frame.number, &photo.frame.extras), (view.time, view.number, &view.extras));
    }
}

#[test]
fn ids_of_a_colmap_model_reach_views_and_photos() {
    let truth = scene(3, &SIZE);
    let folder = tempfile::tempdir().unwrap();
    write_photos(&truth, &folder.path().join("images"), |i| format!("{i:02}.png"));
    let frames = truth.views.iter().enumerate().map(|(i, view)| Frame::new(format!("{i:02}.png"), view.camera));
    let mut model = Model::from_frames(&frames.collect::<Vec<_>>());
    // Two photos of one camera, and numbers that are not in the order of the names.
    model.cameras.insert(3, model.cameras[&1]);
    for (image, (id, camera)) in model.images.iter_mut().zip([(31, 1), (70, 1), (3, 3)]) {
        (image.id, image.camera_id) = (id, camera);
    }
    std::fs::create_dir_all(folder.path().join("sparse/0")).unwrap();
    model.write_text(folder.path().join("sparse/0")).unwrap();
    let scene = load(folder.path(), &OPTIONS).unwrap();
    let photos = posed::load(folder.path(), &Default::default()).unwrap().photos;
    let found = |i: usize| {
        let (view, photo) = (&scene.views[i], &photos[i]);
        assert_eq!((view.number, &view.extras), (photo.frame.number, &photo.frame.extras));
        (view.number.unwrap(), view.extras[CAMERA_ID].as_str())
    };
    assert_eq!([found(0), found(1), found(2)], [(31, "1"), (70, "1"), (3, "3")]);
}

/// Cameras behind a link that leads nowhere are named, and no others are taken in their place.
#[cfg(unix)]
#[test]
fn a_link_to_no_cameras_is_named() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder.path().join("sparse/0")).unwrap();
    std::os::unix::fs::symlink("gone.json", folder.path().join("transforms.json")).unwrap();
    assert!(has_cameras(folder.path()).unwrap());
    let message = load(folder.path(), &CaptureOptions::default()).unwrap_err().to_string();
    assert!(message.contains("transforms.json: No such file"), "{message}");
}
