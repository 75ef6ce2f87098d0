//! Photos at their own size, with masks and points.

use std::fs;
use std::path::Path;
use weaver_data::capture::HoldOut;
use weaver_data::posed::{CaptureCameras, Lenses, PosedOptions, load};
use weaver_geometry::lens::Lens;
use weaver_geometry::{Camera, Distortion, Intrinsics, Pose};
use weaver_io::colmap::{Model, Point};
use weaver_io::{Image, Transforms};
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::Frame;

/// Six photos, the last smaller than the others.
fn write(folder: &Path) -> Vec<Camera> {
    let scene = scene(1, &ProceduralOptions { width: 40, height: 30, views: 6 });
    fs::create_dir_all(folder.join("images")).unwrap();
    let mut frames = Vec::new();
    for (i, view) in scene.views.iter().enumerate() {
        let name = format!("images/{i}.png");
        let (mut image, mut camera) = (view.image.clone(), view.camera);
        if i == 5 {
            image = image.crop(0, 0, 20, 30);
            camera.width = 20;
        }
        image.write_png(folder.join(&name)).unwrap();
        frames.push(Frame::new(name, camera));
    }
    Transforms { frames: frames.clone(), ..Transforms::default() }.write(folder.join("transforms.json")).unwrap();
    frames.into_iter().map(|frame| frame.camera).collect()
}

#[test]
fn photos_keep_their_size_or_shrink_to_a_longest_side() {
    let folder = tempfile::tempdir().unwrap();
    let written = write(folder.path());
    let capture = load(folder.path(), &PosedOptions::default()).unwrap();
    assert!(capture.points.is_empty());
    assert_eq!(
        capture.photos.iter().map(|p| p.held_out).collect::<Vec<_>>(),
        [true, false, false, false, false, false]
    );
    for (photo, camera) in capture.photos.iter().zip(&written) {
        assert_eq!((photo.photo.camera.width, photo.photo.rgb.len()), (camera.width, 3 * camera.width * camera.height));
        assert!((photo.photo.camera.intrinsics.fx - camera.intrinsics.fx).abs() < 1e-9);
        let image = Image::read(&photo.frame.path, weaver_io::Background::White).unwrap();
        assert_eq!(photo.photo.rgb[..], image.to_bytes()[..]);
    }
    let options = PosedOptions { long_side: Some(20), hold_out: HoldOut::Nothing, ..PosedOptions::default() };
    let capture = load(folder.path().join("transforms.json"), &options).unwrap();
    assert!(capture.photos.iter().all(|p| !p.held_out));
    let sizes: Vec<_> = capture.photos.iter().map(|p| (p.photo.camera.width, p.photo.camera.height)).collect();
    assert_eq!(sizes[4..], [(20, 15), (13, 20)]);
    let photo = &capture.photos[4];
    assert!((photo.photo.camera.intrinsics.fx - written[4].intrinsics.fx / 2.0).abs() < 1e-9);
    assert_eq!(photo.frame.camera.width, 40);
    let planned =
        CaptureCameras::read(folder.path(), options.hold_out).unwrap().at(options.long_side, options.lenses).unwrap();
    let loaded: Vec<_> = capture.photos.iter().map(|p| (p.photo.camera, p.held_out)).collect();
    assert_eq!(planned, loaded, "what is said beforehand is what is loaded");
}

/// Masks are found by name or by the frame and their lack is named.
///
/// Promise (photos): masks are found by name, by the frame or in the photo's alpha.
#[test]
fn masks_are_found_by_name_or_frame() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write(folder);
    let options = PosedOptions { masks: true, ..PosedOptions::default() };
    let error = load(folder, &options).unwrap_err().to_string();
    assert!(error.contains("0.png") && error.contains("mask"), "{error}");
    fs::create_dir(folder.join("masks")).unwrap();
    for i in 0..6 {
        let width = if i == 5 { 20 } else { 40 };
        let mut mask = Image::filled(width, 30, [1.0; 3]);
        mask.pixels[..3].fill(0.0);
        // Three ways to name one.
        let name = if i % 2 == 0 { format!("masks/{i}.png") } else { format!("masks/{i}.png.png") };
        mask.write_png(folder.join(name)).unwrap();
    }
    let capture = load(folder, &options).unwrap();
    for photo in &capture.photos {
        let mask = photo.photo.mask.as_ref().unwrap();
        assert_eq!((mask[0], mask.iter().filter(|m| **m).count()), (false, mask.len() - 1), "{}", photo.photo.name);
    }
    Image::filled(7, 7, [1.0; 3]).write_png(folder.join("masks/2.png")).unwrap();
    let error = load(folder, &options).unwrap_err().to_string().replace('\\', "/");
    assert!(error.contains("masks/2.png") && error.contains("40x30") && error.contains("7x7"), "{error}");

    let path = folder.join("transforms.json");
    let mut transforms = Transforms::read(&path).unwrap();
    transforms.frames.truncate(1);
    transforms.frames[0].mask = Some("other.png".into());
    transforms.frames[0].name = "images/0.png".into();
    transforms.write(&path).unwrap();
    Image::filled(40, 30, [0.0; 3]).write_png(folder.join("other.png")).unwrap();
    let capture = load(folder, &PosedOptions { hold_out: HoldOut::Nothing, ..options }).unwrap();
    assert!(capture.photos[0].photo.is_masked());
}

/// A capture that lists no photos for testing holds none out.
///
/// Promise of `files_may_hold_nothing_out`.
#[test]
fn captures_without_a_list_hold_none_out() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    let path = folder.path().join("transforms.json");
    let held_out = |test_filenames: Option<Vec<String>>| {
        Transforms { test_filenames, ..Transforms::read(&path).unwrap() }.write(&path).unwrap();
        let photos = load(folder.path(), &PosedOptions::default()).unwrap().photos;
        let options = weaver_data::capture::CaptureOptions::default();
        let views = weaver_data::capture::load(folder.path(), &options).unwrap().views;
        assert!(photos.iter().map(|p| p.held_out).eq(views.iter().map(|v| v.held_out)));
        photos.iter().map(|p| p.held_out).collect::<Vec<_>>()
    };
    assert_eq!(held_out(None), [true, false, false, false, false, false], "every eighth where the file does not say");
    assert_eq!(held_out(Some(vec![])), [false; 6]);
    assert_eq!(held_out(Some(vec!["images/2.png".into()])), [false, false, true, false, false, false]);
}

/// Gives a photo alpha, which is `corner` in one pixel.
fn with_alpha(path: &Path, corner: u8) {
    let mut rgba = image::open(path).unwrap().into_rgba8();
    rgba.get_pixel_mut(3, 2).0[3] = corner;
    rgba.save(path).unwrap();
}

/// Transparent parts are spoken of where masks are not read.
///
/// Promise of `photos_know_if_they_are_transparent`.
#[test]
fn transparent_parts_are_remarked_on() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(1, &ProceduralOptions { width: 40, height: 30, views: 12 });
    let mut frames = Vec::new();
    for (i, view) in scene.views.iter().enumerate() {
        let name = format!("{i:02}.png");
        let path = folder.path().join(&name);
        view.image.write_png(&path).unwrap();
        with_alpha(&path, 255);
        frames.push(Frame::new(name, view.camera));
    }
    let file = |name: &str| folder.path().join(name);
    Transforms { frames, ..Transforms::default() }.write(file("transforms.json")).unwrap();
    let remarks = |options: &PosedOptions| load(folder.path(), options).unwrap().remarks;
    assert_eq!(remarks(&PosedOptions::default()), [""; 0], "alpha that is opaque everywhere");
    with_alpha(&file("04.png"), 254);
    let one = "04.png has transparent parts, which are laid over the background; --masks leaves these out";
    assert_eq!(remarks(&PosedOptions::default()), [one]);
    (0..10).for_each(|i| with_alpha(&file(&format!("{i:02}.png")), 0));
    let [many] = &remarks(&PosedOptions::default())[..] else { panic!("one remark") };
    let (first, last) = ("00.png, 01.png, ", "06.png, 07.png and 2 more have transparent parts, ");
    assert!(many.starts_with(first) && many.contains(last), "{many}");
    assert_eq!(remarks(&PosedOptions { masks: true, ..PosedOptions::default() }), [""; 0]);
    // Synthetic scenes are over white by convention.
    fs::copy(file("transforms.json"), file("transforms_train.json")).unwrap();
    fs::rename(file("transforms.json"), file("transforms_test.json")).unwrap();
    assert_eq!(remarks(&PosedOptions::default()), [""; 0]);
    assert_eq!(load(file("transforms_train.json"), &PosedOptions::default()).unwrap().remarks, [""; 0]);
}

#[test]
fn points_come_with_their_colors() {
    let folder = tempfile::tempdir().unwrap();
    let cameras = write(folder.path());
    fs::remove_file(folder.path().join("transforms.json")).unwrap();
    let frames: Vec<Frame> =
        cameras.iter().enumerate().map(|(i, camera)| Frame::new(format!("{i}.png"), *camera)).collect();
    let mut model = Model::from_frames(&frames);
    let point = |id: u64| Point { id, xyz: [1.0, 2.0, id as f64], rgb: [id as u8, 20, 30], error: 0.0, track: vec![] };
    model.points = vec![point(1), point(9)];
    let sparse = folder.path().join("sparse/0");
    fs::create_dir_all(&sparse).unwrap();
    model.write_binary(&sparse).unwrap();
    let capture = load(folder.path(), &PosedOptions::default()).unwrap();
    assert_eq!(capture.points.positions, [[1.0, 2.0, 1.0], [1.0, 2.0, 9.0]]);
    assert_eq!(capture.points.colors, [[1, 20, 30], [9, 20, 30]]);
}

/// A photo of a fisheye of so many degrees across, with this k1.
fn write_fisheye(folder: &Path, degrees: f64, k1: f64) {
    let (width, height) = (60, 40);
    let pixels = (0..3 * width * height).map(|i| (i * 37 % 251) as u8).collect();
    fs::create_dir_all(folder.join("images")).unwrap();
    weaver_io::Bitmap { width, height, pixels }.write_png(folder.join("images/0.png")).unwrap();
    let fx = width as f64 / degrees.to_radians();
    let intrinsics = Intrinsics { fx, fy: fx, cx: 30.0, cy: 20.0 };
    let camera = Camera { pose: Pose::IDENTITY, intrinsics, width, height };
    let distortion = Some(Distortion::Fisheye { k: [k1, 0.0, 0.0, 0.0] });
    let frames = vec![Frame { distortion, ..Frame::new("images/0.png", camera) }];
    Transforms { frames, ..Transforms::default() }.write(folder.join("transforms.json")).unwrap();
}

/// Promise (photos): photos of 120 degrees and more keep their lens and all of their pixels.
#[test]
fn wide_photos_keep_their_lens() {
    let folder = tempfile::tempdir().unwrap();
    let read = |lenses: Lenses| {
        let options = PosedOptions { lenses, hold_out: HoldOut::Nothing, ..PosedOptions::default() };
        load(folder.path(), &options).unwrap().photos.remove(0).photo
    };
    write_fisheye(folder.path(), 180.0, 0.0);
    let bytes = Image::read(folder.path().join("images/0.png"), weaver_io::Background::White).unwrap().to_bytes();
    for lenses in [Lenses::Auto, Lenses::Keep] {
        let photo = read(lenses);
        assert_eq!(photo.lens, Some(Lens::Distorted(Distortion::Fisheye { k: [0.0; 4] })));
        assert_eq!((photo.rgb.into_vec(), photo.mask), (bytes.clone(), None));
    }
    let undone = read(Lenses::Undistort);
    assert!(undone.lens.is_none() && undone.rgb[..] != bytes[..]);
    write_fisheye(folder.path(), 110.0, 0.0);
    assert_eq!(read(Lenses::Auto).lens, None);
    assert!(read(Lenses::Keep).lens.is_some());
    // a - 0.1 a^3 is at most 1.217 at 105 degrees: what lies beyond the circle does not count.
    write_fisheye(folder.path(), 170.0, -0.1);
    let mask = read(Lenses::Auto).mask.expect("corners beyond the lens");
    assert!(!mask[0] && !mask[59] && mask[20 * 60 + 30], "corners are masked, the middle is not");
}
