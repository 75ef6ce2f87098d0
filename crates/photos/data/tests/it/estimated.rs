//! Photos without cameras, from files as users have them to a capture.

use crate::claimed;
use crate::exif::store;
use image::metadata::Orientation::{self, *};
use std::fs;
use std::path::{Path, PathBuf};
use weaver_data::capture::{CaptureOptions, load, load_cameras};
use weaver_data::posed::{self, PosedOptions};
use weaver_data::{EstimatePhotosOptions, EstimatedPhotos, estimate_photos};
use weaver_io::{Transforms, colmap::Model};
use weaver_procedural::{ProceduralOptions, scene};

/// Small, for matching is slow where nothing is optimized.
pub const SIZE: [usize; 2] = [96, 72];

/// Photos of one place, `[width, height]`, in a folder.
pub fn photos(folder: &Path, count: usize, [width, height]: [usize; 2]) -> Vec<PathBuf> {
    let truth = scene(3, &ProceduralOptions { width, height, views: 8 });
    fs::create_dir_all(folder).unwrap();
    let write = |i: usize| {
        let path = folder.join(format!("{i}.png"));
        truth.views[i].image.write_png(&path).unwrap();
        path
    };
    (0..count).map(write).collect()
}

/// With the focal length of the photos: to look for it takes most of the time.
pub fn told() -> EstimatePhotosOptions {
    let camera = scene(3, &ProceduralOptions { width: 96, height: 72, views: 8 }).views[0].camera;
    EstimatePhotosOptions {
        focal: Some(camera.intrinsics.fx / camera.width as f64),
        ..EstimatePhotosOptions::default()
    }
}

fn estimated(paths: &[PathBuf], options: &EstimatePhotosOptions) -> EstimatedPhotos {
    estimate_photos(paths, &vec![false; paths.len()], options).unwrap()
}

fn test_names(folder: &Path) -> Option<Vec<String>> {
    Transforms::read(folder.join("transforms.json")).unwrap().test_filenames
}

/// Nothing is held out where no photo that was to be could be placed.
///
/// Promise of `files_may_hold_nothing_out`.
#[test]
fn unplaced_held_out_photos_leave_none() {
    let temporary = tempfile::tempdir().unwrap();
    let found = temporary.path().join("found");
    let mut paths = photos(&temporary.path().join("photos"), 4, SIZE);
    let held_out = |paths: &[PathBuf], located: &[bool]| {
        let estimated = estimate_photos(paths, located, &told()).unwrap();
        assert!(estimated.placed().len() >= 3, "{:?}", estimated.left_out());
        estimated.write(&claimed(&found)).unwrap();
        let capture = posed::load(&found, &PosedOptions::default()).unwrap();
        capture.photos.iter().filter(|photo| photo.held_out).count()
    };
    // No choice was made: every eighth.
    assert_eq!(held_out(&paths, &[false; 4]), 1);
    assert_eq!(test_names(&found), None);
    assert_eq!(held_out(&paths, &[false, true, false, false]), 1);
    assert_eq!(test_names(&found).unwrap(), ["../photos/1.png"]);
    // One without texture, and one that cannot be read.
    for blank in [true, false] {
        let path = temporary.path().join("photos/blank.png");
        if blank {
            image::RgbImage::new(96, 72).save(&path).unwrap();
        } else {
            fs::write(&path, "no photo").unwrap();
        }
        paths.truncate(4);
        paths.push(path);
        assert_eq!(held_out(&paths, &[false, false, false, false, true]), 0, "blank: {blank}");
        assert_eq!(test_names(&found).unwrap(), [""; 0]);
    }
}

/// Names and contents of the files in a folder and those in it.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(contents(&path));
        } else {
            found.push((path.clone(), fs::read(path).unwrap()));
        }
    }
    found.sort();
    found
}

/// Promise (fits): cameras that cannot be written leave those before them to the byte; no reader takes a mixture of
/// both.
#[test]
fn results_replace_those_before_whole_or_not() {
    let temporary = tempfile::tempdir().unwrap();
    let found = temporary.path().join("found");
    let paths = photos(&temporary.path().join("photos"), 5, SIZE);
    let [before, after] = [&paths[..3], &paths[1..]].map(|paths| estimated(paths, &told()));
    for obstacle in ["points.png", "cameras.json", "sparse/0/points3D.bin", "sparse/0/images.bin"] {
        before.write(&claimed(&found)).unwrap();
        let obstacle = found.join(obstacle);
        fs::remove_file(&obstacle).unwrap();
        fs::create_dir(&obstacle).unwrap();
        let was = contents(&found);
        let error = after.write(&claimed(&found)).unwrap_err().to_string();
        assert!(error.contains(obstacle.file_name().unwrap().to_str().unwrap()), "{error}");
        let is = contents(&found);
        let names = |all: &[(PathBuf, Vec<u8>)]| all.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
        assert_eq!(names(&is), names(&was));
        assert!(is == was, "a file was replaced before {} could not be", obstacle.display());
        fs::remove_dir(&obstacle).unwrap();
    }
    after.write(&claimed(&found)).unwrap();
    assert_eq!(posed::load(&found, &PosedOptions::default()).unwrap().photos.len(), 4);
    let names = fs::read_dir(&found).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    assert_eq!(names, ["cameras.json", "points.png", "sparse", "transforms.json", "written.jsonl"]);
}

/// Promise (fits): a foreign file in the place of an upright copy is found before photos are matched.
#[test]
fn foreign_upright_photos_are_met_at_the_start() {
    let temporary = tempfile::tempdir().unwrap();
    let found = temporary.path().join("found");
    let paths = photos(&temporary.path().join("photos"), 1, SIZE);
    let out = claimed(&found);
    EstimatedPhotos::check(&out, &paths).unwrap();
    fs::create_dir(found.join("upright")).unwrap();
    fs::write(found.join("upright/0.png"), "mine").unwrap();
    let error = EstimatedPhotos::check(&out, &paths).unwrap_err().to_string();
    assert!(error.contains("upright/0.png"), "{error}");
}

/// An absurd focal length changes no camera and is named.
///
/// Promise (photos): absurd focal lengths in EXIF are named and change no camera; of two that disagree neither is
/// used.
#[test]
fn an_absurd_focal_length_is_named() {
    let temporary = tempfile::tempdir().unwrap();
    let paths = photos(temporary.path(), 3, SIZE);
    let tell = |told: [u16; 3]| {
        paths.iter().zip(told).for_each(|(path, told)| store(path, NoTransforms, Some(told)));
        estimated(&paths, &EstimatePhotosOptions::default())
    };
    let expected = tell([30, 30, 0]);
    assert_eq!(expected.remarks, [""; 0]);
    let absurd = tell([30, 30, 5000]);
    assert_eq!(absurd.placed().len(), 3, "{:?}", absurd.left_out());
    assert_eq!(absurd.estimate.cameras, expected.estimate.cameras);
    let [remark] = &absurd.remarks[..] else { panic!("{:?}", absurd.remarks) };
    assert!(remark.contains("2.png (5000 mm)") && !remark.contains("1.png"), "{remark}");
    // With two, either may be right.
    let (nothing, two) = (tell([0; 3]), tell([0, 30, 300]));
    assert_eq!(two.estimate.cameras, nothing.estimate.cameras);
    assert!(two.remarks.len() == 1 && two.remarks[0].contains("1.png (30 mm), "), "{:?}", two.remarks);
    // If the user gives it, files are not read.
    let two = [paths[1].clone(), paths[2].clone()];
    assert_eq!(estimated(&two, &told()).remarks, [""; 0]);
}

/// The focal length of the drawn photos, millimeters on film.
const TRUE_FOCAL: u16 = 30;

#[test]
fn a_focal_length_that_photos_contradict_is_not_used() {
    let temporary = tempfile::tempdir().unwrap();
    let truth = scene(3, &ProceduralOptions { width: 160, height: 120, views: 24 });
    let path = |i: usize| temporary.path().join(format!("{i:02}.png"));
    let paths: Vec<PathBuf> = (0..12).map(path).collect();
    for (path, view) in paths.iter().zip(truth.views.iter().step_by(2)) {
        view.image.write_png(path).unwrap();
    }
    let with = |told: u16| {
        paths.iter().for_each(|path| store(path, NoTransforms, Some(told)));
        let found = estimated(&paths, &EstimatePhotosOptions::default());
        (found.focal() / (truth.views[0].camera.intrinsics.fx / 160.0), found.remarks)
    };
    let (right, remarks) = with(TRUE_FOCAL);
    assert!((right - 1.0).abs() < 0.03 && remarks.is_empty(), "{right}: {remarks:?}");
    // A third too long.
    let (wrong, remarks) = with(4 * TRUE_FOCAL / 3);
    assert!((wrong - 1.0).abs() < 0.05, "{wrong}");
    assert!(remarks.len() == 1 && remarks[0].contains("photos show one that is -2"), "{remarks:?}");
}

/// Photos of two zooms upright and across have two lenses.
#[test]
fn photos_of_two_zooms_have_two_lenses() {
    let temporary = tempfile::tempdir().unwrap();
    let truth = scene(3, &ProceduralOptions { width: 200, height: 150, views: 20 });
    let (focal, mut paths) = (truth.views[0].camera.intrinsics.fx, Vec::new());
    for (i, view) in truth.views.iter().step_by(2).enumerate() {
        // Every third one is cropped to three quarters and enlarged, as a zoom does; the camera of every fourth one was
        // held upright.
        let zoom = if i % 3 == 1 { 4.0 / 3.0 } else { 1.0 };
        let [x, y] = [100.0, 75.0].map(|half| half - half / zoom);
        let part = view.image.resize(200, 150, [x, y, 200.0 - x, 150.0 - y]);
        let path = temporary.path().join(format!("{i:02}.png"));
        part.write_png(&path).unwrap();
        if i % 4 == 2 {
            image::open(&path).unwrap().rotate90().save(&path).unwrap();
        }
        store(&path, NoTransforms, Some((43.27 * zoom * focal / 250.0).round() as u16));
        paths.push((path, zoom * focal));
    }
    let files: Vec<PathBuf> = paths.iter().map(|(path, _)| path.clone()).collect();
    let found = estimated(&files, &EstimatePhotosOptions::default());
    assert!(found.remarks.is_empty() && found.placed().len() == 10, "{:?} {:?}", found.remarks, found.left_out());
    assert_eq!(found.lenses(), 2);
    for ((path, focal), camera) in paths.iter().zip(&found.estimate.cameras) {
        let factor = camera.unwrap().intrinsics.fx / focal;
        assert!((factor - 1.0).abs() < 0.05, "{}: {factor}", path.display());
    }
}

/// Estimates photos as they are and stored by these orientations, and checks that both give the same cameras, and the
/// written files.
fn stored_like_upright(size: [usize; 2], orientations: [Orientation; 4], options: &EstimatePhotosOptions) {
    let temporary = tempfile::tempdir().unwrap();
    let [clean, stored] = ["clean", "stored"].map(|name| temporary.path().join(name));
    let upright = estimated(&photos(&clean, 4, size), options);
    assert!(upright.placed().len() >= 3, "{:?}", upright.left_out());
    let paths = photos(&stored, 4, size);
    paths.iter().zip(orientations).for_each(|(path, orientation)| store(path, orientation, None));
    let found = estimated(&paths, options);
    assert_eq!(found.estimate.cameras, upright.estimate.cameras);
    let capture = temporary.path().join("found");
    found.write(&claimed(&capture)).unwrap();
    upright.write(&claimed(&temporary.path().join("expected"))).unwrap();
    let loaded = |name: &str| posed::load(temporary.path().join(name), &PosedOptions::default()).unwrap();
    let (expected, mut loaded) = (loaded("expected"), loaded("found"));
    // Folders decide about the order.
    loaded.photos.sort_by(|a, b| a.frame.path.file_stem().cmp(&b.frame.path.file_stem()));
    assert_eq!(loaded.photos.len(), upright.placed().len());
    for (a, b) in loaded.photos.iter().zip(&expected.photos) {
        assert!(
            a.photo.rgb == b.photo.rgb && a.photo.camera == b.photo.camera,
            "{} and {}",
            a.photo.name,
            b.photo.name
        );
    }
    for photo in &loaded.photos {
        let stem = photo.frame.path.file_stem().unwrap().to_str().unwrap();
        let orientation = orientations[stem.parse::<usize>().unwrap()];
        let stays = orientation == NoTransforms;
        let name = if stays { format!("../stored/{stem}.png") } else { format!("upright/{stem}.png") };
        assert_eq!(photo.photo.name, name);
        // Readers without EXIF support see the same.
        assert_eq!(image::open(&photo.frame.path).unwrap().into_rgb8().into_raw()[..], photo.photo.rgb[..]);
    }
    assert!(capture.join("upright").exists());
}

/// Mirrored photos and those upside down are matched and written upright.
///
/// Promise of `a_size_may_not_tell_which_way_is_up`.
#[test]
fn turned_photos_are_written_upright() {
    let orientations = [FlipHorizontal, Rotate180, FlipVertical, NoTransforms];
    stored_like_upright(SIZE, orientations, &told());
}

/// Square photos on their side are matched and written upright.
///
/// Promise of `a_size_may_not_tell_which_way_is_up`.
#[test]
fn square_photos_are_written_upright() {
    let orientations = [Rotate90, NoTransforms, Rotate270, FlipHorizontal];
    stored_like_upright([80, 80], orientations, &told());
}

/// Promise of `photos_know_if_they_are_transparent`.
#[test]
fn transparent_parts_of_matched_photos_are_spoken_of() {
    let temporary = tempfile::tempdir().unwrap();
    let paths = photos(temporary.path(), 3, SIZE);
    for (i, alpha) in [(0, 255), (2, 0)] {
        let mut rgba = image::open(&paths[i]).unwrap().into_rgba8();
        rgba.get_pixel_mut(7, 8).0[3] = alpha;
        rgba.save(&paths[i]).unwrap();
    }
    let remarks = estimated(&paths, &told()).remarks;
    let expected = "2.png has transparent parts, which are laid over the background; --masks leaves these out";
    assert!(remarks.len() == 1 && remarks[0].ends_with(expected), "{remarks:?}");
}

/// Promise of `a_relative_path_leads_from_a_folder_to_a_file`.
#[test]
fn a_capture_and_its_photos_can_be_moved_together() {
    let temporary = tempfile::tempdir().unwrap();
    let before = temporary.path().join("before");
    // Two folders of one name, with photos of the same names.
    let mut paths = photos(&before.join("photos"), 5, SIZE);
    fs::create_dir_all(before.join("other/photos")).unwrap();
    for (i, path) in paths.iter_mut().enumerate().skip(3) {
        let to = before.join(format!("other/photos/{}.png", i - 3));
        fs::rename(&path, &to).unwrap();
        *path = to;
    }
    let found = estimated(&paths, &told());
    let written = found.write(&claimed(&before.join("found"))).unwrap();
    assert_eq!(written, found.placed(), "where the photos are");
    assert!(written.iter().any(|p| p.ends_with("other/photos/0.png")) && written.contains(&paths[0]), "{written:?}");
    let transforms = Transforms::read(before.join("found/transforms.json")).unwrap();
    let model = Model::read(before.join("found/sparse/0")).unwrap();
    // All are of one lens.
    assert_eq!((model.images.len(), model.cameras.len()), (found.placed().len(), 1));
    let of_model: Vec<&str> = model.images.iter().map(|image| image.name.as_str()).collect();
    let names: Vec<&str> = transforms.frames.iter().map(|frame| frame.name.as_str()).collect();
    assert_eq!(names, of_model);
    assert!(names.contains(&"../photos/0.png") && names.contains(&"../other/photos/0.png"), "{names:?}");
    let everything = |root: &Path| {
        let folder = root.join("found");
        let capture = posed::load(&folder, &PosedOptions::default()).unwrap();
        assert_eq!((capture.photos.len(), &capture.remarks[..]), (names.len(), &[][..]));
        let scene = load(&folder, &CaptureOptions { width: 64, height: 48, ..CaptureOptions::default() }).unwrap();
        assert!(scene.remarks.is_empty() && scene.visible.iter().all(|visible| visible.len() > 10));
        let photos =
            capture.photos.into_iter().map(|p| (p.photo.name, p.photo.rgb, p.photo.camera)).collect::<Vec<_>>();
        (photos, scene.visible)
    };
    let expected = everything(&before);
    let after = temporary.path().join("after");
    fs::rename(&before, &after).unwrap();
    assert_eq!(everything(&after), expected);
    // A camera by a photo, although both folders have the same name.
    let moved: Vec<PathBuf> =
        written.iter().map(|path| after.join(path.strip_prefix(&before).unwrap())).rev().collect();
    let cameras = load_cameras(&after.join("found/transforms.json"), &moved, [64, 48], false).unwrap();
    assert_eq!(cameras.images.len(), moved.len());
    // By the model alone, too: its cameras went through files of other digits.
    fs::remove_file(after.join("found/transforms.json")).unwrap();
    let (photos, visible) = everything(&after);
    for (a, b) in photos.iter().zip(&expected.0) {
        assert_eq!((&a.0, &a.1, a.2.intrinsics), (&b.0, &b.1, b.2.intrinsics));
    }
    assert_eq!(visible.iter().map(Vec::len).collect::<Vec<_>>(), expected.1.iter().map(Vec::len).collect::<Vec<_>>());
}

/// Photos that cannot be matched for their files are named at once and left out.
///
/// Promise of `a_few_unreadable_photos_are_left_out`.
#[test]
fn unusable_photos_are_named_and_left_out() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path().join("photos");
    let good = photos(&folder, 6, SIZE);
    let heic = folder.join("a.heic");
    fs::write(&heic, b"\0\0\0\x18ftypheic\0\0\0\0mif1heic").unwrap();
    let cut = folder.join("cut.png");
    let bytes = fs::read(&good[0]).unwrap();
    fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    // The flags stay with their photos, and cameras belong to the good photos alone.
    let mut paths = good.clone();
    paths.insert(0, heic);
    paths.insert(4, cut);
    let of = |paths: &[PathBuf]| paths.iter().map(|path| path == &good[4]).collect::<Vec<bool>>();
    let estimate = |paths: &[PathBuf]| estimate_photos(paths, &of(paths), &told());
    let (expected, found) = (estimate(&good).unwrap(), estimate(&paths).unwrap());
    assert_eq!(found.paths, good);
    assert_eq!(found.estimate.cameras, expected.estimate.cameras);
    let [remark] = &found.remarks[..] else { panic!("{:?}", found.remarks) };
    for part in ["2 of 8 photos cannot be read", "a.heic)", "HEIC: convert it", "cut.png)"] {
        assert!(remark.contains(part), "{part}: {remark}");
    }
    found.write(&claimed(&temporary.path().join("found"))).unwrap();
    assert_eq!(test_names(&temporary.path().join("found")).unwrap(), ["../photos/4.png"]);
    // More than a quarter without those that only have to be converted, and fewer than two that are good.
    paths.extend(["gone.jpg", "lost.jpg"].map(|name| folder.join(name)));
    let message = estimate(&paths).unwrap_err().to_string();
    for part in ["expected at least 2", "4 of 10", "a.heic", "cut.png", "gone.jpg", "lost.jpg"] {
        assert!(message.contains(part), "{part}: {message}");
    }
    let message = estimate(&[good[0].clone(), folder.join("gone.jpg")]).unwrap_err().to_string();
    assert!(message.contains("1 of 2") && message.contains("gone.jpg"), "{message}");
}

/// A photo whose name is not UTF-8 is left out and named.
///
/// Promise of `a_few_unreadable_photos_are_left_out`.
#[cfg(unix)]
#[test]
fn names_that_are_not_utf8_are_left_out() {
    use std::os::unix::ffi::OsStrExt;
    let temporary = tempfile::tempdir().unwrap();
    let mut paths = photos(temporary.path(), 4, SIZE);
    let odd = temporary.path().join(std::ffi::OsStr::from_bytes(b"\xe4.png"));
    // Some systems have no such names.
    if fs::rename(&paths[3], &odd).is_err() {
        return println!("skipped: no names that are not UTF-8");
    }
    paths[3] = odd;
    let found = estimated(&paths, &told());
    assert_eq!(found.paths, paths[..3]);
    assert!(found.remarks.len() == 1 && found.remarks[0].contains("expected UTF-8"), "{:?}", found.remarks);
}
