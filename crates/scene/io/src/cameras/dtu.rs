//! Cameras of DTU and of Tanks and Temples as MVSNet, IDR and NeuS store them: text files, and projections in an
//! archive.

use crate::files::file::read_text;
use crate::{Error, Npz, Result};
use std::path::Path;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Intrinsics, Pose};

/// Largest product of axes of a pixel, of the focal length, that is no skew.
const LARGEST_SKEW: f64 = 1e-3;

/// Reads `*_cam.txt` of MVSNet: `extrinsic` and 16 numbers, world to camera row by row, then `intrinsic` and 9 numbers.
/// The rest, depths of planes, is ignored.
///
/// ```
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("00000000_cam.txt");
/// std::fs::write(&path, "extrinsic\n1 0 0 2\n0 1 0 0\n0 0 1 0\n0 0 0 1\n\nintrinsic\n50 0 20\n0 60 15\n0 0 1\n\n425 2.5\n")?;
/// let (intrinsics, pose) = weaver_io::dtu::read_cam(&path)?;
/// assert_eq!((intrinsics.fy, pose.center().x), (60.0, -2.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// When the file cannot be read, numbers are missing or not finite, or a matrix is no rotation or no pinhole camera.
pub fn read_cam(path: impl AsRef<Path>) -> Result<(Intrinsics, Pose)> {
    let path = path.as_ref();
    let text = read_text(path)?;
    let after = |key: &str, count: usize| -> Result<Vec<f64>> {
        let mut words = text.split_whitespace().skip_while(|word| *word != key).skip(1);
        let numbers: Vec<f64> = words.by_ref().take(count).map_while(|word| word.parse().ok()).collect();
        let finite = numbers.len() == count && numbers.iter().all(|x: &f64| x.is_finite());
        let found = format!("{} of them", numbers.iter().filter(|x| x.is_finite()).count());
        finite
            .then_some(numbers)
            .ok_or_else(|| Error::invalid(path, key, format!("{count} finite numbers behind it"), found))
    };
    let (e, k) = (after("extrinsic", 16)?, after("intrinsic", 9)?);
    let rows = [0, 4, 8].map(|at| [e[at], e[at + 1], e[at + 2], e[at + 3]]);
    let pose =
        Pose::from_rows(&rows).map_err(|error| Error::invalid(path, "extrinsic", "a rotation and a shift", error))?;
    let intrinsics = Intrinsics { fx: k[0], fy: k[4], cx: k[2], cy: k[5] };
    let pinhole = k[0] > 0.0
        && k[4] > 0.0
        && k[1].abs() < LARGEST_SKEW * k[0]
        && [k[3], k[6], k[7], k[8]] == [0.0, 0.0, 0.0, 1.0];
    if !pinhole {
        return Err(Error::invalid(path, "intrinsic", "fx 0 cx, 0 fy cy, 0 0 1", format!("{k:?}")));
    }
    Ok((intrinsics, pose))
}

/// Reads `cameras.npz` of IDR and NeuS: `world_mat_0`, `world_mat_1`, ..., each a 4x4 matrix whose first three rows are
/// the projection `K [R | t]`, of any scale. `scale_mat_i`, which brings the object into a sphere, is ignored: cameras
/// stay in the units of the scan.
///
/// # Errors
/// When the file is no archive of such arrays, a number is not finite, or a matrix is no pinhole camera.
pub fn read_projections(path: impl AsRef<Path>) -> Result<Vec<(Intrinsics, Pose)>> {
    let path = path.as_ref();
    let arrays = Npz::open(path)?;
    let names = arrays.names();
    let count = (0..).take_while(|i| names.binary_search(&format!("world_mat_{i}")).is_ok()).count();
    let numbered = if count == 0 { 0..1 } else { 0..count };
    numbered
        .map(|i| {
            let key = format!("world_mat_{i}");
            let array = arrays.array(&key)?;
            if ![[4, 4], [3, 4]].iter().any(|shape| shape == array.shape()) {
                return Err(Error::invalid(path, key, "shape [4, 4]", format!("{:?}", array.shape())));
            }
            let numbers = array.doubles(0..12);
            decomposed(&numbers)
                .ok_or_else(|| Error::invalid(path, key, "the projection of a pinhole camera", format!("{numbers:?}")))
        })
        .collect()
}

/// Intrinsics and pose of a projection of any scale, row by row: the rows of its left 3x3 part are made orthonormal
/// from the last one on.
fn decomposed(p: &[f64]) -> Option<(Intrinsics, Pose)> {
    let row = |i: usize| DVec3::new(p[4 * i], p[4 * i + 1], p[4 * i + 2]);
    let matrix = DMat3::from_cols(row(0), row(1), row(2)).transpose();
    let sign = matrix.determinant().signum();
    let scale = sign * row(2).length();
    if !(p.iter().all(|x| x.is_finite()) && scale != 0.0 && matrix.determinant() != 0.0) {
        return None;
    }
    let [m1, m2, r3] = [0, 1, 2].map(|i| row(i) / scale);
    let cy = m2.dot(r3);
    let fy = (m2 - r3 * cy).length();
    let r2 = (m2 - r3 * cy) / fy;
    let (cx, skew) = (m1.dot(r3), m1.dot(r2));
    let rest = m1 - r3 * cx - r2 * skew;
    let fx = rest.length();
    if skew.abs() > LARGEST_SKEW * fx {
        return None;
    }
    let r1 = rest / fx;
    let [p1, p2, t3] = [3, 7, 11].map(|at| p[at] / scale);
    let t2 = (p2 - cy * t3) / fy;
    let t1 = (p1 - cx * t3 - skew * t2) / fx;
    let rows = [(r1, t1), (r2, t2), (r3, t3)].map(|(r, t)| [r.x, r.y, r.z, t]);
    Some((Intrinsics { fx, fy, cx, cy }, Pose::from_rows(&rows).ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A projection of any scale and sign comes apart into the camera that it was made of.
    #[test]
    fn projections_come_apart() {
        let intrinsics = Intrinsics { fx: 2892.0, fy: 2883.5, cx: 823.2, cy: 619.1 };
        let pose = Pose::from_wxyz([0.8, 0.3, -0.4, 0.33], DVec3::new(-191.0, 3.3, 652.0));
        let rows = pose.rows();
        for scale in [1.0, -0.37, 12.0] {
            let mut p = [0.0; 12];
            for c in 0..4 {
                p[c] = scale * (intrinsics.fx * rows[0][c] + intrinsics.cx * rows[2][c]);
                p[4 + c] = scale * (intrinsics.fy * rows[1][c] + intrinsics.cy * rows[2][c]);
                p[8 + c] = scale * rows[2][c];
            }
            let (k, found) = decomposed(&p).unwrap();
            assert!((k.fx - 2892.0).abs() < 1e-8 && (k.fy - 2883.5).abs() < 1e-8, "{k:?}");
            assert!((k.cx - 823.2).abs() < 1e-8 && (k.cy - 619.1).abs() < 1e-8, "{k:?}");
            assert!(found.center().distance(pose.center()) < 1e-8 && found.angle_to(&pose) < 1e-7);
        }
        assert!(decomposed(&[0.0; 12]).is_none());
    }
}
