//! Layout of a plain scene: a patterned ground, walls behind, three to six objects, one soft light, a flat sky.

use super::color::color;
use super::draws::Draws;
use super::solid::{Shape, Solid};
use super::texture::Texture;
use std::borrow::Borrow;
use std::f64::consts::PI;
use weaver_geometry::glam::{DVec2, DVec3};

/// Objects stand within this distance of the origin.
const STAGE: f64 = 1.8;

/// Everything a ray can meet. The z axis points up, the ground is at z = 0.
#[derive(Clone, Debug)]
pub(super) struct World {
    pub solids: Vec<Solid>,
    pub light: Light,
    /// Sky colors, at the horizon and overhead, as displayed.
    pub sky: [DVec3; 2],
}

/// One soft light, and ambient light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Light {
    pub source: Source,
    /// Brightness of a surface that faces the source.
    pub direct: f64,
    /// Brightness of any surface, and how much more of it those have that face up.
    pub ambient: [f64; 2],
}

/// Source of light.
#[derive(Clone, Copy, Debug)]
pub(super) enum Source {
    /// From far away: the unit vector toward it.
    Sun(DVec3),
    /// From a place.
    Lamp(DVec3),
}

/// Half the width of the light as seen from the scene, in radians: shadows have soft edges.
const LIGHT_RADIUS: f64 = 0.07;
/// Lengths that only rounding makes.
const ROUNDING: f64 = 1e-5;

impl Light {
    /// The direction from a point to the point of the light that `sample` in the unit square chooses, and where on that
    /// ray the light is.
    pub fn toward(&self, point: DVec3, sample: DVec2) -> (DVec3, f64) {
        let (middle, end) = self.middle(point);
        let (across, along) = middle.any_orthonormal_pair();
        let shift = (sample * 2.0 - DVec2::ONE) * LIGHT_RADIUS;
        (middle + across * shift.x + along * shift.y, end)
    }

    /// The unit vector from a point to the middle of the light, and how far it is.
    fn middle(&self, point: DVec3) -> (DVec3, f64) {
        match self.source {
            Source::Sun(direction) => (direction, f64::INFINITY),
            Source::Lamp(place) => ((place - point).normalize(), place.distance(point)),
        }
    }
}

/// Intersection of a ray with a solid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit<'a> {
    /// Ray parameter.
    pub t: f64,
    pub solid: &'a Solid,
}

impl World {
    /// The same place with its sun elsewhere, higher or lower, on any side.
    pub fn under_another_sun(&self, draws: &mut Draws) -> Self {
        let source = Source::Sun(direction(draws.within(-PI, PI), draws.within(0.3, 1.3)));
        let light = Light { source, ..self.light };
        Self { solids: self.solids.clone(), light, sky: self.sky }
    }

    /// The world of a default scene; its cameras stand on the -y side.
    pub fn compose(draws: &mut Draws) -> Self {
        let mut solids = Self::surroundings(draws);
        solids.extend(objects(draws));
        Self::outdoors(solids, draws)
    }

    /// A patterned ground, a wall behind, and mostly one at a side.
    pub fn surroundings(draws: &mut Draws) -> Vec<Solid> {
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
        solids
    }

    /// Some solids under a sun and a sky.
    pub fn outdoors(solids: Vec<Solid>, draws: &mut Draws) -> Self {
        let sky_hue = draws.within(0.5, 0.68);
        Self {
            solids,
            light: Light {
                source: Source::Sun(direction(draws.within(-2.6, -0.5), draws.within(0.6, 1.1))),
                direct: 0.75,
                ambient: [0.25, 0.12],
            },
            sky: [
                color(sky_hue, draws.within(0.05, 0.2), draws.within(0.85, 0.97)),
                color(sky_hue, draws.within(0.3, 0.6), draws.within(0.7, 0.9)),
            ],
        }
    }

    /// The solids that can stand between the light and some points, for [`blocked`]: those whose ball comes near enough
    /// to the way from the ball around the points to the light.
    pub fn casters(&self, points: impl Iterator<Item = DVec3> + Clone) -> Vec<&Solid> {
        let (low, high) = points.clone().fold((DVec3::MAX, DVec3::MIN), |(a, b), p| (a.min(p), b.max(p)));
        let middle = (low + high) / 2.0;
        let spread = points.map(|p| p.distance(middle)).fold(0.0, f64::max);
        let (way, end) = self.light.middle(middle);
        let near = |solid: &&Solid| {
            let (center, radius) = solid.shape.bounds();
            let reach = radius + spread + ROUNDING;
            let along = (center - middle).dot(way);
            let aside = (center - middle - along * way).length();
            // Rays to the rim of the light go astray by at most the diagonal of its radius.
            let astray = LIGHT_RADIUS * std::f64::consts::SQRT_2 * (along.max(0.0) + reach);
            -reach <= along && along <= end + reach + astray && aside <= reach + astray
        };
        self.solids.iter().filter(near).collect()
    }

    /// True if any solid lies on the ray before `t = end`.
    pub fn blocked(&self, origin: DVec3, direction: DVec3, end: f64) -> bool {
        blocked(&self.solids, origin, direction, end)
    }
}

/// The first of some solids on the ray `origin + t direction`, t > 0.
pub(super) fn trace<'a>(solids: &[&'a Solid], origin: DVec3, direction: DVec3) -> Option<Hit<'a>> {
    let mut first: Option<Hit> = None;
    for solid in solids {
        if let Some(t) = solid.shape.hit(origin, direction)
            && first.is_none_or(|hit| t < hit.t)
        {
            first = Some(Hit { t, solid });
        }
    }
    first
}

/// True if any of some solids lies on the ray before `t = end`.
pub(super) fn blocked(solids: &[impl Borrow<Solid>], origin: DVec3, direction: DVec3, end: f64) -> bool {
    solids.iter().any(|solid| solid.borrow().shape.hit(origin, direction).is_some_and(|t| t < end))
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
            block(place.extend(half.z), half, draws.within(0.0, PI))
        };
        solids.push(Solid { shape, texture: Texture::small(draws) });
    }
    solids
}

pub(super) fn block(center: DVec3, half: DVec3, turn: f64) -> Shape {
    Shape::Block { center, half, turn: DVec2::from_angle(turn) }
}

/// Unit vector of an azimuth and an elevation, in radians.
pub(super) fn direction(azimuth: f64, elevation: f64) -> DVec3 {
    (DVec2::from_angle(azimuth) * elevation.cos()).extend(elevation.sin())
}
