//! What stands where: a patterned ground, walls behind, three to six objects, one soft light, a flat sky.

use super::draws::Draws;
use super::solid::{Shape, Solid};
use super::texture::{Texture, color};
use weaver_geometry::glam::{DVec2, DVec3};

/// Objects stand within this distance of the origin.
const STAGE: f64 = 1.8;

/// Everything a ray can meet. The z axis points up, the ground is at z = 0, cameras stand on the -y side.
#[derive(Clone, Debug)]
pub(super) struct World {
    pub solids: Vec<Solid>,
    /// Unit vector toward the light.
    pub light: DVec3,
    /// Sky colors, at the horizon and overhead, as displayed.
    pub sky: [DVec3; 2],
}

/// Where a ray met a solid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit<'a> {
    /// Ray parameter.
    pub t: f64,
    pub solid: &'a Solid,
}

impl World {
    pub fn compose(draws: &mut Draws) -> Self {
        let mut solids = vec![Solid {
            shape: block(DVec3::new(0.0, 0.0, -0.1), DVec3::new(7.0, 7.0, 0.1), 0.0),
            texture: Texture::wide(draws),
        }];
        let height = draws.within(0.6, 1.6);
        solids.push(Solid {
            shape: block(
                DVec3::new(draws.within(-1.0, 1.0), draws.within(2.6, 3.6), height),
                DVec3::new(draws.within(2.5, 5.0), 0.1, height),
                draws.within(-0.15, 0.15),
            ),
            texture: Texture::wide(draws),
        });
        if draws.chance(0.6) {
            let side = if draws.chance(0.5) { 1.0 } else { -1.0 };
            let height = draws.within(0.5, 1.3);
            solids.push(Solid {
                shape: block(
                    DVec3::new(side * draws.within(4.7, 5.3), draws.within(1.5, 2.5), height),
                    DVec3::new(0.1, draws.within(1.0, 2.0), height),
                    draws.within(-0.15, 0.15),
                ),
                texture: Texture::wide(draws),
            });
        }
        solids.extend(objects(draws));
        let sky_hue = draws.within(0.5, 0.68);
        Self {
            solids,
            light: direction(draws.within(-2.6, -0.5), draws.within(0.6, 1.1)),
            sky: [
                color(sky_hue, draws.within(0.05, 0.2), draws.within(0.85, 0.97)),
                color(sky_hue, draws.within(0.3, 0.6), draws.within(0.7, 0.9)),
            ],
        }
    }

    /// The first solid on the ray `origin + t direction`, t > 0.
    pub fn trace(&self, origin: DVec3, direction: DVec3) -> Option<Hit<'_>> {
        let mut first: Option<Hit> = None;
        for solid in &self.solids {
            if let Some(t) = solid.shape.hit(origin, direction)
                && first.is_none_or(|hit| t < hit.t)
            {
                first = Some(Hit { t, solid });
            }
        }
        first
    }

    /// Whether anything lies on the ray before `t = end`.
    pub fn blocked(&self, origin: DVec3, direction: DVec3, end: f64) -> bool {
        self.solids.iter().any(|solid| solid.shape.hit(origin, direction).is_some_and(|t| t < end))
    }
}

/// Three to six balls and blocks on the ground that do not touch.
fn objects(draws: &mut Draws) -> Vec<Solid> {
    let wanted = 3 + draws.below(4);
    let mut solids = Vec::with_capacity(wanted);
    let mut taken: Vec<(DVec2, f64)> = Vec::with_capacity(wanted);
    // Twenty tries each find a place for six of the largest footprint in all but freak draws.
    for _ in 0..20 * wanted {
        if solids.len() == wanted {
            break;
        }
        let footprint = draws.within(0.3, 0.65);
        let place =
            DVec2::from_angle(draws.within(0.0, std::f64::consts::TAU)) * (STAGE * draws.within(0.0, 1.0).sqrt());
        if taken.iter().any(|(other, size)| other.distance(place) < size + footprint + 0.05) {
            continue;
        }
        taken.push((place, footprint));
        let shape = if draws.chance(0.4) {
            Shape::Ball { center: place.extend(footprint), radius: footprint }
        } else {
            let aspect = draws.within(0.5, 1.1);
            let flat = DVec2::from_angle(aspect) * footprint;
            let half = flat.extend(draws.within(0.2, 0.8));
            block(place.extend(half.z), half, draws.within(0.0, std::f64::consts::PI))
        };
        solids.push(Solid { shape, texture: Texture::small(draws) });
    }
    solids
}

fn block(center: DVec3, half: DVec3, turn: f64) -> Shape {
    Shape::Block { center, half, turn: DVec2::from_angle(turn) }
}

/// Unit vector of an azimuth and an elevation, in radians.
fn direction(azimuth: f64, elevation: f64) -> DVec3 {
    (DVec2::from_angle(azimuth) * elevation.cos()).extend(elevation.sin())
}
