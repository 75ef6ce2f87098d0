//! Balls and blocks, and where rays meet them.

use super::texture::Texture;
use weaver_geometry::glam::{DMat3, DVec2, DVec3};

/// A closed shape, seen from outside.
#[derive(Clone, Copy, Debug)]
pub(super) enum Shape {
    Ball {
        center: DVec3,
        radius: f64,
    },
    /// A box turned about the vertical; walls and the ground are thin ones.
    Block {
        center: DVec3,
        half: DVec3,
        /// Cosine and sine of the turn.
        turn: DVec2,
    },
    /// An ellipsoid or a box, turned in any way.
    Turned {
        center: DVec3,
        half: DVec3,
        /// World axes to the shape's own.
        into: DMat3,
        /// An ellipsoid.
        round: bool,
    },
}

/// A shape and how it is colored.
#[derive(Clone, Debug)]
pub(super) struct Solid {
    pub shape: Shape,
    pub texture: Texture,
}

/// Turns the horizontal part of `v` by minus the block's own turn: world axes to block axes.
fn into_block(v: DVec3, turn: DVec2) -> DVec3 {
    DVec3::new(turn.x * v.x + turn.y * v.y, turn.x * v.y - turn.y * v.x, v.z)
}

fn out_of_block(v: DVec3, turn: DVec2) -> DVec3 {
    into_block(v, DVec2::new(turn.x, -turn.y))
}

/// The distance at which a ray enters a ball whose center lies at `to` from the ray's origin.
fn enter_ball(to: DVec3, direction: DVec3, radius: f64) -> Option<f64> {
    let a = direction.length_squared();
    let b = to.dot(direction);
    let discriminant = b * b - a * (to.length_squared() - radius * radius);
    if discriminant < 0.0 {
        return None;
    }
    let t = (b - discriminant.sqrt()) / a;
    (t > 0.0).then_some(t)
}

/// The distance at which a ray enters the box between `-half` and `half`.
fn enter_box(origin: DVec3, direction: DVec3, half: DVec3) -> Option<f64> {
    let inverse = direction.recip();
    let (a, b) = ((-half - origin) * inverse, (half - origin) * inverse);
    let near = a.min(b).max_element();
    let far = a.max(b).min_element();
    (near > 0.0 && near <= far).then_some(near)
}

const BALL: Shape = Shape::Ball { center: DVec3::ZERO, radius: 1.0 };

fn upright(half: DVec3) -> Shape {
    Shape::Block { center: DVec3::ZERO, half, turn: DVec2::X }
}

impl Shape {
    /// Center and radius of a ball around the shape.
    pub fn bounds(&self) -> (DVec3, f64) {
        match *self {
            Self::Ball { center, radius } => (center, radius),
            Self::Turned { center, half, round: true, .. } => (center, half.max_element()),
            Self::Block { center, half, .. } | Self::Turned { center, half, .. } => (center, half.length()),
        }
    }

    /// The shape moved by a vector and, but for a ball, turned about the vertical through its center, radians.
    pub fn moved(&self, by: DVec3, angle: f64) -> Self {
        let mut moved = *self;
        match &mut moved {
            Self::Ball { center, .. } => *center += by,
            Self::Block { center, turn, .. } => {
                *center += by;
                *turn = DVec2::from_angle(angle).rotate(*turn);
            }
            Self::Turned { center, into, .. } => {
                *center += by;
                *into *= DMat3::from_rotation_z(-angle);
            }
        }
        moved
    }

    /// The smallest `t > 0` with `origin + t direction` on the surface, for an origin outside.
    pub fn hit(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        match *self {
            Self::Ball { center, radius } => enter_ball(center - origin, direction, radius),
            Self::Block { center, half, turn } => {
                enter_box(into_block(origin - center, turn), into_block(direction, turn), half)
            }
            // The map is affine: rays stay rays, and their parameter stays the same.
            Self::Turned { center, half, into, round } => {
                let (o, d) = (into * (origin - center), into * direction);
                if round { enter_ball(-o / half, d / half, 1.0) } else { enter_box(o, d, half) }
            }
        }
    }

    /// Outward normal and surface coordinates (scene units) at `point` on the surface.
    pub fn surface(&self, point: DVec3) -> (DVec3, DVec2) {
        match *self {
            Self::Ball { center, radius } => {
                let n = (point - center) / radius;
                let uv = DVec2::new(n.y.atan2(n.x), n.z.clamp(-1.0, 1.0).asin()) * radius;
                (n, uv)
            }
            Self::Block { center, half, turn } => {
                let local = into_block(point - center, turn);
                let q = (local / half).abs();
                let (normal, uv) = if q.z >= q.x && q.z >= q.y {
                    (DVec3::Z * local.z.signum(), DVec2::new(local.x, local.y))
                } else if q.x >= q.y {
                    (DVec3::X * local.x.signum(), DVec2::new(local.y, local.z))
                } else {
                    (DVec3::Y * local.y.signum(), DVec2::new(local.x, local.z))
                };
                (out_of_block(normal, turn), uv)
            }
            Self::Turned { center, half, into, round } => {
                let local = into * (point - center);
                let (normal, uv) = if round {
                    let (normal, uv) = BALL.surface(local / half);
                    ((normal / half).normalize(), uv * half.element_sum() / 3.0)
                } else {
                    upright(half).surface(local)
                };
                (into.transpose() * normal, uv)
            }
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;
    use weaver_geometry::glam::EulerRot;

    pub fn inside(shape: &Shape, p: DVec3) -> bool {
        match *shape {
            Shape::Ball { center, radius } => p.distance(center) < radius,
            Shape::Block { center, half, turn } => {
                let along = |axis: DVec2| (p - center).truncate().dot(axis).abs();
                along(turn) < half.x && along(turn.perp()) < half.y && (p.z - center.z).abs() < half.z
            }
            Shape::Turned { center, half, into, round } => {
                let q = into * (p - center) / half;
                if round { q.length() < 1.0 } else { q.abs().max_element() < 1.0 }
            }
        }
    }

    fn vector(size: f64) -> impl Strategy<Value = DVec3> {
        [-size..size, -size..size, -size..size].prop_map(DVec3::from)
    }

    fn shape() -> impl Strategy<Value = Shape> {
        let half = || [0.2..0.9, 0.2..0.9, 0.2..0.9].prop_map(DVec3::from);
        prop_oneof![
            (vector(0.5), 0.3..1.0).prop_map(|(center, radius)| Shape::Ball { center, radius }),
            (vector(0.5), half(), 0.0..6.3).prop_map(|(center, half, turn)| Shape::Block {
                center,
                half,
                turn: DVec2::from_angle(turn)
            }),
            (vector(0.5), half(), vector(3.0), any::<bool>()).prop_map(|(center, half, angles, round)| {
                let into = DMat3::from_euler(EulerRot::XYZ, angles.x, angles.y, angles.z);
                Shape::Turned { center, half, into, round }
            }),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]

        /// Walking along the ray in small steps finds the same entry, and the normal there faces the viewer.
        #[test]
        fn a_hit_is_where_a_walk_enters(shape in shape(), origin in vector(1.0), aim in vector(1.2)) {
            let origin = origin.normalize_or(DVec3::X) * 3.0;
            let direction = aim - origin;
            let step = 1e-3;
            let walked = (0..2000).map(|i| f64::from(i) * step).find(|&t| inside(&shape, origin + t * direction));
            let hit = shape.hit(origin, direction);
            match (walked, hit) {
                (Some(walked), Some(t)) => {
                    prop_assert!(t <= walked && walked - t <= step, "walked {walked}, hit {t}");
                    let (normal, _) = shape.surface(origin + t * direction);
                    prop_assert!((normal.length() - 1.0).abs() < 1e-9);
                    prop_assert!(normal.dot(direction) <= 1e-9);
                    prop_assert!(!inside(&shape, origin + t * direction + 1e-6 * normal));
                    prop_assert!(inside(&shape, origin + t * direction - 1e-6 * normal));
                }
                (None, None) => {}
                // A grazed edge can lie between two steps.
                (None, Some(t)) => {
                    let out = |s: f64| !inside(&shape, origin + s * direction);
                    prop_assert!(out(t + step), "missed an entry at {t}");
                }
                (Some(walked), None) => prop_assert!(false, "no hit, but inside at {walked}"),
            }
        }
    }
}
