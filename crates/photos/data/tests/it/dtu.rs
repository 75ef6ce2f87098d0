//! Captures in folders of the layouts that DTU and Tanks and Temples are given in for MVSNet, IDR and NeuS.

use std::fs::{self, File};
use std::io::Write;
use std::path::Path;
use weaver_data::capture::HoldOut;
use weaver_data::posed::{PosedOptions, PosedPhotos, load};
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::{Intrinsics, Pose};
use weaver_io::Image;
use zip::write::{SimpleFileOptions, ZipWriter};

/// Photos of each capture, and a point that all see.
const PHOTOS: usize = 3;
const POINT: [f64; 3] = [10.0, -4.0, 600.0];

/// A camera about a scan in millimeters.
fn camera(i: usize) -> (Intrinsics, Pose) {
    let intrinsics = Intrinsics { fx: 40.0, fy: 41.0, cx: 16.5, cy: 11.5 };
    (intrinsics, Pose::from_wxyz([1.0, 0.05 * i as f64, -0.03, 0.02], DVec3::new(20.0 * i as f64, -7.0, 30.0)))
}

fn picture(path: &Path, brightness: f32) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    Image::filled(32, 24, [brightness; 3]).write_png(path).unwrap();
}

/// The layout of MVSNet.
fn mvsnet(folder: &Path) {
    fs::create_dir_all(folder.join("cams")).unwrap();
    for i in 0..PHOTOS {
        picture(&folder.join(format!("images/{i:08}.png")), 0.25 * (i + 1) as f32);
        let (k, pose) = camera(i);
        let rows: String = pose.rows().map(|row| row.map(|x| x.to_string()).join(" ") + "\n").concat();
        let Intrinsics { fx, fy, cx, cy } = k;
        let text = format!("extrinsic\n{rows}0 0 0 1\n\nintrinsic\n{fx} 0 {cx}\n0 {fy} {cy}\n0 0 1\n\n425.0 2.5\n");
        fs::write(folder.join(format!("cams/{i:08}_cam.txt")), text).unwrap();
    }
}

/// The layout of IDR and NeuS; the left half of each photo counts.
fn idr(folder: &Path) {
    let mut zip = ZipWriter::new(File::create(folder.join("cameras_sphere.npz")).unwrap());
    for i in 0..PHOTOS {
        picture(&folder.join(format!("image/{i:06}.png")), 0.25 * (i + 1) as f32);
        let half: Vec<u8> = (0..24 * 32).flat_map(|at| [if at % 32 < 16 { 255 } else { 0 }; 3]).collect();
        fs::create_dir_all(folder.join("mask")).unwrap();
        Image::from_bytes(32, 24, &half).write_png(folder.join(format!("mask/{i:03}.png"))).unwrap();
        let (k, pose) = camera(i);
        let [r0, r1, r2] = pose.rows();
        // A projection of any scale.
        let scaled = |f: f64, row: [f64; 4], c: f64| [0, 1, 2, 3].map(|j| 0.4 * (f * row[j] + c * r2[j]));
        let matrix = [scaled(k.fx, r0, k.cx), scaled(k.fy, r1, k.cy), r2.map(|x| 0.4 * x), [0.0, 0.0, 0.0, 1.0]];
        let header = format!("{:<117}\n", "{'descr': '<f8', 'fortran_order': False, 'shape': (4, 4), }");
        let options = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
        for name in ["world_mat", "scale_mat"] {
            zip.start_file(format!("{name}_{i}.npy"), options).unwrap();
            zip.write_all(b"\x93NUMPY\x01\x00").unwrap();
            zip.write_all(&(header.len() as u16).to_le_bytes()).unwrap();
            zip.write_all(header.as_bytes()).unwrap();
            zip.write_all(&matrix.as_flattened().iter().flat_map(|x: &f64| x.to_le_bytes()).collect::<Vec<_>>())
                .unwrap();
        }
    }
    zip.finish().unwrap();
}

fn opened(folder: &Path, masks: bool) -> Result<PosedPhotos, weaver_data::Error> {
    load(folder, &PosedOptions { masks, hold_out: HoldOut::Every(3), ..PosedOptions::default() })
}

/// The error of a capture after a change.
fn refused(written: fn(&Path), change: impl FnOnce(&Path)) -> String {
    let folder = tempfile::tempdir().unwrap();
    written(folder.path());
    opened(folder.path(), false).unwrap();
    change(folder.path());
    opened(folder.path(), false).unwrap_err().to_string()
}

/// Promise (results): captures in the layouts of MVSNet and of IDR are read with their cameras and masks; faults are
/// named with file, key, expected and found.
#[test]
fn layouts_of_dtu_are_captures() {
    for (written, masks) in [(mvsnet as fn(&Path), false), (idr, true)] {
        let folder = tempfile::tempdir().unwrap();
        written(folder.path());
        let capture = opened(folder.path(), masks).unwrap();
        assert_eq!(capture.photos.iter().map(|photo| photo.held_out).collect::<Vec<_>>(), [true, false, false]);
        for (i, photo) in capture.photos.iter().enumerate() {
            let seen = |(k, pose): (Intrinsics, Pose)| k.project(pose.apply(DVec3::from(POINT)));
            let found: DVec2 = seen((photo.photo.camera.intrinsics, photo.photo.camera.pose));
            assert!(found.distance(seen(camera(i))) < 1e-6, "{found}");
            let expected = (255.0 * 0.25 * (i + 1) as f32).round() as u8;
            assert!(photo.photo.rgb[0].abs_diff(expected) <= 1, "{}", photo.photo.rgb[0]);
            let inside = photo.photo.mask.as_ref().map_or(32 * 24, |mask| mask.iter().filter(|x| **x).count());
            assert_eq!(inside, if masks { 16 * 24 } else { 32 * 24 });
        }
    }
}

/// Promise of `layouts_of_dtu_are_captures`.
#[test]
fn layouts_of_dtu_say_what_is_wrong() {
    let cam = |folder: &Path| folder.join("cams/00000001_cam.txt");
    let error = refused(mvsnet, |folder| fs::write(cam(folder), "extrinsic\n1 0 0\n").unwrap());
    assert!(error.contains("00000001_cam.txt: extrinsic: expected 16 finite numbers"), "{error}");
    let error = refused(mvsnet, |folder| {
        let text = fs::read_to_string(cam(folder)).unwrap();
        fs::write(cam(folder), text.replace("40 0 16.5", "40 9 16.5")).unwrap();
    });
    assert!(error.contains("00000001_cam.txt: intrinsic: expected fx 0 cx"), "{error}");
    let error = refused(mvsnet, |folder| {
        (0..PHOTOS).for_each(|i| fs::remove_file(folder.join(format!("cams/{i:08}_cam.txt"))).unwrap());
    });
    assert!(error.contains("cams: names of cameras: expected the photos in"), "{error}");
    let error = refused(idr, |folder| picture(&folder.join("image/9.png"), 0.5));
    assert!(
        error.contains("cameras_sphere.npz: projections: expected a world_mat for each of 4 photos, found 3"),
        "{error}"
    );
    let error = refused(idr, |folder| fs::write(folder.join("cameras_sphere.npz"), b"PK no").unwrap());
    assert!(error.contains("cameras_sphere.npz: content: expected a ZIP archive"), "{error}");
    let error = refused(idr, |folder| fs::remove_dir_all(folder.join("image")).unwrap());
    assert!(error.contains("photos: expected a folder images or image"), "{error}");
}
