//! Squared distances from planes, and from colors that are linear on triangles.

use std::ops::AddAssign;
use weaver_geometry::glam::{DMat3, DVec3};

/// Share of a quadric's area that pulls a vertex to the middle of its edge: planes alone leave it free along them.
const MIDDLE: f64 = 1e-5;

/// The sum of areas times squared distances, of a point from planes and of its color from the colors there.
///
/// With areas w, planes n.p + d = 0 and colors s = g.p + e, the error of the point p and the color s is
/// p.A p + 2 b.p + c - 2 s.(G p + E) + W s.s, whose least value over s is at s = (G p + E) / W.
/// Source: Hoppe, "New quadric metric for simplifying meshes with appearance attributes", 1999.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quadric {
    planes: DMat3,
    linear: DVec3,
    constant: f64,
    area: f64,
    /// Rows of G.
    gradients: [DVec3; 3],
    offsets: [f64; 3],
}

impl Quadric {
    /// Of nothing.
    pub const ZERO: Self = Self {
        planes: DMat3::ZERO,
        linear: DVec3::ZERO,
        constant: 0.0,
        area: 0.0,
        gradients: [DVec3::ZERO; 3],
        offsets: [0.0; 3],
    };

    /// The plane through a point with a normal of length 1, weighed with an area.
    pub fn of_plane(normal: DVec3, at: DVec3, area: f64) -> Self {
        let d = -normal.dot(at);
        let planes = outer(normal) * area;
        Self { planes, linear: normal * (area * d), constant: area * d * d, ..Self::ZERO }
    }

    /// The plane of a triangle, and the colors of its corners as lengths.
    pub fn of_triangle(corners: [DVec3; 3], colors: [DVec3; 3]) -> Self {
        let [a, b, c] = corners;
        let across = (b - a).cross(c - a);
        let double = across.length();
        if double <= 0.0 {
            return Self::ZERO;
        }
        let (normal, area) = (across / double, 0.5 * double);
        let mut all = Self { area, ..Self::of_plane(normal, a, area) };
        let slopes = [c - b, a - c, b - a].map(|edge| normal.cross(edge) / double);
        for (k, first) in colors[0].to_array().into_iter().enumerate() {
            let g: DVec3 = slopes.iter().zip(colors).map(|(slope, color)| *slope * color[k]).sum();
            let e = first - g.dot(a);
            all.planes += outer(g) * area;
            all.linear += g * (area * e);
            all.constant += area * e * e;
            all.gradients[k] = g * area;
            all.offsets[k] = e * area;
        }
        all
    }

    /// The point of the least error within an edge's length of its middle, or else the middle.
    pub fn best(&self, [from, to]: [DVec3; 2]) -> DVec3 {
        let middle = 0.5 * (from + to);
        let (mut planes, mut linear) = (self.planes, self.linear);
        for (g, e) in self.gradients.iter().zip(self.offsets).filter(|_| self.area > 0.0) {
            planes -= outer(*g) * (1.0 / self.area);
            linear -= *g * (e / self.area);
        }
        let pull = MIDDLE * self.area;
        let at = (planes + DMat3::from_diagonal(DVec3::splat(pull))).inverse() * (middle * pull - linear);
        if at.distance(middle) <= from.distance(to) { at } else { middle }
    }

    /// The color of the least error at a point.
    pub fn color(&self, at: DVec3) -> DVec3 {
        let color = |k: usize| (self.gradients[k].dot(at) + self.offsets[k]) / self.area.max(f64::MIN_POSITIVE);
        DVec3::new(color(0), color(1), color(2))
    }

    /// The error at a point of that color, and a small share of the squared length of an edge: of equal ones the
    /// shortest edge goes.
    pub fn error(&self, at: DVec3, edge: f64) -> f64 {
        let color = self.color(at);
        let own = (self.planes * at).dot(at) + 2.0 * self.linear.dot(at) + self.constant;
        (own - self.area * color.length_squared()).max(0.0) + MIDDLE * self.area * edge * edge
    }
}

impl AddAssign for Quadric {
    fn add_assign(&mut self, other: Self) {
        self.planes += other.planes;
        self.linear += other.linear;
        self.constant += other.constant;
        self.area += other.area;
        for k in 0..3 {
            self.gradients[k] += other.gradients[k];
            self.offsets[k] += other.offsets[k];
        }
    }
}

/// v v^T.
fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}
