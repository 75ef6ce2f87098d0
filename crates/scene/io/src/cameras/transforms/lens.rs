//! Lenses of transforms.json.

use super::FrameReader;
use crate::Result;
use serde_json::{Value, json};
use weaver_geometry::Distortion;

/// The coefficients, each 0 where it is missing.
pub(super) const KEYS: [&str; 8] = ["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"];

/// The models that k1, k2, k3, p1 and p2 belong to, whichever of them they use.
const RADIAL: [&str; 5] = ["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"];
const FULL: &str = "FULL_OPENCV";
const FISHEYE: [&str; 3] = ["OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"];

/// Name of a lens.
pub(super) fn model(distortion: Option<Distortion>) -> &'static str {
    match distortion {
        None => "PINHOLE",
        Some(Distortion::Radial { k: [.., 0.0, 0.0, 0.0], .. }) => "OPENCV",
        Some(Distortion::Radial { .. }) => FULL,
        Some(Distortion::Fisheye { .. }) => FISHEYE[0],
    }
}

/// Writes a lens's coefficients into a frame.
pub(super) fn write(distortion: Option<Distortion>, frame: &mut Value) {
    let (k, p) = match &distortion {
        None => return,
        Some(Distortion::Radial { k, p }) => (&k[..], &p[..]),
        Some(Distortion::Fisheye { k }) => (&k[..], &[][..]),
    };
    // Most readers support three coefficients; the others are written where they are not zero.
    let keys = KEYS.iter().zip(k).enumerate().filter(|(i, (_, k))| *i < 3 || **k != 0.0).map(|(_, pair)| pair);
    for (key, value) in keys.chain(KEYS[6..].iter().zip(p)) {
        frame[key] = json!(value);
    }
}

impl FrameReader<'_> {
    pub(super) fn distortion(&self) -> Result<Option<Distortion>> {
        let name = match self.get("camera_model") {
            None => RADIAL[0],
            Some(Value::String(name)) => name,
            Some(other) => return Err(self.invalid("camera_model", "a name", other)),
        };
        // instant-ngp has a flag instead of a name.
        let fisheye = FISHEYE.contains(&name) || self.get("is_fisheye").and_then(Value::as_bool).unwrap_or(false);
        if !(fisheye || RADIAL.contains(&name) || name == FULL) {
            let expected = "PINHOLE, OPENCV, FULL_OPENCV, OPENCV_FISHEYE or one of their simple forms";
            return Err(self.invalid("camera_model", expected, name));
        }
        let mut values = [0.0; KEYS.len()];
        for (key, value) in KEYS.iter().zip(&mut values) {
            *value = self.number(key)?.unwrap_or(0.0);
        }
        let must_be_0: &[usize] = if fisheye {
            &[4, 5, 6, 7]
        } else if name == FULL {
            &[]
        } else {
            &[3, 4, 5]
        };
        if let Some(i) = must_be_0.iter().find(|i| values[**i] != 0.0) {
            let kind = if fisheye { "a fisheye" } else { "OPENCV; k4 to k6 belong to FULL_OPENCV" };
            return Err(self.invalid(KEYS[*i], format!("0 for {kind}"), values[*i]));
        }
        let [k1, k2, k3, k4, k5, k6, p1, p2] = values;
        let distortion = if fisheye {
            Distortion::Fisheye { k: [k1, k2, k3, k4] }
        } else {
            Distortion::Radial { k: [k1, k2, k3, k4, k5, k6], p: [p1, p2] }
        };
        Ok(distortion.or_none())
    }
}
