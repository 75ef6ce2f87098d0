//! Who moves: one group for each kind of motion, none in the way of the others.

use super::super::draws::Draws;
use super::super::solid::{Shape, Solid};
use super::super::texture::Texture;
use super::super::world::{World, block};
use super::motion::{Motion, Mover};
use std::f64::consts::{PI, TAU};
use weaver_geometry::glam::{DMat3, DVec3, EulerRot};

/// Keys of the ball's path: an eighth of the clip lies between two.
const KEYS: usize = 9;
/// Teeth of both combs together.
const TEETH: usize = 10;
/// Slats in the row.
const SLATS: usize = 11;

/// A world with a part that moves.
#[derive(Clone, Debug)]
pub(super) struct Stage {
    /// The still part, under a sky of one color.
    still: World,
    movers: Vec<Mover>,
}

impl Stage {
    /// The stage of a procedural film; its cameras stand on the -y side.
    ///
    /// Things near the cameras stay low, things behind hover, so that each group is seen from everywhere.
    pub fn compose(draws: &mut Draws) -> Self {
        let mut still = World::outdoors(World::surroundings(draws), draws);
        // A rasterizer has one color behind everything, and photos have 255 steps.
        let sky = (still.sky[0].lerp(still.sky[1], 0.5) * 255.0).round() / 255.0;
        still.sky = [sky; 2];
        let mut movers = vec![tumbler(draws), ball(draws)];
        movers.extend(combs(draws));
        movers.extend(slats(draws));
        movers.push(guest(draws));
        Self { still, movers }
    }

    /// Color of the background, as displayed.
    pub fn sky(&self) -> DVec3 {
        self.still.sky[0]
    }

    /// The world at a time, and the kind of motion of each of its solids: 0 for those that stay.
    pub fn at(&self, time: f64) -> (World, Vec<u8>) {
        let mut world = self.still.clone();
        let mut kinds = vec![0; world.solids.len()];
        for mover in &self.movers {
            if let Some(solid) = mover.at(time) {
                world.solids.push(solid);
                kinds.push(mover.kind);
            }
        }
        (world, kinds)
    }
}

/// A vector within a box around 0.
fn within(half: [f64; 3], draws: &mut Draws) -> DVec3 {
    DVec3::from(half.map(|half| draws.within(-half, half)))
}

fn either(draws: &mut Draws) -> f64 {
    if draws.chance(0.5) { 1.0 } else { -1.0 }
}

/// Kind 1: a block on a cubic path, near on the left.
fn tumbler(draws: &mut Draws) -> Mover {
    let half = DVec3::new(draws.within(0.26, 0.34), draws.within(0.2, 0.26), draws.within(0.2, 0.28));
    let center = DVec3::new(-1.0, -0.75, half.z + 0.2);
    let solid = Solid { shape: block(center, half, draws.within(0.0, PI)), texture: Texture::small(draws) };
    let path = [
        DVec3::X * draws.within(0.25, 0.35) * either(draws) + within([0.0, 0.15, 0.0], draws),
        DVec3::Z * draws.within(0.04, 0.08) + within([0.06, 0.1, 0.0], draws),
        DVec3::Z * draws.within(0.06, 0.1) * either(draws) + within([0.06, 0.1, 0.0], draws),
    ];
    Mover { kind: 1, solid, motion: Motion::Cubic { path, turn: draws.within(1.0, 2.5) * either(draws) } }
}

/// Kind 2: a ball through random keys, above everything else.
fn ball(draws: &mut Draws) -> Mover {
    let radius = draws.within(0.25, 0.32);
    let shape = Shape::Ball { center: DVec3::new(0.0, 0.4, 1.6), radius };
    let solid = Solid { shape, texture: Texture::small(draws) };
    // Left and right in turn: it would hardly move where two keys are near each other.
    let side = either(draws);
    let key = |i: usize, draws: &mut Draws| {
        let side = if i.is_multiple_of(2) { side } else { -side };
        DVec3::new(side * draws.within(0.15, 1.1), draws.within(-0.35, 0.35), draws.within(-0.2, 0.2))
    };
    Mover { kind: 2, solid, motion: Motion::Keys((0..KEYS).map(|i| key(i, draws)).collect()) }
}

/// Kind 3: two combs of upright teeth, interleaved, that shake oppositely, near on the right.
fn combs(draws: &mut Draws) -> Vec<Mover> {
    let (cycles, phase) = (draws.within(3.6, 4.4), draws.within(0.0, TAU));
    let swing = DVec3::Z * draws.within(0.12, 0.16);
    let lean = draws.within(-0.15, 0.15);
    let half = DVec3::new(0.055, 0.055, draws.within(0.2, 0.24));
    let tooth = |i: usize| {
        let along = (i as f64 - (TEETH - 1) as f64 / 2.0) * 0.14;
        let center = DVec3::new(0.98 + along, -0.6 + lean * along, half.z + 0.2);
        let solid = Solid { shape: block(center, half, lean), texture: Texture::small(draws) };
        let phase = if i.is_multiple_of(2) { phase } else { phase + PI };
        Mover { kind: 3, solid, motion: Motion::Shake { swing, cycles, phase } }
    };
    (0..TEETH).map(tooth).collect()
}

/// Kind 4: a row of slats along which a pulse travels that lifts them, at the back.
fn slats(draws: &mut Draws) -> Vec<Mover> {
    let half = DVec3::new(0.1, 0.04, draws.within(0.28, 0.34));
    let lift = DVec3::new(0.0, 0.0, draws.within(0.35, 0.5));
    let (width, side) = (draws.within(0.12, 0.18), either(draws));
    let slat = |i: usize| {
        let place = i as f64 / (SLATS - 1) as f64;
        let center = DVec3::new(side * (place - 0.5) * 2.5, 1.5, half.z + 0.6);
        let solid = Solid { shape: block(center, half, 0.0), texture: Texture::small(draws) };
        Mover { kind: 4, solid, motion: Motion::Pulse { lift, place, width } }
    };
    (0..SLATS).map(slat).collect()
}

/// Kind 5: an ellipsoid or a box that is there in the middle of the clip alone, low in the middle.
fn guest(draws: &mut Draws) -> Mover {
    let half = DVec3::from([0.0; 3].map(|_: f64| draws.within(0.2, 0.3)));
    let tilt = within([0.5, 0.5, PI], draws);
    let into = DMat3::from_euler(EulerRot::XYZ, tilt.x, tilt.y, tilt.z);
    let center = DVec3::new(draws.within(-0.15, 0.0), -0.9, 0.32);
    let shape = Shape::Turned { center, half, into, round: draws.chance(0.5) };
    let solid = Solid { shape, texture: Texture::small(draws) };
    Mover { kind: 5, solid, motion: Motion::Present(draws.within(0.25, 0.35)..draws.within(0.6, 0.7)) }
}
