//! Lenses that are functions of the angle to the optical axis, which may exceed a right one.

use glam::{DMat2, DVec2, DVec3};
use std::f64::consts::PI;

/// Angles to the axis that are looked at for where a lens folds back.
const ANGLES: usize = 1024;
/// Largest angle to the axis: at 180 degrees, one direction is a circle on the image.
const LAST: f64 = PI * 0.999;
/// Halvings of the range of angles before Newton's steps.
const HALVINGS: usize = 16;
/// Newton's steps; each doubles the number of exact digits.
const STEPS: usize = 10;
/// Largest error of a place, over its distance from the axis plus 1.
const TOLERANCE: f64 = 1e-10;

/// A lens that sees the direction at the angle a from the axis at `g(h(a) e)`, e its direction across the axis, of
/// length 1; h is the angle, or that of the field-of-view model, and g a polynomial.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Angles {
    /// w of the field-of-view model.
    pub omega: Option<f64>,
    pub k: [f64; 6],
    pub p: [f64; 2],
    pub s: [f64; 4],
    /// True if p and s act on the place after the polynomial of k, else on the one before it.
    pub after: bool,
}

impl Angles {
    /// The angle itself, without a polynomial.
    pub const EQUIDISTANT: Self = Self { omega: None, k: [0.0; 6], p: [0.0; 2], s: [0.0; 4], after: false };

    /// h and its derivative.
    fn height(&self, angle: f64) -> (f64, f64) {
        let Some(omega) = self.omega else { return (angle, 1.0) };
        let (widening, (sin, cos)) = (2.0 * (0.5 * omega).tan(), angle.sin_cos());
        let slope = widening / (cos * cos + widening * widening * sin * sin);
        ((widening * sin).atan2(cos) / omega, slope / omega)
    }

    /// The inverse of [`height`](Self::height).
    fn angle(&self, height: f64) -> f64 {
        let Some(omega) = self.omega else { return height };
        let (sin, cos) = (omega * height).sin_cos();
        sin.atan2(2.0 * (0.5 * omega).tan() * cos)
    }

    /// The polynomial of k and its derivative by the square of the distance.
    fn scale(&self, r2: f64) -> (f64, f64) {
        let fold = |sum: (f64, f64), k: &f64| (r2 * (sum.0 + k), sum.0 + k + r2 * sum.1);
        let (sum, slope) = self.k.iter().rev().fold((0.0, 0.0), fold);
        (1.0 + sum, slope)
    }

    /// g and its derivative.
    fn bend(&self, at: DVec2) -> (DVec2, DMat2) {
        let (scale, slope) = self.scale(at.length_squared());
        let (far, dfar) = (at * scale, outer(at, at) * (2.0 * slope) + DMat2::from_diagonal(DVec2::splat(scale)));
        let base = if self.after { far } else { at };
        let (DVec2 { x, y }, r2) = (base, base.length_squared());
        let ([p1, p2], [s0, s1, s2, s3]) = (self.p, self.s);
        let shift = DVec2::new(
            2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (s0 + r2 * s1),
            p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (s2 + r2 * s3),
        );
        let mixed = 2.0 * (p1 * x + p2 * y);
        let tangential =
            DMat2::from_cols_array(&[2.0 * p1 * y + 6.0 * p2 * x, mixed, mixed, 6.0 * p1 * y + 2.0 * p2 * x]);
        let prism = outer(DVec2::new(s0 + 2.0 * r2 * s1, s2 + 2.0 * r2 * s3), 2.0 * base);
        let dshift = tangential + prism;
        (far + shift, dfar + if self.after { dshift * dfar } else { dshift })
    }

    /// The place of a direction of any length; at any angle, also where the lens sees nothing.
    pub fn project(&self, direction: DVec3) -> DVec2 {
        let across = direction.truncate();
        let (height, _) = self.height(across.length().atan2(direction.z));
        self.bend(across.normalize_or_zero() * height).0
    }

    /// The derivative of [`project`](Self::project): two rows.
    pub fn jacobian(&self, direction: DVec3) -> [DVec3; 2] {
        let (across, z) = (direction.truncate(), direction.z);
        let (r, r2) = (across.length(), direction.length_squared());
        let (height, slope) = self.height(r.atan2(z));
        // On the axis every direction across it will do.
        let along = if r > 0.0 { across / r } else { DVec2::X };
        let widening = if r > 0.0 { height / r } else { slope / z };
        // d angle = (z dr - r dz) / (r^2 + z^2)
        let radial = slope / r2;
        let plane = outer(along, along) * (radial * z - widening) + DMat2::from_diagonal(DVec2::splat(widening));
        let (_, bend) = self.bend(across.normalize_or_zero() * height);
        let (flat, deep) = ((bend * plane).transpose(), bend * along * (-radial * r));
        [flat.x_axis.extend(deep.x), flat.y_axis.extend(deep.y)]
    }

    /// The direction of length 1 that is seen at a place, up to an angle; `None` where there is none.
    pub fn ray(&self, seen: DVec2, last: f64) -> Option<DVec3> {
        let far = seen.length();
        let radius = |height: f64| height * self.scale(height * height).0;
        let (mut low, mut high) = (0.0, self.height(last).0);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            *(if radius(middle) < far { &mut low } else { &mut high }) = middle;
        }
        let mut at = seen.normalize_or_zero() * (0.5 * (low + high));
        let close = TOLERANCE * (1.0 + far);
        let mut off = f64::INFINITY;
        for _ in 0..STEPS {
            let (place, slope) = self.bend(at);
            off = place.distance(seen);
            if off <= 1e-3 * close {
                break;
            }
            at -= slope.inverse() * (place - seen);
        }
        let angle = self.angle(at.length());
        // Both are also false for NaN.
        if !(off <= close && angle <= last) {
            return None;
        }
        let (sin, cos) = angle.sin_cos();
        Some((at.normalize_or_zero() * sin).extend(cos))
    }

    /// The largest angle up to which the distance from the axis grows.
    pub fn last_angle(&self) -> f64 {
        let angle = |i: usize| LAST * i as f64 / ANGLES as f64;
        let grows = |i: &usize| {
            let (height, _) = self.height(angle(*i));
            let (scale, slope) = self.scale(height * height);
            scale + 2.0 * height * height * slope > 0.0
        };
        angle((1..=ANGLES).take_while(grows).last().unwrap_or(0))
    }
}

/// a b^T
fn outer(a: DVec2, b: DVec2) -> DMat2 {
    DMat2::from_cols(a * b.x, a * b.y)
}
