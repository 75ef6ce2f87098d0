//! Captures with photos that cannot be read.

use std::fs;
use std::path::Path;
use weaver_data::capture::{CaptureOptions, load, load_readable_images};
use weaver_data::posed::{self, PosedOptions};
use weaver_io::Transforms;
use weaver_io::colmap::Model;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::Frame;

/// A capture as a transforms.json, or as a model of COLMAP.
fn write(folder: &Path, views: usize, colmap: bool) {
    let truth = scene(1, &ProceduralOptions { width: 40, height: 30, views });
    fs::create_dir_all(folder.join("images")).unwrap();
    let within = if colmap { "" } else { "images/" };
    let mut frames = Vec::new();
    for (i, view) in truth.views.iter().enumerate() {
        view.image.write_png(folder.join(format!("images/{i}.png"))).unwrap();
        frames.push(Frame::new(format!("{within}{i}.png"), view.camera));
    }
    if colmap {
        fs::create_dir_all(folder.join("sparse/0")).unwrap();
        Model::from_frames(&frames).write_binary(folder.join("sparse/0")).unwrap();
    } else {
        Transforms { frames, ..Transforms::default() }.write(folder.join("transforms.json")).unwrap();
    }
}

fn cut_short(path: &Path) {
    let bytes = fs::read(path).unwrap();
    fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
}

/// The numbers of the photos that are loaded and the remarks, or the error: the same of both ways to load.
fn loaded(folder: &Path) -> Result<(Vec<usize>, Vec<String>), String> {
    let number = |name: &str| name.trim_start_matches("images/").trim_end_matches(".png").parse().unwrap();
    let photos = posed::load(folder, &PosedOptions::default()).map_err(|error| error.to_string());
    let photos = photos.map(|found| (found.photos.iter().map(|p| number(&p.photo.name)).collect(), found.remarks));
    let views = load(folder, &CaptureOptions::default()).map_err(|error| error.to_string());
    let views = views.map(|found| (found.views.iter().map(|v| number(&v.name)).collect(), found.remarks));
    assert_eq!(photos, views);
    photos
}

/// A few unreadable photos are named at once and left out.
///
/// Promise (photos): unreadable photos are named at once and left out, up to a quarter of all; a wrong entry of a
/// capture stays an error.
#[test]
fn a_few_unreadable_photos_are_left_out() {
    for colmap in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join("images").join(name);
        write(folder.path(), 12, colmap);
        cut_short(&at("3.png"));
        fs::write(at("5.png"), "no photo").unwrap();
        fs::write(at("8.png"), b"\0\0\0\x18ftypheic\0\0\0\0mif1heic").unwrap();
        let (numbers, remarks) = loaded(folder.path()).unwrap();
        assert_eq!(numbers.len(), 9, "colmap: {colmap}");
        assert!(!numbers.iter().any(|i| [3, 5, 8].contains(i)), "{numbers:?}");
        let [remark] = &remarks[..] else { panic!("{remarks:?}") };
        let remark = remark.replace('\\', "/");
        for part in ["3 of 12 photos", "images/3.png", "images/5.png", "images/8.png)", "HEIC: convert it"] {
            assert!(remark.contains(part), "{part}: {remark}");
        }
        // Four damaged ones are too much.
        fs::write(at("9.png"), "").unwrap();
        fs::write(at("7.png"), "").unwrap();
        let message = loaded(folder.path()).unwrap_err();
        for part in
            ["photos: 5 of 12 cannot be read: HEIC: ", "expected at least 1", "3.png", "5.png", "8.png", "9.png"]
        {
            assert!(message.contains(part), "{part}: {message}");
        }
    }
}

/// One unreadable photo in four is left out and two are an error.
///
/// Promise of `a_few_unreadable_photos_are_left_out`.
#[test]
fn one_unreadable_photo_in_four_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), 4, true);
    let at = |name: &str| folder.path().join("images").join(name);
    fs::remove_file(at("2.png")).unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink("gone.png", at("2.png")).unwrap();
    let (numbers, remarks) = loaded(folder.path()).unwrap();
    assert_eq!((numbers, remarks.len()), (vec![0, 1, 3], 1));
    assert!(remarks[0].contains("1 of 4 photos cannot be read") && remarks[0].contains("2.png"), "{remarks:?}");
    // A request may cover fewer photos: the held-out one alone.
    let held_out = PosedOptions { held_out_only: true, ..PosedOptions::default() };
    assert_eq!(posed::load(folder.path(), &held_out).unwrap().photos.len(), 1);
    cut_short(&at("0.png"));
    let message = loaded(folder.path()).unwrap_err();
    assert!(message.contains("0.png") && message.contains("2.png"), "{message}");
    let message = posed::load(folder.path(), &held_out).unwrap_err().to_string();
    assert!(message.contains("0.png"), "{message}");
}

/// Held out photos stay the same where others are unreadable.
#[test]
fn unreadable_photos_leave_the_split() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), 9, false);
    cut_short(&folder.path().join("images/1.png"));
    let photos = posed::load(folder.path(), &PosedOptions::default()).unwrap().photos;
    let held_out: Vec<&str> = photos.iter().filter(|p| p.held_out).map(|p| p.photo.name.as_str()).collect();
    assert_eq!(held_out, ["images/0.png", "images/8.png"]);
}

/// Promise of `a_few_unreadable_photos_are_left_out`.
#[test]
fn wrong_entries_of_one_photo_are_an_error() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), 8, true);
    let photo = folder.path().join("images/3.png");
    image::RgbImage::new(20, 15).save(&photo).unwrap();
    let message = loaded(folder.path()).unwrap_err();
    assert!(message.contains("3.png: image size: expected 40x30, its camera's, found 20x15"), "{message}");
    // Requested masks.
    write(folder.path(), 8, true);
    fs::create_dir(folder.path().join("masks")).unwrap();
    for i in 0..7 {
        image::GrayImage::from_pixel(40, 30, image::Luma([255]))
            .save(folder.path().join(format!("masks/{i}.png")))
            .unwrap();
    }
    let masked = PosedOptions { masks: true, ..PosedOptions::default() };
    let message = posed::load(folder.path(), &masked).unwrap_err().to_string();
    assert!(message.contains("7.png: mask: expected"), "{message}");
    fs::write(folder.path().join("masks/7.png"), "no mask").unwrap();
    let message = posed::load(folder.path(), &masked).unwrap_err().to_string().replace('\\', "/");
    assert!(message.contains("masks/7.png"), "{message}");
    let options = CaptureOptions { masks: true, ..CaptureOptions::default() };
    assert!(load(folder.path(), &options).unwrap_err().to_string().replace('\\', "/").contains("masks/7.png"));
    // Of a missing file transforms.json itself is at fault.
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), 8, false);
    fs::remove_file(folder.path().join("images/3.png")).unwrap();
    assert!(loaded(folder.path()).unwrap_err().contains("frames[3].file_path: expected an image file"));
}

#[test]
fn a_frame_of_realestate_that_is_no_photo_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("images")).unwrap();
    let mut lines = String::from("http://a\n");
    for i in 0..4 {
        image::RgbImage::new(40, 30).save(folder.path().join(format!("images/{i}.png"))).unwrap();
        lines += &format!("{i} 0.8 1.0 0.5 0.5 0 0 1 0 0 {i} 0 1 0 0 0 0 1 0\n");
    }
    fs::write(folder.path().join("cameras.txt"), lines).unwrap();
    fs::write(folder.path().join("images/2.png"), "no photo").unwrap();
    let (numbers, remarks) = loaded(folder.path()).unwrap();
    assert!(numbers == [0, 1, 3] && remarks.len() == 1 && remarks[0].contains("2.png"), "{numbers:?}: {remarks:?}");
}

/// Photos without cameras are loaded without those that cannot be read.
#[test]
fn unreadable_photos_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), 8, false);
    let paths: Vec<_> = (0..8).map(|i| folder.path().join(format!("images/{i}.png"))).collect();
    for bad in [2, 5] {
        cut_short(&paths[bad]);
    }
    let found = load_readable_images(&paths, false, 20, 20).unwrap();
    let kept: Vec<_> = (0..8).filter(|i| ![2, 5].contains(i)).map(|i| paths[i].clone()).collect();
    assert_eq!((&found.paths, found.images.len()), (&kept, 6));
    let remark = found.remark.unwrap();
    assert!(remark.contains("2.png") && remark.contains("5.png") && remark.contains("left out"), "{remark}");
    cut_short(&paths[6]);
    let error = load_readable_images(&paths, false, 20, 20).unwrap_err().to_string();
    assert!(["2.png", "5.png", "6.png"].iter().all(|name| error.contains(name)), "{error}");
}
