//! Cameras of LLFF.

use crate::array::npy;
use std::path::{Path, PathBuf};
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_io::llff::read_poses_bounds;

/// Of a camera at (1, 2, 3) that looks along x with z up: right is -y, down is -z, back is -x.
pub const ROW: [f64; 17] = [0.0, 0.0, -1.0, 1.0, 16.0, 0.0, -1.0, 0.0, 2.0, 20.0, -1.0, 0.0, 0.0, 3.0, 24.0, 0.5, 9.0];

pub fn bytes(rows: &[[f64; 17]]) -> Vec<u8> {
    let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({}, 17), }}", rows.len());
    npy(1, &header, &rows.iter().flatten().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>())
}

fn written(folder: &Path, bytes: &[u8]) -> PathBuf {
    std::fs::write(folder.join("poses_bounds.npy"), bytes).unwrap();
    folder.join("poses_bounds.npy")
}

#[test]
fn axes_become_those_of_opencv() {
    let folder = tempfile::tempdir().unwrap();
    let moved = std::array::from_fn(|i| if i == 3 { 1.0 + 1e-9 } else { ROW[i] });
    let cameras = read_poses_bounds(written(folder.path(), &bytes(&[ROW, moved]))).unwrap();
    let camera = cameras[0].camera;
    assert_eq!((camera.width, camera.height, cameras[0].bounds), (20, 16, [0.5, 9.0]));
    // Ahead by 2, to the left (+y) by 0.5, up by 0.25.
    let seen = camera.pose.apply(DVec3::new(3.0, 2.5, 3.25));
    assert!(seen.distance(DVec3::new(-0.5, -0.25, 2.0)) < 1e-12, "{seen}");
    assert!(camera.intrinsics.project(seen).distance(DVec2::new(10.0 - 6.0, 8.0 - 3.0)) < 1e-9);
    // Numbers of 64 bits are not rounded to 32.
    assert!((cameras[1].camera.pose.center().x - 1.0 - 1e-9).abs() < 1e-14);
}

#[test]
fn arrays_of_other_kinds_are_refused() {
    let with = |at: usize, x: f64| bytes(&[ROW, std::array::from_fn(|i| if i == at { x } else { ROW[i] })]);
    let numbers: Vec<u8> = ROW.iter().flat_map(|x| x.to_le_bytes()).collect();
    let shaped = |kind: &str, shape: &str| {
        npy(1, &format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}"), &numbers)
    };
    for (bytes, said) in [
        (shaped("<f8", "(17,)"), "shape: expected [cameras, 17], found [17]"),
        (shaped("<f8", "(17, 1)"), "shape: expected [cameras, 17], found [17, 1]"),
        (shaped("|O", "(1, 17)"), "found |O, Python objects, which are pickled"),
        (shaped("<i8", "(1, 17)"), "descr: expected one of <f2 <f4 <f8 |u1 |b1, found <i8"),
        (with(3, f64::NAN), "row 1, column 3: expected a finite number, found NaN"),
        (with(0, 1.0), "row 1, matrix: expected a rotation"),
        (with(4, 16.5), "row 1, height: expected a size in pixels, found 16.5"),
        (with(14, 0.0), "row 1, focal length: expected a positive one, found 0"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let error = read_poses_bounds(written(folder.path(), &bytes)).unwrap_err().to_string();
        assert!(error.contains("poses_bounds.npy: ") && error.contains(said), "{said}: {error}");
    }
}
