//! Layout of a varied scene: objects of all sizes around the focus, and walls near or far around the cameras.

use super::color::color;
use super::draws::Draws;
use super::pyramid::Pyramid;
use super::render::Film;
use super::solid::{Shape, Solid};
use super::texture::Texture;
use super::world::{Light, Source, World, block, direction};
use std::sync::Arc;
use weaver_geometry::Camera;
use weaver_geometry::glam::{DMat3, DVec2, DVec3, EulerRot};

/// Most of the objects stand within this distance of the z axis.
const STAGE: f64 = 1.8;
/// Images that the surfaces of a scene share.
const IMAGES: usize = 5;
/// Share of the scenes with walls all round and a ceiling.
const ROOMS: f64 = 0.45;
/// Half the thickness of walls.
const THIN: f64 = 0.1;

impl World {
    /// A world around cameras: none of them is inside a solid, or sees little but one object.
    pub fn around(cameras: &[Camera], draws: &mut Draws) -> Self {
        let images: Vec<Arc<Pyramid>> = (0..IMAGES).map(|_| Arc::new(image(draws))).collect();
        let room = draws.chance(ROOMS);
        let widest = if room { 3.0 } else { 12.0 };
        let mut margin = || logarithmic(0.6, widest, draws);
        let eyes = || cameras.iter().map(|camera| camera.pose.center());
        let low = eyes().fold(DVec3::splat(-STAGE), DVec3::min) - DVec3::new(margin(), margin(), 0.0);
        let high = eyes().fold(DVec3::splat(STAGE), DVec3::max) + DVec3::new(margin(), margin(), 0.0);
        let ceiling = high.z + draws.within(0.4, 1.6);

        let mut solids = objects(&images, [low, high], room, draws);
        solids.retain(|solid| cameras.iter().all(|camera| keeps_clear(&solid.shape, camera)));
        let mut surface = |shape, draws: &mut Draws| {
            solids.push(Solid { shape, texture: Texture::image(&images, 2.0, draws) });
        };
        let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
        let ground = half.truncate() + if room { THIN } else { 30.0 };
        let lying = |z: f64| block(middle.with_z(z), ground.extend(THIN), 0.0);
        surface(lying(-THIN), draws);
        if room {
            surface(lying(ceiling + THIN), draws);
        }
        for (axis, other) in [(DVec3::X, DVec3::Y), (DVec3::Y, DVec3::X)] {
            for side in [-1.0, 1.0] {
                let height = if room { ceiling } else { logarithmic(0.5, 6.0, draws) } / 2.0;
                if room || draws.chance(0.45) {
                    let center = middle.with_z(height) + side * axis * (half + THIN);
                    surface(block(center, axis * THIN + other * (half + THIN) + DVec3::Z * height, 0.0), draws);
                }
            }
        }
        let source = if room {
            let place = low.lerp(high, draws.within(0.3, 0.7)).with_z(ceiling - 0.15);
            Source::Lamp(place)
        } else {
            Source::Sun(direction(draws.within(0.0, std::f64::consts::TAU), draws.within(0.35, 1.3)))
        };
        let ambient = [draws.within(0.15, 0.6), draws.within(0.0, 0.15)];
        let light = Light { source, direct: draws.within(0.3, 1.2), ambient };
        let hue = draws.within(0.45, 0.7);
        let sky = [(0.0, 0.25, 0.7, 1.0), (0.1, 0.6, 0.5, 0.95)]
            .map(|(s0, s1, v0, v1)| color(hue, draws.within(s0, s1), draws.within(v0, v1)));
        Self { solids, light, sky }
    }
}

impl Film {
    /// Four rays per pixel, a color cast, small differences of exposure between the photos, and up to 2 % of noise.
    pub fn varied(draws: &mut Draws) -> Self {
        let mut channel = || 1.0 + draws.within(-0.08, 0.08);
        let cast = DVec3::new(channel(), channel(), channel());
        let gain = cast * logarithmic(0.6, 2.0, draws);
        Self { grid: 2, gain, exposure: draws.within(0.0, 0.05), noise: draws.within(0.0, 0.02) }
    }
}

/// An image for surfaces: two in three are dead leaves, the others a pattern of the default scenes.
fn image(draws: &mut Draws) -> Pyramid {
    if draws.chance(2.0 / 3.0) {
        return Pyramid::dead_leaves(draws);
    }
    let pattern = Texture::wide(draws);
    Pyramid::of(|p| pattern.color(p * 4.0, 0.0))
}

/// Three to thirty objects on the stage, on the ground or above it, and up to ten larger ones elsewhere.
fn objects(images: &[Arc<Pyramid>], [low, high]: [DVec3; 2], room: bool, draws: &mut Draws) -> Vec<Solid> {
    let mut solids = Vec::new();
    let hovering = if draws.chance(0.4) { 0.5 } else { 0.0 };
    for _ in 0..logarithmic(3.0, 30.0, draws) as usize {
        let place = on_disk(draws) * STAGE;
        let size = logarithmic(0.1, 0.7, draws);
        let lift = if draws.chance(hovering) { draws.within(0.0, 1.5) } else { 0.0 };
        solids.push(object(place, size, lift, images, draws));
    }
    let beyond = DVec2::splat(if room { -0.3 } else { 8.0 });
    for _ in 0..draws.below(10) {
        let (from, to) = (low.truncate() - beyond, high.truncate() + beyond);
        let place = DVec2::new(draws.within(from.x, to.x), draws.within(from.y, to.y));
        let size = if room { logarithmic(0.2, 0.8, draws) } else { logarithmic(0.3, 2.5, draws) };
        solids.push(object(place, size, 0.0, images, draws));
    }
    solids
}

/// An object that stands at a place, or hovers above it.
fn object(place: DVec2, size: f64, lift: f64, images: &[Arc<Pyramid>], draws: &mut Draws) -> Solid {
    let half = DVec3::new(size, size * draws.within(0.4, 1.0), size * draws.within(0.4, 1.4));
    let turn = draws.within(0.0, std::f64::consts::TAU);
    let shape = match draws.below(4) {
        0 => Shape::Ball { center: place.extend(lift + size), radius: size },
        1 | 2 if lift == 0.0 => block(place.extend(half.z), half, turn),
        kind => {
            let (lean, nod) = (draws.within(-0.8, 0.8), draws.within(-0.8, 0.8));
            let into = DMat3::from_euler(EulerRot::XYZ, lean, nod, turn);
            // It may reach into the ground.
            Shape::Turned { center: place.extend(lift + 0.8 * half.z), half, into, round: kind == 3 }
        }
    };
    Solid { shape, texture: Texture::image(images, 0.7 + size, draws) }
}

/// True if a shape leaves a camera free, and at least two fifths of the width of its view.
fn keeps_clear(shape: &Shape, camera: &Camera) -> bool {
    let (center, radius) = shape.bounds();
    let tangent = camera.width as f64 / 2.0 / camera.intrinsics.fx;
    let distance = center.distance(camera.pose.center());
    distance > radius + 0.2 && radius < 0.6 * tangent * distance
}

/// Uniform on the unit disk.
fn on_disk(draws: &mut Draws) -> DVec2 {
    DVec2::from_angle(draws.within(0.0, std::f64::consts::TAU)) * draws.within(0.0, 1.0).sqrt()
}

/// Between `low` and `high`, uniform on a log scale.
fn logarithmic(low: f64, high: f64, draws: &mut Draws) -> f64 {
    low * (high / low).powf(draws.within(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::procedural::ProceduralOptions;
    use crate::procedural::path::Path;
    use crate::procedural::solid::tests::inside;
    use weaver_kernels::random::Stream;

    /// No camera is inside a solid and none outside a room.
    #[test]
    fn cameras_are_in_rooms_and_not_in_solids() {
        let options = ProceduralOptions { width: 64, height: 48, views: 8 };
        let mut rooms = 0;
        for seed in 0..300 {
            let draws = &mut Draws::new(Stream::new(seed, 0, "test"));
            let cameras = Path::varied(options.views, draws).cameras(&options, draws);
            let world = World::around(&cameras, draws);
            for camera in &cameras {
                let eye = camera.pose.center();
                assert!(world.solids.iter().all(|solid| !inside(&solid.shape, eye)), "seed {seed}");
                if let Source::Lamp(_) = world.light.source {
                    rooms += 1;
                    let out = [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z];
                    assert!(
                        out.into_iter().all(|d| world.blocked(eye, d, f64::INFINITY)),
                        "seed {seed}: a gap in the walls"
                    );
                }
            }
        }
        assert!((0.35..0.55).contains(&(f64::from(rooms) / 2400.0)), "{rooms} of 2400 cameras in rooms");
    }
}
