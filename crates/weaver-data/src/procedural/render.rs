//! Ray casting: sixteen rays per pixel for color, one through its center for depth.

use super::world::World;
use weaver_geometry::Camera;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_io::Image;

/// Rays per pixel along each axis.
const GRID: usize = 4;
/// Half the width of the light as seen from the scene, in radians: shadows have soft edges.
const LIGHT_RADIUS: f64 = 0.07;
/// Shadow rays start this far off the surface, in scene units.
const LIFT: f64 = 1e-6;

/// The photo that `camera` takes.
pub(super) fn photograph(world: &World, camera: &Camera) -> Image {
    let mut pixels = Vec::with_capacity(camera.width * camera.height * 3);
    for y in 0..camera.height {
        for x in 0..camera.width {
            let mut sum = DVec3::ZERO;
            for sample in 0..GRID * GRID {
                let offset = grid_point(sample);
                let (origin, direction) = ray(camera, DVec2::new(x as f64, y as f64) + offset);
                // Another order for the light, so that a pixel's corner and the light's are not tied.
                sum += color(world, origin, direction, grid_point(sample * 7 % (GRID * GRID)));
            }
            let mean = sum / (GRID * GRID) as f64;
            pixels.extend([mean.x as f32, mean.y as f32, mean.z as f32]);
        }
    }
    Image { width: camera.width, height: camera.height, pixels }
}

/// Depth along the optical axis at every pixel's center; 0 where there is only sky.
pub(super) fn depth(world: &World, camera: &Camera) -> Vec<f32> {
    let mut depth = Vec::with_capacity(camera.width * camera.height);
    for y in 0..camera.height {
        for x in 0..camera.width {
            let (origin, direction) = ray(camera, DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
            depth.push(world.trace(origin, direction).map_or(0.0, |hit| hit.t as f32));
        }
    }
    depth
}

/// The ray through a point of the image; its parameter is depth along the optical axis.
fn ray(camera: &Camera, pixel: DVec2) -> (DVec3, DVec3) {
    let direction = camera.pose.rotation.transpose() * camera.intrinsics.unproject(pixel, 1.0);
    (camera.pose.center(), direction)
}

/// Cell center `index` of the sample grid over the unit square.
fn grid_point(index: usize) -> DVec2 {
    DVec2::new((index % GRID) as f64 + 0.5, (index / GRID) as f64 + 0.5) / GRID as f64
}

/// Displayed color of what a ray meets; `light_sample` in the unit square chooses a point of the light.
fn color(world: &World, origin: DVec3, direction: DVec3, light_sample: DVec2) -> DVec3 {
    let Some(hit) = world.trace(origin, direction) else {
        let up = (direction.z / direction.length()).max(0.0);
        return world.sky[0].lerp(world.sky[1], up);
    };
    let point = origin + hit.t * direction;
    let (normal, uv) = hit.solid.shape.surface(point);
    let (across, along) = world.light.any_orthonormal_pair();
    let shift = (light_sample * 2.0 - DVec2::ONE) * LIGHT_RADIUS;
    let to_light = world.light + across * shift.x + along * shift.y;
    let facing = normal.dot(to_light);
    let lit = facing > 0.0 && !world.blocked(point + normal * LIFT, to_light, f64::INFINITY);
    let ambient = 0.25 + 0.12 * normal.z;
    let brightness = ambient + if lit { 0.75 * facing } else { 0.0 };
    // Square root: display values of linear light, close to the sRGB curve and cheap.
    let linear = hit.solid.texture.color(uv) * brightness;
    linear.clamp(DVec3::ZERO, DVec3::ONE).map(f64::sqrt)
}
