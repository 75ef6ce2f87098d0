//! Lenses of transforms.json.

use super::FrameReader;
use crate::Result;
use serde_json::{Value, json};
use std::f64::consts::PI;
use weaver_geometry::Distortion;

/// The coefficients, each 0 where it is missing.
const KEYS: [&str; 8] = ["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"];

/// The models that k1, k2, k3, p1 and p2 belong to, whichever of them they use.
const RADIAL: [&str; 5] = ["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"];
const FULL: &str = "FULL_OPENCV";
/// Models whose keys are COLMAP's names of its parameters.
const THIN_PRISM: &str = "THIN_PRISM_FISHEYE";
const THIN_PRISM_KEYS: [&str; 8] = ["k1", "k2", "k3", "k4", "p1", "p2", "sx1", "sy1"];
const FOV: &str = "FOV";
const OMEGA: &str = "omega";
const RAD_TAN: &str = "RAD_TAN_THIN_PRISM_FISHEYE";
const RAD_TAN_KEYS: [&str; 12] = ["k0", "k1", "k2", "k3", "k4", "k5", "p0", "p1", "s0", "s1", "s2", "s3"];
const FISHEYE: [&str; 3] = ["OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"];

/// True if a key is a coefficient of a lens.
pub(super) fn is_coefficient(key: &str) -> bool {
    [&KEYS[..], &THIN_PRISM_KEYS, &[OMEGA], &RAD_TAN_KEYS].concat().contains(&key)
}

/// Name of a lens.
pub(super) fn model(distortion: Option<Distortion>) -> &'static str {
    match distortion {
        None => "PINHOLE",
        Some(Distortion::Radial { k: [.., 0.0, 0.0, 0.0], .. }) => "OPENCV",
        Some(Distortion::Radial { .. }) => FULL,
        Some(Distortion::Fisheye { .. }) => FISHEYE[0],
        Some(Distortion::ThinPrismFisheye { .. }) => THIN_PRISM,
        Some(Distortion::Fov { .. }) => FOV,
        Some(Distortion::RadTanThinPrism { .. }) => RAD_TAN,
    }
}

/// Writes a lens's coefficients into a frame.
pub(super) fn write(distortion: Option<Distortion>, frame: &mut Value) {
    let (k, p) = match &distortion {
        None => return,
        Some(Distortion::Radial { k, p }) => (&k[..], &p[..]),
        Some(Distortion::Fisheye { k }) => (&k[..], &[][..]),
        Some(Distortion::ThinPrismFisheye { k, p, s }) => {
            return put(frame, &THIN_PRISM_KEYS, &[&k[..], p, s].concat());
        }
        Some(Distortion::Fov { omega }) => return put(frame, &[OMEGA], &[*omega]),
        Some(Distortion::RadTanThinPrism { k, p, s }) => return put(frame, &RAD_TAN_KEYS, &[&k[..], p, s].concat()),
    };
    // Most readers support three coefficients; the others are written where they are not zero.
    let keys = KEYS.iter().zip(k).enumerate().filter(|(i, (_, k))| *i < 3 || **k != 0.0).map(|(_, pair)| pair);
    for (key, value) in keys.chain(KEYS[6..].iter().zip(p)) {
        frame[key] = json!(value);
    }
}

fn put(frame: &mut Value, keys: &[&str], values: &[f64]) {
    keys.iter().zip(values).for_each(|(key, value)| frame[*key] = json!(value));
}

impl FrameReader<'_> {
    /// Numbers by their keys, each 0 where it is missing.
    fn numbers<const N: usize>(&self, keys: &[&str; N]) -> Result<[f64; N]> {
        let mut values = [0.0; N];
        for (key, value) in keys.iter().zip(&mut values) {
            *value = self.number(key)?.unwrap_or(0.0);
        }
        Ok(values)
    }

    pub(super) fn distortion(&self) -> Result<Option<Distortion>> {
        let name = match self.get("camera_model") {
            None => RADIAL[0],
            Some(Value::String(name)) => name,
            Some(other) => return Err(self.invalid("camera_model", "a name", other)),
        };
        match name {
            THIN_PRISM => {
                let [k1, k2, k3, k4, p1, p2, s1, s2] = self.numbers(&THIN_PRISM_KEYS)?;
                return Ok(Some(Distortion::ThinPrismFisheye { k: [k1, k2, k3, k4], p: [p1, p2], s: [s1, s2] }));
            }
            FOV => {
                let [omega] = self.numbers(&[OMEGA])?;
                if !(0.0..PI).contains(&omega) {
                    return Err(self.invalid(OMEGA, "a field of view from 0 to pi", omega));
                }
                return Ok(Distortion::Fov { omega }.or_none());
            }
            RAD_TAN => {
                let [k0, k1, k2, k3, k4, k5, p0, p1, s @ ..] = self.numbers(&RAD_TAN_KEYS)?;
                return Ok(Some(Distortion::RadTanThinPrism { k: [k0, k1, k2, k3, k4, k5], p: [p0, p1], s }));
            }
            _ => {}
        }
        // instant-ngp has a flag instead of a name.
        let fisheye = FISHEYE.contains(&name) || self.get("is_fisheye").and_then(Value::as_bool).unwrap_or(false);
        if !(fisheye || RADIAL.contains(&name) || name == FULL) {
            let expected = "PINHOLE, OPENCV, FULL_OPENCV, OPENCV_FISHEYE or one of their simple forms, \
                THIN_PRISM_FISHEYE, FOV, RAD_TAN_THIN_PRISM_FISHEYE";
            return Err(self.invalid("camera_model", expected, name));
        }
        let values = self.numbers(&KEYS)?;
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
