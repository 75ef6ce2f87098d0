//! Balls and blocks, and where rays meet them.

use super::texture::Texture;
use weaver_geometry::glam::{DVec2, DVec3};

/// A closed shape, seen from outside.
#[derive(Clone, Copy, Debug)]
pub(super) enum Shape {
    Ball {
        centre: DVec3,
        radius: f64,
    },
    /// A box turned about the vertical; walls and the ground are thin ones.
    Block {
        centre: DVec3,
        half: DVec3,
        /// Cosine and sine of the turn.
        turn: DVec2,
    },
}

/// A shape and how it is coloured.
#[derive(Clone, Copy, Debug)]
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

impl Shape {
    /// The smallest `t > 0` with `origin + t direction` on the surface, for an origin outside.
    pub fn hit(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        match *self {
            Self::Ball { centre, radius } => {
                let to = centre - origin;
                let a = direction.length_squared();
                let b = to.dot(direction);
                let discriminant = b * b - a * (to.length_squared() - radius * radius);
                if discriminant < 0.0 {
                    return None;
                }
                let t = (b - discriminant.sqrt()) / a;
                (t > 0.0).then_some(t)
            }
            Self::Block { centre, half, turn } => {
                let o = into_block(origin - centre, turn);
                let inverse = into_block(direction, turn).recip();
                let (a, b) = ((-half - o) * inverse, (half - o) * inverse);
                let near = a.min(b).max_element();
                let far = a.max(b).min_element();
                (near > 0.0 && near <= far).then_some(near)
            }
        }
    }

    /// Outward normal and surface coordinates (scene units) at `point` on the surface.
    pub fn surface(&self, point: DVec3) -> (DVec3, DVec2) {
        match *self {
            Self::Ball { centre, radius } => {
                let n = (point - centre) / radius;
                let uv = DVec2::new(n.y.atan2(n.x), n.z.clamp(-1.0, 1.0).asin()) * radius;
                (n, uv)
            }
            Self::Block { centre, half, turn } => {
                let local = into_block(point - centre, turn);
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
        }
    }
}
