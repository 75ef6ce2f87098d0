//! COLMAP's camera models.

use super::CameraModel;
use crate::{Error, Result};
use std::f64::consts::PI;
use std::path::Path;
use weaver_geometry::{Distortion, Intrinsics};

/// COLMAP's camera models: number, name, count of parameters. Models that are `true` in the last column begin with one
/// focal length, the others with two.
pub(super) const MODELS: [(u32, &str, usize, bool); 14] = [
    (0, "SIMPLE_PINHOLE", 3, true),
    (1, "PINHOLE", 4, false),
    (2, "SIMPLE_RADIAL", 4, true),
    (3, "RADIAL", 5, true),
    (4, "OPENCV", 8, false),
    (5, "OPENCV_FISHEYE", 8, false),
    (6, "FULL_OPENCV", 12, false),
    (7, "FOV", 5, false),
    (8, "SIMPLE_RADIAL_FISHEYE", 4, true),
    (9, "RADIAL_FISHEYE", 5, true),
    (10, "THIN_PRISM_FISHEYE", 12, false),
    (11, "RAD_TAN_THIN_PRISM_FISHEYE", 16, false),
    (14, "SIMPLE_FISHEYE", 3, true),
    (15, "FISHEYE", 4, false),
];

/// A camera as a file has it, before its model is interpreted.
pub(super) struct RawCamera<'a> {
    pub path: &'a Path,
    pub id: u32,
    pub model: &'a str,
    pub one_focal: bool,
    pub size: [u64; 2],
    pub parameters: &'a [f64],
}

impl RawCamera<'_> {
    pub fn check(&self) -> Result<CameraModel> {
        let invalid = |expected: &str, found: String| {
            Error::invalid(self.path, format!("camera {} ({})", self.id, self.model), expected, found)
        };
        let [width, height] = self.size;
        if !(1..=1 << 20).contains(&width) || !(1..=1 << 20).contains(&height) {
            return Err(invalid("an image size in pixels", format!("{width}x{height}")));
        }
        let (intrinsics, rest) = match (self.one_focal, self.parameters) {
            (true, &[f, cx, cy, ref rest @ ..]) => (Intrinsics { fx: f, fy: f, cx, cy }, rest),
            (false, &[fx, fy, cx, cy, ref rest @ ..]) => (Intrinsics { fx, fy, cx, cy }, rest),
            _ => return Err(invalid("focal length and principal point", format!("{:?}", self.parameters))),
        };
        let Intrinsics { fx, fy, cx, cy } = intrinsics;
        if ![fx, fy, cx, cy].iter().all(|x| x.is_finite()) || fx <= 0.0 || fy <= 0.0 {
            return Err(invalid("finite intrinsics, focal lengths positive", format!("{:?}", self.parameters)));
        }
        let radial = |k: [f64; 6], p| Distortion::Radial { k, p };
        let distortion = match (self.model, rest) {
            ("SIMPLE_PINHOLE" | "PINHOLE", []) => None,
            ("SIMPLE_RADIAL", &[k]) => Some(Distortion::radial(k)),
            ("RADIAL", &[k1, k2]) => Some(radial([k1, k2, 0.0, 0.0, 0.0, 0.0], [0.0; 2])),
            ("OPENCV", &[k1, k2, p1, p2]) => Some(radial([k1, k2, 0.0, 0.0, 0.0, 0.0], [p1, p2])),
            ("FULL_OPENCV", &[k1, k2, p1, p2, k3, k4, k5, k6]) => Some(radial([k1, k2, k3, k4, k5, k6], [p1, p2])),
            ("OPENCV_FISHEYE", &[k1, k2, k3, k4]) => Some(Distortion::Fisheye { k: [k1, k2, k3, k4] }),
            ("SIMPLE_RADIAL_FISHEYE", &[k]) => Some(Distortion::Fisheye { k: [k, 0.0, 0.0, 0.0] }),
            ("RADIAL_FISHEYE", &[k1, k2]) => Some(Distortion::Fisheye { k: [k1, k2, 0.0, 0.0] }),
            ("SIMPLE_FISHEYE" | "FISHEYE", []) => Some(Distortion::Fisheye { k: [0.0; 4] }),
            ("THIN_PRISM_FISHEYE", &[k1, k2, p1, p2, k3, k4, s1, s2]) => {
                Some(Distortion::ThinPrismFisheye { k: [k1, k2, k3, k4], p: [p1, p2], s: [s1, s2] })
            }
            ("FOV", &[omega]) if (0.0..PI).contains(&omega) => Some(Distortion::Fov { omega }),
            ("FOV", [omega]) => return Err(invalid("a field of view from 0 to pi", omega.to_string())),
            ("RAD_TAN_THIN_PRISM_FISHEYE", &[k0, k1, k2, k3, k4, k5, p0, p1, s0, s1, s2, s3]) => {
                Some(Distortion::RadTanThinPrism { k: [k0, k1, k2, k3, k4, k5], p: [p0, p1], s: [s0, s1, s2, s3] })
            }
            _ => return Err(invalid("parameters of the model", format!("{:?}", self.parameters))),
        };
        if distortion.is_some_and(|distortion| !distortion.is_finite()) {
            return Err(invalid("finite distortion", format!("{rest:?}")));
        }
        let distortion = distortion.and_then(Distortion::or_none);
        Ok(CameraModel { width: width as usize, height: height as usize, intrinsics, distortion })
    }
}

impl CameraModel {
    /// Number, name and parameters of the smallest model that is the camera.
    pub(super) fn written(&self) -> (u32, &'static str, Vec<f64>) {
        let Intrinsics { fx, fy, cx, cy } = self.intrinsics;
        let (number, rest) = match self.distortion {
            None => (1, vec![]),
            Some(Distortion::Radial { k: [k1, k2, k3, k4, k5, k6], p: [p1, p2] }) => {
                let simple = [k3, k4, k5, k6] == [0.0; 4];
                if simple { (4, vec![k1, k2, p1, p2]) } else { (6, vec![k1, k2, p1, p2, k3, k4, k5, k6]) }
            }
            Some(Distortion::Fisheye { k }) => (5, k.to_vec()),
            Some(Distortion::Fov { omega }) => (7, vec![omega]),
            Some(Distortion::ThinPrismFisheye { k: [k1, k2, k3, k4], p: [p1, p2], s: [s1, s2] }) => {
                (10, vec![k1, k2, p1, p2, k3, k4, s1, s2])
            }
            Some(Distortion::RadTanThinPrism { k, p, s }) => (11, [&k[..], &p, &s].concat()),
        };
        // The models up to here are numbered without gaps.
        let (_, name, _, _) = MODELS[number as usize];
        (number, name, [vec![fx, fy, cx, cy], rest].concat())
    }
}
