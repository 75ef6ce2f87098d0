//! The exponential map of SE(3): rigid transforms and their logarithms, the twists `(v, omega)`.
//!
//! Source: Barfoot, "State Estimation for Robotics", chapter 7 (the left Jacobian of SO(3) and its inverse).

use crate::{Pose, so3};
use glam::{DMat3, DVec3};

/// The transform `[exp(omega) | J v]`, the matrix exponential of the twist.
pub fn exp(v: DVec3, omega: DVec3) -> Pose {
    let hat = so3::hat(omega);
    let (one, two) = jacobian(omega.length());
    let j = DMat3::IDENTITY + hat * one + hat * hat * two;
    Pose::new(so3::exp(omega), j * v)
}

/// The twist `(v, omega)` of a transform; inverse of [`exp`] for angles below pi.
pub fn log(pose: &Pose) -> (DVec3, DVec3) {
    let omega = so3::log(&pose.rotation);
    let hat = so3::hat(omega);
    let inverse = DMat3::IDENTITY - hat * 0.5 + hat * hat * inverse_jacobian(omega.length());
    (inverse * pose.translation, omega)
}

/// `(1 - cos a) / a^2` and `(a - sin a) / a^3`.
fn jacobian(a: f64) -> (f64, f64) {
    let a2 = a * a;
    if a < 0.1 {
        let one = 1.0 / 2.0 - a2 / 24.0 * (1.0 - a2 / 30.0 * (1.0 - a2 / 56.0));
        let two = 1.0 / 6.0 - a2 / 120.0 * (1.0 - a2 / 42.0 * (1.0 - a2 / 72.0));
        return (one, two);
    }
    ((1.0 - a.cos()) / a2, (a - a.sin()) / (a2 * a))
}

/// `(1 - (a/2) cot(a/2)) / a^2`.
fn inverse_jacobian(a: f64) -> f64 {
    let a2 = a * a;
    if a < 0.1 {
        return 1.0 / 12.0 + a2 / 720.0 * (1.0 + a2 / 42.0 * (1.0 + a2 / 40.0));
    }
    let half = a / 2.0;
    (1.0 - half * half.cos() / half.sin()) / a2
}
