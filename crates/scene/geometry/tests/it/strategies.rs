//! Random geometry.

use proptest::prelude::*;
use weaver_geometry::Pose;
use weaver_geometry::glam::{DMat3, DVec3};

pub fn vector(size: f64) -> impl Strategy<Value = DVec3> {
    [-size..size, -size..size, -size..size].prop_map(DVec3::from_array)
}

pub fn unit() -> impl Strategy<Value = DVec3> {
    vector(1.0).prop_filter_map("too short to normalize", |v| (v.length() > 0.1).then(|| v.normalize()))
}

pub fn rotation() -> impl Strategy<Value = DMat3> {
    (unit(), 0.0..3.1f64).prop_map(|(axis, angle)| DMat3::from_axis_angle(axis, angle))
}

pub fn pose() -> impl Strategy<Value = Pose> {
    (rotation(), vector(5.0)).prop_map(|(r, t)| Pose::new(r, t))
}

/// Largest difference between two matrices.
pub fn distance(a: &DMat3, b: &DMat3) -> f64 {
    (*a - *b).to_cols_array().iter().fold(0.0, |m, d| m.max(d.abs()))
}
