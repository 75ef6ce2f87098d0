//! Films in folders of the layouts of D-NeRF, Neural 3D Video and HyperNeRF.

use std::fs;
use std::path::{Path, PathBuf};
use weaver_data::film::{Film, FilmLayout, HeldOut, Pixels, Shot, open, open_keeping};
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_io::{Image, write_npy};

/// A gray photo of 8 x 6, of this brightness of 255.
fn photo(path: &Path, brightness: u8) {
    sized_photo(path, brightness, 8, 6);
}

fn sized_photo(path: &Path, brightness: u8, width: usize, height: usize) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    Image::filled(width, height, [f32::from(brightness) / 255.0; 3]).write_png(path).unwrap();
}

/// The pixel of a point of the world.
fn seen(shot: &Shot, point: [f64; 3]) -> DVec2 {
    shot.camera.intrinsics.project(shot.camera.pose.apply(DVec3::from(point)))
}

fn near(found: DVec2, expected: [f64; 2]) {
    assert!(found.distance(DVec2::from(expected)) < 1e-5, "{found}, not {expected:?}");
}

/// The error when a film is opened after a change.
fn refused(written: fn(&Path), change: impl FnOnce(&Path)) -> String {
    let folder = tempfile::tempdir().unwrap();
    written(folder.path());
    open(folder.path(), None).unwrap();
    change(folder.path());
    open(folder.path(), None).unwrap_err().to_string().replace('\\', "/")
}

/// Replaces a part of a file that is there.
fn edit(file: PathBuf, from: &str, to: &str) {
    let text = fs::read_to_string(&file).unwrap();
    assert!(text.contains(from), "{}: {from}", file.display());
    fs::write(file, text.replacen(from, to, 1)).unwrap();
}

fn held_out(film: &Film) -> Vec<(bool, bool)> {
    film.shots.iter().map(|Shot { held_out: HeldOut { camera, time }, .. }| (*camera, *time)).collect()
}

/// Cameras 4 before the origin on the z axis, farther to the right at later times; brightness is 10 per tenth.
fn dnerf(folder: &Path) {
    for (split, times) in [("train", [0.0, 2.0, 1.0]), ("test", [1.0, 0.5, 0.0])] {
        let frame = |(i, time): (usize, &f64)| {
            photo(&folder.join(format!("{split}/r_{i:03}.png")), (time * 100.0) as u8);
            format!(
                r#"{{"file_path": "./{split}/r_{i:03}", "rotation": 0.1, "time": {time:?},
                "transform_matrix": [[1, 0, 0, {}], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]}}"#,
                time + if split == "test" { 0.25 } else { 0.0 },
            )
        };
        let frames: Vec<String> = times.iter().enumerate().map(frame).collect();
        // As wide as far: the focal length is half the width.
        let angle = std::f64::consts::FRAC_PI_2;
        let text = format!(r#"{{"camera_angle_x": {angle}, "frames": [{}]}}"#, frames.join(", "));
        fs::write(folder.join(format!("transforms_{split}.json")), text).unwrap();
    }
}

/// Promise (results): films of three layouts are read with their cameras and times; unusable ones are refused with
/// file, expected and found.
#[test]
fn a_dnerf_film_is_read() {
    let folder = tempfile::tempdir().unwrap();
    dnerf(folder.path());
    assert_eq!(FilmLayout::of(folder.path()).unwrap(), FilmLayout::DNerf);
    let film = open(folder.path(), None).unwrap();
    assert_eq!((film.size, film.background, film.times()), ([6, 8], [1.0; 3], vec![0.0, 0.25, 0.5, 1.0]));
    let (trained, camera, both) = ((false, false), (true, false), (true, true));
    assert_eq!(held_out(&film), [trained, camera, both, trained, camera, trained]);
    assert_eq!(film.training(), [0, 3, 5]);
    for shot in &film.shots {
        assert_eq!(*shot.pixels.bytes().unwrap(), [(shot.time * 200.0) as u8; 8 * 6 * 3], "{}", shot.name);
    }
    // The camera at time 1 stands at x = 2. A point 0.5 to its right, 0.25 above, and 2 before it.
    let last = &film.shots[5];
    near(seen(last, [2.5, 0.25, 2.0]), [4.0 + 4.0 * 0.25, 3.0 - 4.0 * 0.125]);
    assert_eq!(film.shots.iter().map(|shot| shot.viewpoint).collect::<std::collections::BTreeSet<_>>().len(), 6);
    // Training cameras stand at 0, 1 and 2.
    assert!((film.extent() - 1.1).abs() < 1e-9);

    let small = open(folder.path(), Some(4)).unwrap();
    assert_eq!((small.size, small.shots[5].pixels.bytes().unwrap().len()), ([3, 4], 36));
    near(seen(&small.shots[5], [2.5, 0.25, 2.0]), [2.0 + 2.0 * 0.25, 1.5 - 2.0 * 0.125]);
    assert!(small.remarks.iter().any(|remark| remark.contains("8x6 are shrunk to 4x3")), "{:?}", small.remarks);
    // Photos are not made larger.
    assert_eq!(open(folder.path(), Some(100)).unwrap(), film);
}

/// Photos that memory has no room for are read from their files: the same pixels, and an error that names a file that
/// went away.
///
/// Promise (results): a film that memory has no room for is read when needed; all photos are trained on where that is
/// asked for.
#[test]
fn photos_that_are_not_kept_are_read_when_needed() {
    let folder = tempfile::tempdir().unwrap();
    dnerf(folder.path());
    let film = open(folder.path(), None).unwrap();
    assert!(film.remarks.is_empty(), "{:?}", film.remarks);
    for kept in [0, 2] {
        let other = open_keeping(folder.path(), None, kept * 3 * 8 * 6 + 7).unwrap();
        assert_eq!(other.shots, film.shots);
        assert_eq!(other.shots.iter().filter(|shot| matches!(shot.pixels, Pixels::Kept(_))).count(), kept);
        assert!(other.remarks[0].contains(&format!("{} of 6 photos are read", 6 - kept)), "{:?}", other.remarks);
    }
    let stored = open_keeping(folder.path(), None, 0).unwrap();
    fs::remove_file(folder.path().join("train/r_000.png")).unwrap();
    let gone: Vec<String> =
        stored.shots.iter().filter_map(|shot| shot.image(stored.size).err()).map(|error| error.to_string()).collect();
    assert!(gone.len() == 1 && gone[0].contains("r_000.png"), "{gone:?}");
}

#[test]
fn transparent_pixels_of_dnerf_are_white() {
    let folder = tempfile::tempdir().unwrap();
    dnerf(folder.path());
    let half = image::RgbaImage::from_fn(8, 6, |x, _| image::Rgba([10, 20, 30, if x < 4 { 0 } else { 255 }]));
    half.save(folder.path().join("train/r_000.png")).unwrap();
    let film = open(folder.path(), None).unwrap();
    assert_eq!(film.shots[0].pixels.bytes().unwrap()[..3], [255; 3]);
    assert_eq!(film.shots[0].pixels.bytes().unwrap()[8 * 3 - 3..8 * 3], [10, 20, 30]);
}

/// Promise of `a_dnerf_film_is_read`.
#[test]
fn dnerf_films_that_cannot_be_used_are_refused() {
    let edited = |from: &'static str, to: &'static str| {
        refused(dnerf, move |folder| edit(folder.join("transforms_train.json"), from, to))
    };
    for (from, to, said) in [
        (
            r#""time": 2.0"#,
            r#""when": 2.0"#,
            "transforms_train.json: frames[1].time: expected a finite number from 0, found nothing",
        ),
        (r#""time": 2.0"#, r#""time": -2.0"#, "frames[1].time: expected a finite number from 0, found -2"),
        (r#""time": 2.0"#, r#""time": NaN"#, "transforms_train.json: line 2 column"),
        (r#""time": 2.0"#, r#""time": "2""#, "frames[1].time: expected a number"),
        ("r_001", "r_007", "frames[1].file_path: expected an image file, found no file"),
        (r#""camera_angle_x""#, r#""k1": 0.1, "camera_angle_x""#, "frames[0]: expected a lens without distortion"),
    ] {
        let error = edited(from, to);
        assert!(error.contains(said), "{to}: {error}");
    }
    let equal = refused(dnerf, |folder| {
        for split in ["train", "test"] {
            for time in ["0.0", "2.0", "1.0", "0.5"] {
                let file = folder.join(format!("transforms_{split}.json"));
                let text = fs::read_to_string(&file).unwrap();
                fs::write(file, text.replace(&format!(r#""time": {time}"#), r#""time": 3.0"#)).unwrap();
            }
        }
    });
    assert!(
        equal.ends_with("transforms_train.json: times: expected at least two, found 3 for all 6 photos"),
        "{equal}"
    );
    let sizes = refused(dnerf, |folder| sized_photo(&folder.join("test/r_001.png"), 0, 10, 6));
    assert!(
        sizes.contains("r_001.png: photo size: expected 8x6, that of ") && sizes.ends_with("found 10x6"),
        "{sizes}"
    );
    let untrained = refused(dnerf, |folder| {
        fs::write(folder.join("transforms_train.json"), r#"{"frames": []}"#).unwrap();
    });
    assert!(untrained.contains("photos to train on: expected at least one, found none"), "{untrained}");
    let untested = refused(dnerf, |folder| fs::remove_file(folder.join("transforms_test.json")).unwrap());
    assert!(untested.contains("transforms_test.json"), "{untested}");
}

/// Three cameras of calibrated size 16 x 12, each 2 behind the origin, that look along z; frames have 8 x 6 pixels.
fn n3v(folder: &Path) {
    n3v_of(folder, 3, 3);
}

fn n3v_of(folder: &Path, cameras: usize, frames: usize) {
    for camera in 0..cameras {
        // One of them as others lay it out.
        let place = folder.join(format!("cam{camera:02}")).join(if camera == 2 { "images" } else { "." });
        for frame in 0..frames {
            photo(&place.join(format!("{}.png", 9 + frame)), (50 * camera + 10 * frame) as u8);
        }
    }
    poses_bounds(folder, cameras);
}

fn poses_bounds(folder: &Path, cameras: usize) {
    let row = |camera: usize| {
        // Down is y, right is x, back is -z.
        [[0.0, 1.0, 0.0, camera as f32, 12.0], [1.0, 0.0, 0.0, 0.0, 16.0], [0.0, 0.0, -1.0, -2.0, 20.0]]
    };
    let rows: Vec<f32> = (0..cameras).flat_map(|camera| [row(camera).concat(), vec![0.5, 9.0]].concat()).collect();
    write_npy(folder.join("poses_bounds.npy"), &[cameras, 17], &rows).unwrap();
}

/// Promise of `a_dnerf_film_is_read`.
#[test]
fn a_neural_3d_video_is_read() {
    let folder = tempfile::tempdir().unwrap();
    n3v(folder.path());
    // Their videos may stay beside the frames.
    fs::write(folder.path().join("cam01.mp4"), "").unwrap();
    assert_eq!(FilmLayout::of(folder.path()).unwrap(), FilmLayout::N3v);
    let film = open(folder.path(), None).unwrap();
    assert_eq!((film.size, film.shots.len(), film.background), ([6, 8], 9, [0.0; 3]));
    assert_eq!(film.times(), [0.0, 1.0 / 3.0, 2.0 / 3.0]);
    for (i, shot) in film.shots.iter().enumerate() {
        let (frame, camera) = (i / 3, i % 3);
        assert_eq!((shot.viewpoint, shot.held_out), (camera, HeldOut { camera: camera == 0, time: false }));
        assert_eq!(
            shot.pixels.bytes().unwrap()[0],
            (50 * camera + 10 * frame) as u8,
            "{}: 9.png is before 10.png",
            shot.name
        );
        // A point 0.5 to the right of the camera, 0.25 below, 4 before it: the focal length is 10 at half size.
        near(seen(shot, [camera as f64 + 0.5, 0.25, 2.0]), [4.0 + 10.0 * 0.125, 3.0 + 10.0 * 0.0625]);
    }
    assert_eq!(film.shots[1].name, Path::new("cam01/./9.png").display().to_string().replace("/./", "/"));
    // The training cameras stand at 1 and 2.
    assert!((film.extent() - 0.55).abs() < 1e-6);
    // Frames of full size are halved.
    for camera in 0..3 {
        let place = folder.path().join(format!("cam{camera:02}")).join(if camera == 2 { "images" } else { "." });
        (9..12).for_each(|frame| sized_photo(&place.join(format!("{frame}.png")), 7, 16, 12));
    }
    let halved = open(folder.path(), None).unwrap();
    assert_eq!((halved.size, halved.shots[4].camera), ([6, 8], film.shots[4].camera));
    assert_eq!(open(folder.path(), Some(16)).unwrap().size, [12, 16]);
}

/// Promise of `a_dnerf_film_is_read`.
#[test]
fn neural_3d_videos_that_cannot_be_used_are_refused() {
    let video = refused(n3v, |folder| {
        fs::remove_dir_all(folder.join("cam01")).unwrap();
        fs::write(folder.join("cam01.mp4"), "").unwrap();
    });
    // Backslashes are quoted.
    let video = video.replace('\'', "");
    for part in ["cam01.mp4: frames: expected", "`mkdir -p ", "cam01 && ffmpeg -i ", "cam01.mp4 ", "cam01/%04d.png`"] {
        assert!(video.contains(part), "{part}: {video}");
    }
    let gone = refused(n3v, |folder| fs::remove_dir_all(folder.join("cam01")).unwrap());
    assert!(
        gone.contains("poses_bounds.npy: shape: expected [2, 17] for 2 cameras, cam00 to cam02, found [3, 17]"),
        "{gone}"
    );
    let fewer = refused(n3v, |folder| fs::remove_file(folder.join("cam01/11.png")).unwrap());
    assert!(fewer.ends_with("cam01: frames: expected 3, as many as of cam00, found 2"), "{fewer}");
    let empty =
        refused(n3v, |folder| (9..12).for_each(|i| fs::remove_file(folder.join(format!("cam01/{i}.png"))).unwrap()));
    assert!(empty.ends_with("cam01: frames: expected photos in it or in its folder images, found none"), "{empty}");
    let size = refused(n3v, |folder| sized_photo(&folder.join("cam01/10.png"), 0, 6, 8));
    assert!(size.contains("10.png: photo size: expected 8x6, that of ") && size.ends_with("found 6x8"), "{size}");
    let shape = refused(n3v, |folder| {
        for camera in 0..3 {
            let place = folder.join(format!("cam{camera:02}")).join(if camera == 2 { "images" } else { "." });
            (9..12).for_each(|i| sized_photo(&place.join(format!("{i}.png")), 0, 9, 6));
        }
    });
    assert!(shape.contains("photo size: expected the shape of its camera's 16x12, found 9x6"), "{shape}");
    let bounds = refused(n3v, |folder| write_npy(folder.join("poses_bounds.npy"), &[3, 5], &[0.0; 15]).unwrap());
    assert!(bounds.ends_with("poses_bounds.npy: shape: expected [cameras, 17], found [3, 5]"), "{bounds}");
    for (cameras, frames, said) in [
        (1, 3, ": cameras: expected at least two, found cam00"),
        (2, 1, "cam00: frames: expected at least two, found 1"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        n3v_of(folder.path(), cameras, frames);
        let error = open(folder.path(), None).unwrap_err().to_string();
        assert!(error.ends_with(said), "{error}");
    }
}

/// Four photos of full size 16 x 12 by a camera that moves along x; only their half sizes are there.
fn hypernerf(folder: &Path) {
    fs::create_dir_all(folder.join("camera")).unwrap();
    fs::write(folder.join("scene.json"), r#"{"scale": 0.5, "center": [1.0, 0.0, 0.0]}"#).unwrap();
    let split = r#"{"ids": ["p0", "p1", "p2", "p3", "p4"], "train_ids": ["p0", "p2", "p3"], "val_ids": ["p1"]}"#;
    fs::write(folder.join("dataset.json"), split).unwrap();
    let times = r#"{"p0": {"warp_id": 0}, "p1": {"warp_id": 2}, "p2": {"warp_id": 4}, "p3": {"time_id": 8}}"#;
    fs::write(folder.join("metadata.json"), times).unwrap();
    for i in 0..4_u8 {
        let camera = format!(
            r#"{{"orientation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "position": [{i}.0, 0.0, -4.0], "focal_length": 20.0,
            "principal_point": [8.0, 5.0], "pixel_aspect_ratio": 1.0, "skew": 0.0, "radial_distortion": [0.0, 0.0, 0.0],
            "tangential_distortion": [0.0, 0.0], "image_size": [16, 12]}}"#
        );
        fs::write(folder.join(format!("camera/p{i}.json")), camera).unwrap();
        photo(&folder.join(format!("rgb/2x/p{i}.png")), 20 * i);
    }
}

/// Promise of `a_dnerf_film_is_read`.
#[test]
fn a_hypernerf_film_is_read() {
    let folder = tempfile::tempdir().unwrap();
    hypernerf(folder.path());
    write_npy(folder.path().join("points.npy"), &[2, 3], &[1.0, 0.0, 0.0, 3.0, 2.0, 0.0]).unwrap();
    assert_eq!(FilmLayout::of(folder.path()).unwrap(), FilmLayout::HyperNerf);
    let film = open(folder.path(), None).unwrap();
    assert_eq!((film.size, film.times()), ([6, 8], vec![0.0, 0.25, 0.5, 1.0]));
    assert_eq!(held_out(&film), [(false, false), (true, true), (false, false), (false, false)]);
    assert_eq!(film.shots.iter().map(|shot| shot.pixels.bytes().unwrap()[0]).collect::<Vec<_>>(), [0, 20, 40, 60]);
    for (i, shot) in film.shots.iter().enumerate() {
        // A point 1 to the right of the camera and 4 before it, centered and scaled as the camera is.
        let right = (i as f64 + 1.0 - 1.0) * 0.5;
        near(seen(shot, [right, 0.0, 0.0]), [4.0 + 10.0 * 0.25, 2.5]);
    }
    let positions: Vec<DVec3> = film.points.iter().map(|point| point.position).collect();
    assert_eq!(positions, [DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0)]);
    assert!(film.points.iter().all(|point| (point.color, point.time) == ([0.5; 3], 0.0)));
    let remarks = film.remarks.join("\n");
    for part in ["photos are those in rgb/2x", "1 ids are neither in train_ids nor in val_ids", "points have no colors"]
    {
        assert!(remarks.contains(part), "{part}: {remarks}");
    }
    // Of full size, if only they are there: the same cameras, twice as large.
    fs::remove_dir_all(folder.path().join("rgb/2x")).unwrap();
    (0..4).for_each(|i| sized_photo(&folder.path().join(format!("rgb/1x/p{i}.png")), 9, 16, 12));
    let full = open(folder.path(), None).unwrap();
    near(seen(&full.shots[2], [1.0, 0.0, 0.0]), [8.0 + 20.0 * 0.25, 5.0]);
    assert!(full.remarks[0].contains("rgb/1x"), "{:?}", full.remarks);
}

/// A validation photo at the time of another is held out for its camera alone.
#[test]
fn validation_photos_hold_out_their_cameras() {
    let folder = tempfile::tempdir().unwrap();
    hypernerf(folder.path());
    edit(folder.path().join("metadata.json"), r#""p1": {"warp_id": 2}"#, r#""p1": {"warp_id": 4}"#);
    let film = open(folder.path(), None).unwrap();
    // Photos of one time are in the order of their cameras, training photos first.
    assert_eq!(held_out(&film), [(false, false), (false, false), (true, false), (false, false)]);
}

/// Promise of `a_dnerf_film_is_read`.
#[test]
fn hypernerf_films_that_cannot_be_used_are_refused() {
    for (file, from, to, said) in [
        (
            "camera/p1.json",
            r#""skew": 0.0"#,
            r#""skew": 0.5"#,
            "p1.json: skew: expected 0: others are not supported, found 0.5",
        ),
        ("camera/p1.json", "[0.0, 0.0, 0.0]", "[0.0, 0.1, 0.0]", "p1.json: radial_distortion: expected zeros"),
        (
            "metadata.json",
            r#""warp_id": 2"#,
            r#""warp_id": -2"#,
            "metadata.json: p1: expected a finite number from 0, found -2",
        ),
        ("metadata.json", r#""warp_id": 2"#, "", "metadata.json: p1: expected warp_id or time_id"),
        ("dataset.json", r#""p0", "p2", "p3"], "val"#, r#"], "val"#, "photos to train on: expected at least one"),
        ("dataset.json", r#"["p1"]"#, r#"["p7"]"#, "p7.json"),
    ] {
        let error = refused(hypernerf, |folder| {
            if to == r#"], "val"# {
                // One photo alone would be one camera alone.
                edit(folder.join(file), r#"["p1"]"#, r#"["p1", "p2"]"#);
            }
            edit(folder.join(file), from, to);
        });
        assert!(error.contains(said), "{to}: {error}");
    }
    let missing = refused(hypernerf, |folder| fs::remove_file(folder.join("rgb/2x/p2.png")).unwrap());
    assert!(missing.ends_with("p2.png: photo: expected a file, found nothing"), "{missing}");
    let none = refused(hypernerf, |folder| fs::rename(folder.join("rgb/2x"), folder.join("rgb/8x")).unwrap());
    assert!(none.ends_with("rgb: photos: expected a folder 2x, 1x or 4x, found none of them"), "{none}");
    let still = refused(hypernerf, |folder| {
        let camera = fs::read(folder.join("camera/p0.json")).unwrap();
        (1..4).for_each(|i| fs::write(folder.join(format!("camera/p{i}.json")), &camera).unwrap());
    });
    assert!(still.ends_with(": cameras: expected at least two, found 1"), "{still}");
    let points = refused(hypernerf, |folder| write_npy(folder.join("points.npy"), &[3], &[0.0; 3]).unwrap());
    assert!(points.ends_with("points.npy: shape: expected [points, 3], found [3]"), "{points}");
}

#[test]
fn other_folders_are_no_films() {
    let folder = tempfile::tempdir().unwrap();
    let error = open(folder.path(), None).unwrap_err().to_string();
    assert!(error.contains("poses_bounds.npy (Neural 3D Video)") && error.ends_with("found none of them"), "{error}");
    hypernerf(folder.path());
    let error = open(folder.path(), Some(0)).unwrap_err().to_string();
    assert!(error.ends_with("size: expected at least one pixel, found 0"), "{error}");
    let error = open(folder.path().join("scene.json"), None).unwrap_err().to_string();
    assert!(error.ends_with("film: expected a folder, found a file"), "{error}");
}
