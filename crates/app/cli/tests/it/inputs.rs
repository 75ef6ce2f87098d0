//! Captures that are damaged in one place each.

use crate::capture::{self, edit, halve};
use crate::in_process::{Outcome, line, splatweaver};
use crate::run::Run;
use std::path::Path;
use weaver_io::Image;

fn train(data: &Path, out: &Path) -> Outcome {
    let scale = "data.scene_scale=3";
    line(&[&"train --preset micro --steps 1 --set", &scale, &"--data", &data, &"--out", &out])
}

/// Training and evaluating both refuse a capture, saying `parts`, and leave nothing behind.
#[track_caller]
fn refused(data: &Path, parts: &[&str]) {
    let out = data.with_extension("run");
    train(data, &out).refused(1, parts);
    assert!(!out.exists(), "no run folder for a run that could not start");
    splatweaver(&[&"eval", &"--run", &Run::shared().path(), &"--data", &data]).refused(1, parts);
}

/// A capture with a transforms.json, spoilt by `spoil`, is refused.
#[track_caller]
fn spoilt(spoil: impl FnOnce(&Path), parts: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("capture");
    capture::transforms(&data, capture::VIEWS);
    spoil(&data);
    refused(&data, parts);
}

#[test]
fn the_capture_itself_is_fine() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("capture");
    capture::transforms(&data, capture::VIEWS);
    train(&data, &folder.path().join("run")).fine();
}

#[test]
fn missing_folder() {
    let folder = tempfile::tempdir().unwrap();
    refused(&folder.path().join("nowhere"), &["nowhere", "expected a folder"]);
}

#[test]
fn corrupt_pngs() {
    let names = ["images/01.png", "images/03.png", "images/06.png"];
    spoilt(|data| names.iter().for_each(|name| halve(&data.join(name))), &names);
}

#[test]
fn one_corrupt_png_is_left_out_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("capture");
    capture::transforms(&data, capture::VIEWS);
    halve(&data.join("images/03.png"));
    let named = |text: &str| text.contains("1 of 10 photos cannot be read") && text.contains("03.png");
    let done = train(&data, &folder.path().join("run")).fine();
    assert!(named(&done.stderr), "{}", done.stderr);
    let done = splatweaver(&[&"eval", &"--run", &Run::shared().path(), &"--data", &data]).fine();
    assert!(named(&done.stdout), "{}", done.stdout);
}

#[test]
fn photo_of_another_size_than_its_camera() {
    let spoil = |data: &Path| Image::filled(20, 20, [0.5; 3]).write_png(data.join("images/03.png")).unwrap();
    spoilt(spoil, &["03.png", "40x32", "20x20"]);
}

#[test]
fn no_intrinsics() {
    let spoil = |data: &Path| edit(&data.join("transforms.json"), |t| t.replace("\"fl_x\"", "\"focus\""));
    spoilt(spoil, &["transforms.json", "frames[0].fl_x", "camera_angle_x"]);
}

#[test]
fn poses_that_are_not_numbers() {
    let first_number = |text: String, by: &str| {
        let at = text.find("transform_matrix").unwrap();
        let start = at + text[at..].find(|c: char| c.is_ascii_digit() || c == '-').unwrap();
        let end = start + text[start..].find([',', '\n', ']']).unwrap();
        format!("{}{by}{}", &text[..start], &text[end..])
    };
    for (by, part) in [("NaN", "JSON"), ("null", "transform_matrix[0][0]"), ("1e999", "transforms.json")] {
        spoilt(|data| edit(&data.join("transforms.json"), |t| first_number(t, by)), &["transforms.json", part]);
    }
}

#[test]
fn missing_photo() {
    spoilt(|data| std::fs::remove_file(data.join("images/03.png")).unwrap(), &["transforms.json", "images/03.png"]);
}

#[test]
fn truncated_colmap_files() {
    for name in ["cameras.bin", "images.bin", "points3D.bin"] {
        let folder = tempfile::tempdir().unwrap();
        let data = folder.path().join("capture");
        let sparse = capture::colmap(&data, capture::VIEWS);
        halve(&sparse.join(name));
        refused(&data, &[name]);
    }
}

#[test]
fn no_scale() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("capture");
    capture::transforms(&data, capture::VIEWS);
    let out = folder.path().join("run");
    splatweaver(&[&"train", &"--preset", &"micro", &"--steps", &"1", &"--data", &data, &"--out", &out])
        .refused(1, &["capture", "scene_scale"]);
}

/// Photos in folders below the one that is given are named, with and without photos beside them.
///
/// Promise of `photos_in_folders_below_are_found`.
#[test]
fn photos_in_folders_below_are_named() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let photo = |name: &str| {
        std::fs::create_dir_all(folder.join(name).parent().unwrap()).unwrap();
        weaver_io::Image::filled(64, 48, [0.5; 3]).write_png(folder.join(name)).unwrap();
    };
    [
        "DCIM/100 APPLE/a.png",
        "DCIM/101APPLE/b.png",
        "DCIM/masks/a.png",
        "mixed/a.png",
        "mixed/b.png",
        "mixed/more/c.png",
    ]
    .into_iter()
    .for_each(photo);
    let message = crate::command::refused(folder, "cameras DCIM -o out", 1);
    // A backslash is quoted.
    let second = if cfg!(windows) { "'DCIM/101APPLE'" } else { "DCIM/101APPLE" };
    let expected = &format!("found none but 2 in folders below it; give these in its place: 'DCIM/100 APPLE' {second}");
    assert!(message.contains(expected), "{message}");
    let message = crate::command::refused(folder, "cameras mixed -o out", 1);
    let expected =
        "warning: mixed: photos in folders below it are not taken, 1 in all; to take them, name mixed/more, too";
    assert!(message.contains(expected), "{message}");
    let message = crate::command::refused(folder, "cameras mixed ./mixed/more/ -o out", 1);
    assert!(!message.contains("not taken") && message.contains("3 photos"), "{message}");
}

/// A folder with pictures of unsupported formats is refused with their formats and a remedy.
///
/// Promise (files): a folder of pictures of other formats is said to have these.
#[test]
fn pictures_of_other_formats_are_named() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    std::fs::create_dir(folder.join("scans")).unwrap();
    ["1.bmp", "2.BMP", "3.gif"].iter().for_each(|name| std::fs::write(folder.join("scans").join(name), "").unwrap());
    let message = crate::command::refused(folder, "cameras scans -o out", 1);
    assert!(message.contains("found none among 2 .bmp, 1 .gif; ") && message.contains("magick"), "{message}");
}
