//! `poses_bounds.npy` of LLFF, which Neural 3D Video uses, too.

use crate::{Error, Npy, Result};
use std::path::Path;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, Pose};

/// Numbers of a camera: a 3x5 matrix and two depths.
const NUMBERS: usize = 17;
/// Longer sides are taken for errors.
const LONGEST: f64 = 65536.0;

/// A camera with the near and far bounds of its view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundedCamera {
    /// Its camera; the principal point is the image's center.
    pub camera: Camera,
    /// Depths of the nearest and the farthest that it sees, scene units.
    pub bounds: [f64; 2],
}

/// Reads the cameras of a `poses_bounds.npy`, `[V, 17]`, in the order of their photos' names.
///
/// Each row is a 3x5 matrix, row by row, with the columns down, right and back (axes of the camera in the world),
/// center, and (height, width, focal length); then two depths. Axes become OpenCV's: right, down, forward.
///
/// ```
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("poses_bounds.npy");
/// // Right along x, down along y, and back along -z, at (5, 6, 7).
/// let row = [0.0, 1.0, 0.0, 5.0, 30.0, 1.0, 0.0, 0.0, 6.0, 40.0, 0.0, 0.0, -1.0, 7.0, 50.0, 1.0, 9.0];
/// weaver_io::write_npy(&path, &[1, 17], &row)?;
/// let camera = weaver_io::llff::read_poses_bounds(&path)?[0].camera;
/// assert_eq!((camera.width, camera.intrinsics.fx, camera.pose.center().z), (40, 50.0, 7.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// When the file is no NPY file of this shape, a number is not finite, a matrix not a rotation, or a size not one of an
/// image.
pub fn read_poses_bounds(path: impl AsRef<Path>) -> Result<Vec<BoundedCamera>> {
    let path = path.as_ref();
    let array = Npy::open(path)?;
    let [_, NUMBERS] = *array.shape() else {
        return Err(Error::invalid(path, "shape", format!("[cameras, {NUMBERS}]"), format!("{:?}", array.shape())));
    };
    let numbers = array.doubles(0..array.len());
    numbers.as_chunks().0.iter().enumerate().map(|(row, numbers)| camera(path, row, numbers)).collect()
}

fn camera(path: &Path, row: usize, numbers: &[f64; NUMBERS]) -> Result<BoundedCamera> {
    let invalid =
        |key: &str, expected: &str, found: String| Error::invalid(path, format!("row {row}, {key}"), expected, found);
    if let Some(column) = numbers.iter().position(|x| !x.is_finite()) {
        return Err(invalid(&format!("column {column}"), "a finite number", numbers[column].to_string()));
    }
    let column = |c: usize| DVec3::new(numbers[c], numbers[5 + c], numbers[10 + c]);
    let (right, down, forward, center) = (column(1), column(0), -column(2), column(3));
    let rows = [0, 1, 2].map(|i| [right[i], down[i], forward[i], center[i]]);
    let to_world = Pose::from_rows(&rows)
        .map_err(|e| invalid("matrix", "a rotation with the columns down, right, back", e.to_string()))?;
    let [height, width, focal] = column(4).to_array();
    for (key, size) in [("height", height), ("width", width)] {
        if !(1.0..=LONGEST).contains(&size) || size.fract() != 0.0 {
            return Err(invalid(key, "a size in pixels", size.to_string()));
        }
    }
    if focal <= 0.0 {
        return Err(invalid("focal length", "a positive one", focal.to_string()));
    }
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx: width / 2.0, cy: height / 2.0 };
    let camera = Camera { pose: to_world.inverse(), intrinsics, width: width as usize, height: height as usize };
    Ok(BoundedCamera { camera, bounds: [numbers[15], numbers[16]] })
}
