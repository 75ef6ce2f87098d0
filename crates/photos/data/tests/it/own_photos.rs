//! Captures as users have them: distorted, turned by EXIF, masked. Each is loaded as the clean one would be.

use crate::claimed;
use crate::exif;
use image::RgbImage;
use image::metadata::Orientation;
use std::fs;
use std::path::Path;
use weaver_data::capture::{CaptureOptions, HoldOut, load, load_cameras, load_images};
use weaver_data::posed::{self, CaptureCameras, Lenses, PosedOptions};
use weaver_data::{EstimatePhotosOptions, estimate_photos};
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::{Camera, Distortion, Intrinsics, Pose};
use weaver_io::colmap::Model;
use weaver_io::ply::write_points;
use weaver_io::{Bitmap, Transforms};
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::{Frame, PointCloud};

const SIZE: (usize, usize) = (96, 72);

/// Every model of OpenCV and COLMAP that is undone.
fn lenses() -> Vec<Distortion> {
    let radial = |k, p| Distortion::Radial { k, p };
    vec![
        Distortion::radial(-0.2),
        radial([0.12, -0.05, 0.0, 0.0, 0.0, 0.0], [0.0; 2]),
        radial([-0.15, 0.04, 0.0, 0.0, 0.0, 0.0], [0.004, -0.003]),
        radial([-0.1, 0.03, -0.01, 0.08, 0.01, 0.002], [-0.002, 0.003]),
        Distortion::Fisheye { k: [0.03, -0.01, 0.002, 0.0] },
    ]
}

fn camera(view: usize) -> Camera {
    let intrinsics = Intrinsics { fx: 78.0, fy: 77.0, cx: 47.0, cy: 37.0 };
    let pose = Pose::from_wxyz([1.0, 0.02 * view as f64, 0.0, 0.0], DVec3::new(view as f64, 0.0, 0.0));
    Camera { pose, intrinsics, width: SIZE.0, height: SIZE.1 }
}

/// A smooth color for each direction.
fn color(at: DVec2) -> [u8; 3] {
    let wave = |phase: f64| 127.5 + 100.0 * (3.0 * at.x + phase).sin() * (2.5 * at.y - phase).cos();
    [wave(0.0), wave(1.0), wave(2.5)].map(|c| c.round() as u8)
}

/// A photo of these directions through a lens, exactly: one ray for each pixel.
fn photo(camera: &Camera, lens: Option<Distortion>, color: impl Fn(DVec2) -> [u8; 3]) -> Bitmap {
    let pixel = |i: usize| {
        let at = DVec2::new((i % camera.width) as f64 + 0.5, (i / camera.width) as f64 + 0.5);
        let seen = camera.intrinsics.unproject(at, 1.0).truncate();
        // Blank where the lens takes nothing: loud, should it ever be looked at.
        lens.map_or(Some(seen), |lens| lens.undistort(seen)).map_or([255, 0, 255], &color)
    };
    let pixels = (0..camera.width * camera.height).flat_map(pixel).collect();
    Bitmap { width: camera.width, height: camera.height, pixels }
}

fn most_apart(a: &[u8], b: &[u8]) -> u8 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap()
}

/// Photos of the lenses with their cameras as transforms.json; returns the frames.
fn distorted_capture(folder: &Path) -> Vec<Frame> {
    fs::create_dir_all(folder.join("images")).unwrap();
    let frame = |(view, lens): (usize, Distortion)| {
        let (name, camera) = (format!("images/{view}.png"), camera(view));
        photo(&camera, Some(lens), color).write_png(folder.join(&name)).unwrap();
        Frame { distortion: Some(lens), ..Frame::new(name, camera) }
    };
    let frames: Vec<Frame> = lenses().into_iter().enumerate().map(frame).collect();
    Transforms { frames: frames.clone(), ..Transforms::default() }.write(folder.join("transforms.json")).unwrap();
    frames
}

/// Distorted photos are loaded like photos of a lens without distortion.
///
/// Promise (photos): distorted photos are loaded as a lens without distortion would have taken them, their masks with
/// them.
#[test]
fn distorted_photos_are_undistorted() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let frames = distorted_capture(folder);
    for kind in ["transforms.json", "COLMAP"] {
        if kind == "COLMAP" {
            fs::remove_file(folder.join("transforms.json")).unwrap();
            fs::create_dir_all(folder.join("sparse/0")).unwrap();
            let named = |f: &Frame| Frame { name: f.name.replace("images/", ""), ..f.clone() };
            Model::from_frames(&frames.iter().map(named).collect::<Vec<_>>())
                .write_binary(folder.join("sparse/0"))
                .unwrap();
        }
        for (long_side, most) in [(None, 2), (Some(48), 3)] {
            let options = PosedOptions { long_side, ..PosedOptions::default() };
            let capture = posed::load(folder, &options).unwrap();
            assert_eq!(capture.photos.len(), lenses().len());
            for (loaded, lens) in capture.photos.iter().zip(lenses()) {
                let apart = most_apart(&loaded.photo.rgb, &photo(&loaded.photo.camera, None, color).pixels);
                assert!(apart <= most, "{kind}, {lens:?} at {long_side:?}: {apart} of 255 apart");
                assert_eq!(
                    (loaded.frame.camera.intrinsics, loaded.frame.distortion),
                    (camera(0).intrinsics, Some(lens))
                );
            }
            let planned =
                CaptureCameras::read(folder, options.hold_out).unwrap().at(options.long_side, options.lenses).unwrap();
            let cameras: Vec<_> = capture.photos.iter().map(|photo| (photo.photo.camera, photo.held_out)).collect();
            assert_eq!(planned, cameras, "what is said beforehand is what is loaded");
        }
        // For networks, cropped to another shape; and for given cameras.
        for (width, height) in [(48, 36), (40, 40)] {
            let options = CaptureOptions { width, height, ..CaptureOptions::default() };
            let scene = load(folder, &options).unwrap();
            for (view, lens) in scene.views.iter().zip(lenses()) {
                let apart = most_apart(&view.image.to_bytes(), &photo(&view.camera, None, color).pixels);
                assert!(apart <= 3, "{kind}, {lens:?} at {width}x{height}: {apart} of 255 apart");
            }
            let paths: Vec<_> = (0..lenses().len()).map(|i| folder.join(format!("images/{i}.png"))).collect();
            let file = if kind == "COLMAP" { folder.to_path_buf() } else { folder.join("transforms.json") };
            let found = load_cameras(&file, &paths, [width, height], false).unwrap();
            for (i, view) in scene.views.iter().enumerate() {
                assert_eq!(found.images[i], view.image);
                assert_eq!(found.cameras[i].intrinsics, view.camera.intrinsics);
            }
        }
    }
}

/// Promise of `distorted_photos_are_undistorted`.
#[test]
fn undoing_a_distortion_costs_no_detail() {
    // Waves of three pixels once the photo is shrunk to a quarter.
    let fine = |at: DVec2| [(127.5 + 100.0 * (160.0 * at.x).sin() * (150.0 * at.y).cos()).round() as u8; 3];
    let larger = |camera: Camera| {
        let (width, height) = (4 * camera.width, 4 * camera.height);
        Camera { intrinsics: camera.intrinsics.resized(4.0, 4.0), width, height, ..camera }
    };
    let folder = tempfile::tempdir().unwrap();
    let (camera, lens) = (larger(camera(0)), lenses()[2]);
    photo(&camera, Some(lens), fine).write_png(folder.path().join("a.png")).unwrap();
    let frames = vec![Frame { distortion: Some(lens), ..Frame::new("a.png", camera) }];
    Transforms { frames, ..Transforms::default() }.write(folder.path().join("transforms.json")).unwrap();
    let options = PosedOptions { long_side: Some(SIZE.0), ..PosedOptions::default() };
    let loaded = &posed::load(folder.path(), &options).unwrap().photos[0];
    let truth = photo(&larger(loaded.photo.camera), None, fine).resize(SIZE.0, SIZE.1);
    let apart = loaded.photo.rgb.iter().zip(&truth.pixels).map(|(a, b)| f64::from(a.abs_diff(*b)));
    let mean = apart.sum::<f64>() / truth.pixels.len() as f64;
    assert!(mean < 1.0, "{mean} of 255 apart");
}

/// A distortion that leaves nothing is refused by name.
///
/// Promise (photos): a distortion that would leave nothing is refused by name.
#[test]
fn a_distortion_that_leaves_nothing_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    distorted_capture(folder.path());
    let path = folder.path().join("transforms.json");
    let mut transforms = Transforms::read(&path).unwrap();
    transforms.frames[3].distortion = Some(Distortion::radial(-90.0));
    transforms.write(&path).unwrap();
    for message in [
        posed::load(folder.path(), &PosedOptions::default()).unwrap_err().to_string(),
        CaptureCameras::read(folder.path(), HoldOut::Listed)
            .and_then(|cameras| cameras.at(None, Lenses::Undistort))
            .unwrap_err()
            .to_string(),
        load(folder.path(), &CaptureOptions::default()).unwrap_err().to_string(),
    ] {
        assert!(message.contains("3.png") && message.contains("lens distortion: expected"), "{message}");
    }
}

/// Promise of `distorted_photos_are_undistorted`.
#[test]
fn masks_are_undistorted_with_their_photos() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let inside = |at: DVec2| [if at.length() < 0.3 { 255 } else { 0 }; 3];
    for (i, frame) in distorted_capture(folder).iter().enumerate() {
        fs::create_dir_all(folder.join("masks")).unwrap();
        photo(&frame.camera, frame.distortion, inside).write_png(folder.join(format!("masks/{i}.png"))).unwrap();
    }
    let capture = posed::load(folder, &PosedOptions { masks: true, ..PosedOptions::default() }).unwrap();
    for loaded in &capture.photos {
        // Pixels on the border may fall to either side.
        let clear = |at: DVec2| [u8::from((at.length() - 0.3).abs() > 0.012); 3];
        let (expected, clear) = (photo(&loaded.photo.camera, None, inside), photo(&loaded.photo.camera, None, clear));
        let pixels =
            loaded.photo.mask.as_ref().unwrap().iter().zip(expected.pixels.chunks(3)).zip(clear.pixels.chunks(3));
        let wrong = pixels.filter(|((mask, expected), clear)| **mask != (expected[0] >= 128) && clear[0] == 1).count();
        assert_eq!(wrong, 0, "{}", loaded.photo.name);
    }
}

/// A clean capture of six procedural views.
fn clean_capture(folder: &Path) -> Vec<Frame> {
    let scene = scene(5, &ProceduralOptions { width: 40, height: 30, views: 6 });
    fs::create_dir_all(folder.join("images")).unwrap();
    let frame = |(i, view): (usize, &weaver_data::View)| {
        let name = format!("images/{i}.png");
        view.image.write_png(folder.join(&name)).unwrap();
        Frame::new(name, view.camera)
    };
    let frames: Vec<Frame> = scene.views.iter().enumerate().map(frame).collect();
    Transforms { frames: frames.clone(), ..Transforms::default() }.write(folder.join("transforms.json")).unwrap();
    frames
}

/// Stores a photo turned, with a focal length of 30 mm.
fn turn(path: &Path, orientation: Orientation) {
    exif::store(path, orientation, Some(30));
}

/// Promise of `photos_are_read_upright`.
#[test]
fn photos_turned_by_exif_are_loaded_like_upright_ones() {
    let (clean, turned) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    clean_capture(clean.path());
    clean_capture(turned.path());
    for (i, orientation) in [Orientation::Rotate90, Orientation::Rotate270].into_iter().cycle().take(6).enumerate() {
        turn(&turned.path().join(format!("images/{i}.png")), orientation);
    }
    for long_side in [None, Some(20)] {
        let load = |folder: &Path| {
            let options = PosedOptions { long_side, ..PosedOptions::default() };
            posed::load(folder, &options)
                .unwrap()
                .photos
                .into_iter()
                .map(|p| (p.photo.camera, p.photo.rgb))
                .collect::<Vec<_>>()
        };
        assert_eq!(load(clean.path()), load(turned.path()));
    }
    let views = |folder: &Path| {
        let scene = load(folder, &CaptureOptions { width: 16, height: 16, ..CaptureOptions::default() }).unwrap();
        scene.views.into_iter().map(|view| (view.image, view.camera)).collect::<Vec<_>>()
    };
    assert_eq!(views(clean.path()), views(turned.path()));
    // Without cameras, too.
    let images = |folder: &Path| {
        let paths: Vec<_> = (0..6).map(|i| folder.join(format!("images/{i}.png"))).collect();
        (
            load_images(&paths, 20, 20).unwrap(),
            load_cameras(&folder.join("transforms.json"), &paths, [20, 20], false).unwrap(),
        )
    };
    assert_eq!(images(clean.path()), images(turned.path()));
}

/// Cameras are estimated of turned photos as of upright ones.
#[test]
fn turned_photos_have_the_same_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let truth = scene(3, &ProceduralOptions { width: 128, height: 96, views: 8 });
    let found = [false, true].map(|turned| {
        let paths: Vec<_> = (0..5).map(|i| folder.path().join(format!("{turned}{i}.png"))).collect();
        for (i, path) in paths.iter().enumerate() {
            truth.views[i].image.write_png(path).unwrap();
            let orientation = if turned && i % 2 == 0 { Orientation::Rotate90 } else { Orientation::NoTransforms };
            turn(path, orientation);
        }
        estimate_photos(&paths, &[false; 5], &EstimatePhotosOptions::default()).unwrap()
    });
    let [upright, turned] = &found;
    assert!(upright.placed().len() >= 3, "{:?}", upright.left_out());
    assert_eq!(upright.estimate.cameras, turned.estimate.cameras);
    // EXIF's 30 mm, for the diagonal of 160 pixels, which matching may change by a little.
    let focal = 30.0 / 43.27 * 160.0 / 128.0;
    assert!((upright.focal() / focal).ln().abs() < 0.3, "{} instead of {focal}", upright.focal());
    // The written folder is a capture of them.
    turned.write(&claimed(&folder.path().join("found"))).unwrap();
    let capture = posed::load(folder.path().join("found"), &PosedOptions::default()).unwrap();
    assert_eq!(capture.photos.len(), turned.placed().len());
    for photo in capture.photos {
        assert_eq!((photo.photo.camera.width, photo.photo.camera.height), (128, 96));
        let clean = photo
            .frame
            .path
            .with_file_name(photo.frame.path.file_name().unwrap().to_str().unwrap().replace("true", "false"));
        assert_eq!(photo.photo.rgb[..], image::open(clean).unwrap().into_rgb8().into_raw()[..]);
    }
}

/// Promise of `photos_are_read_upright`.
#[test]
fn cameras_of_photos_as_they_are_stored_keep_these() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    clean_capture(folder);
    let before = posed::load(folder, &PosedOptions::default()).unwrap();
    // The pixels stay, and EXIF tags them as turned: the cameras belong to the pixels.
    for i in 0..6 {
        let path = folder.join(format!("images/{i}.png"));
        let stored = image::open(&path).unwrap();
        turn(&path, Orientation::Rotate180);
        turn(&path, Orientation::Rotate180);
        assert_eq!(image::open(&path).unwrap(), stored);
    }
    assert_eq!(posed::load(folder, &PosedOptions::default()).unwrap(), before);
}

#[test]
fn a_masked_capture_is_the_clean_one_with_masks() {
    let (clean, masked) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    clean_capture(clean.path());
    let frames = clean_capture(masked.path());
    let folder = masked.path();
    let options = PosedOptions { masks: true, ..PosedOptions::default() };
    let half = |i: usize| Bitmap {
        width: 40,
        height: 30,
        pixels: (0..40 * 30).flat_map(|p| [if p % 40 < 5 * i { 0 } else { 255 }; 3]).collect(),
    };
    // By the photo's path, by its name, with two extensions, by alpha, by the frame, and by a path with quotes.
    fs::create_dir_all(folder.join("masks/images")).unwrap();
    half(0).write_png(folder.join("masks/images/0.png")).unwrap();
    half(1).write_png(folder.join("masks/1.png")).unwrap();
    half(2).write_png(folder.join("masks/2.png.png")).unwrap();
    let path = folder.join("images/3.png");
    let mut rgba = image::open(&path).unwrap().into_rgba8();
    rgba.pixels_mut().zip(half(3).pixels.chunks(3)).for_each(|(pixel, mask)| pixel.0[3] = mask[0]);
    rgba.save(&path).unwrap();
    half(4).write_png(folder.join("other.png")).unwrap();
    // Windows has no quotes in names.
    let odd = if cfg!(windows) { "a b.png" } else { "a \"b\".png" };
    half(5).write_png(folder.join(odd)).unwrap();
    let mut transforms = Transforms { frames, ..Transforms::default() };
    transforms.frames[4].mask = Some("other.png".into());
    transforms.frames[5].mask = Some(odd.into());
    transforms.write(folder.join("transforms.json")).unwrap();

    let plain = posed::load(clean.path(), &PosedOptions::default()).unwrap();
    let loaded = posed::load(folder, &options).unwrap();
    for (i, (photo, expected)) in loaded.photos.iter().zip(&plain.photos).enumerate() {
        let mask = photo.photo.mask.as_ref().unwrap();
        assert!(mask.iter().zip(half(i).pixels.chunks(3)).all(|(a, b)| *a == (b[0] >= 128)), "{i}");
        let same =
            photo.photo.rgb.chunks(3).zip(expected.photo.rgb.chunks(3)).zip(mask).all(|((a, b), m)| a == b || !m);
        assert!(same && photo.photo.camera.intrinsics == expected.photo.camera.intrinsics, "{i}");
    }

    let message = |folder: &Path| posed::load(folder, &options).unwrap_err().to_string().replace('\\', "/");
    fs::remove_file(folder.join("other.png")).unwrap();
    let missing = message(folder);
    assert!(missing.contains("4.png: mask_path: expected") && missing.contains("other.png"), "{missing}");
    let none = message(clean.path());
    assert!(none.contains("mask: expected") && none.contains("masks/0.png or ") && none.contains("alpha"), "{none}");
}

/// Masks of photos of one name in two folders are kept apart.
///
/// Promise of `masks_are_found_by_name_or_frame`.
#[test]
fn masks_of_photos_of_one_name() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut transforms = Transforms { frames: clean_capture(folder), ..Transforms::default() };
    transforms.frames.truncate(2);
    for (frame, name) in transforms.frames.iter_mut().zip(["a", "b"]) {
        fs::create_dir_all(folder.join("images").join(name)).unwrap();
        fs::rename(folder.join(&frame.name), folder.join("images").join(name).join("1.png")).unwrap();
        frame.name = format!("images/{name}/1.png");
        fs::create_dir_all(folder.join("masks").join(name)).unwrap();
        let gray = if name == "a" { 255 } else { 0 };
        let mask = RgbImage::from_pixel(40, 30, image::Rgb([gray; 3]));
        mask.save(folder.join("masks").join(name).join("1.png")).unwrap();
    }
    transforms.write(folder.join("transforms.json")).unwrap();
    let options = PosedOptions { masks: true, hold_out: HoldOut::Nothing, ..PosedOptions::default() };
    let masks: Vec<bool> =
        posed::load(folder, &options).unwrap().photos.iter().map(|p| p.photo.mask.as_ref().unwrap()[0]).collect();
    assert_eq!(masks, [true, false]);
    fs::rename(folder.join("masks/a/1.png"), folder.join("masks/1.png")).unwrap();
    fs::remove_dir_all(folder.join("masks/b")).unwrap();
    let message = posed::load(folder, &options).unwrap_err().to_string().replace('\\', "/");
    for part in ["masks/1.png: mask: expected one photo of this name", "a/1.png and", "b/1.png"] {
        assert!(message.contains(part), "{part}: {message}");
    }
}

/// Promise (photos): point clouds beside a transforms.json or in a model's folder are points.
#[test]
fn point_clouds_beside_transforms_are_points() {
    let truth = scene(5, &ProceduralOptions { width: 40, height: 30, views: 6 });
    let positions: Vec<[f32; 3]> = truth.points.iter().map(|p| p.as_vec3().to_array()).collect();
    let cloud = PointCloud { colors: vec![[9, 8, 7]; positions.len()], positions };
    let options = CaptureOptions { width: 40, height: 30, ..CaptureOptions::default() };
    for name in ["sparse_pc.ply", "points3D.ply", "named.ply"] {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let frames = clean_capture(folder);
        if name == "named.ply" {
            let point_cloud = Some("named.ply".into());
            let named = Transforms { frames, point_cloud, ..Transforms::default() };
            named.write(folder.join("transforms.json")).unwrap();
            let remarks = posed::load(folder, &PosedOptions::default()).unwrap().remarks;
            assert!(remarks.len() == 1 && remarks[0].contains("named.ply: no such file"), "{remarks:?}");
        }
        write_points(folder.join(name), &cloud).unwrap();
        let loaded = posed::load(folder, &PosedOptions::default()).unwrap();
        assert_eq!((loaded.points, loaded.remarks), (cloud.clone(), vec![]), "{name}");
        // The photos of a point are found by its nearness: most visible points of a photo are found, and few hidden
        // ones.
        let scene = load(folder, &options).unwrap();
        let (mut seen, mut found, mut right) = (0, 0, 0);
        for (ours, truth) in scene.visible.iter().zip(&truth.visible) {
            assert!(ours.is_sorted_by(|a, b| a < b));
            seen += truth.len();
            found += ours.len();
            right += ours.iter().filter(|p| truth.binary_search(p).is_ok()).count();
        }
        assert!(10 * right > 5 * seen && 10 * right > 8 * found, "{name}: {right} of {found} are right, of {seen}");
        for (view, visible) in scene.views.iter().zip(&scene.visible) {
            let depths = view.depth.as_ref().unwrap().iter().filter(|z| **z > 0.0).count();
            assert_eq!(depths, visible.len());
        }
    }
}

/// Promise (photos): photos that a model has no place for are named.
#[test]
fn photos_that_a_model_lacks_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let frames = clean_capture(folder);
    fs::create_dir_all(folder.join("sparse/0")).unwrap();
    let named = |f: &Frame| Frame { name: f.name.replace("images/", ""), ..f.clone() };
    let model = Model::from_frames(&frames[..4].iter().map(named).collect::<Vec<_>>());
    model.write_binary(folder.join("sparse/0")).unwrap();
    let says = |remarks: &[String], parts: [&str; 3]| {
        let all = parts.iter().all(|part| remarks[0].replace('\\', "/").contains(part));
        assert!(remarks.len() == 1 && all, "{remarks:?}");
    };
    // Photos of a transforms.json stay, without points.
    let parts = ["sparse/0", "see none of its points", "images/4.png, images/5.png"];
    let capture = posed::load(folder, &PosedOptions::default()).unwrap();
    assert_eq!(capture.photos.len(), 6);
    says(&capture.remarks, parts);
    says(&load(folder, &CaptureOptions::default()).unwrap().remarks, parts);
    // Entries of COLMAP alone are not there.
    fs::remove_file(folder.join("transforms.json")).unwrap();
    let capture = posed::load(folder, &PosedOptions::default()).unwrap();
    assert_eq!(capture.photos.len(), 4);
    says(&capture.remarks, ["sparse/0", "are not used", "images/5.png"]);
    for i in [4, 5] {
        fs::remove_file(folder.join(format!("images/{i}.png"))).unwrap();
    }
    assert_eq!(posed::load(folder, &PosedOptions::default()).unwrap().remarks, [""; 0]);
}

#[test]
fn photos_of_the_same_proportions_share_a_lens() {
    let folder = tempfile::tempdir().unwrap();
    // Upright or not; a little off, as sizes are rounded; and two crops.
    let sizes = [(64, 48), (48, 64), (400, 301), (64, 36), (48, 48)];
    let paths = sizes.map(|(width, height)| {
        let path = folder.path().join(format!("{width}x{height}.png"));
        RgbImage::new(width, height).save(&path).unwrap();
        path
    });
    let lenses = |shared: bool| {
        let options = EstimatePhotosOptions { shared, ..EstimatePhotosOptions::default() };
        estimate_photos(&paths, &[false; 5], &options).unwrap().lenses()
    };
    assert_eq!([lenses(true), lenses(false)], [3, 5]);
    // Two zooms of the same proportions, given to a millimeter; a photo without one takes the others' where they have
    // one.
    let tell = |told: [u16; 5]| {
        paths.iter().zip(told).for_each(|(path, told)| exif::store(path, Orientation::NoTransforms, Some(told)));
        lenses(true)
    };
    assert_eq!(tell([26, 27, 26, 26, 26]), 3);
    assert_eq!(tell([26, 52, 26, 26, 26]), 4);
    assert_eq!(tell([26, 0, 26, 0, 0]), 3);
    assert_eq!(tell([26, 0, 52, 26, 26]), 5);
    assert_eq!(lenses(false), 5);
}
