//! Ray casting: several rays per pixel for color, one through its center for depth.

use super::solid::Solid;
use super::world::{self, Hit, World};
use weaver_geometry::Camera;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_io::Image;
use weaver_kernels::random::Stream;

/// Shadow rays start this far off the surface, in scene units.
const LIFT: f64 = 1e-6;
/// Pixels along a tile's side; a tile's rays share the lists of solids that they can meet.
const TILE: usize = 8;
/// Angles and lengths that only rounding makes.
const ROUNDING: f64 = 1e-6;

/// A photo and its exact data at every pixel's center, 0 where there is only sky.
pub(super) struct Exposure {
    pub image: Image,
    /// Along the optical axis.
    pub depth: Vec<f32>,
    /// The number of the solid that is seen, from 1.
    pub instances: Vec<u16>,
}

/// Exposure and tone of photos.
#[derive(Clone, Copy, Debug)]
pub(super) struct Film {
    /// Rays per pixel along each axis.
    pub grid: usize,
    /// Factor on the light of all photos, by channel.
    pub gain: DVec3,
    /// Standard deviation over the photos of the logarithm of a further factor.
    pub exposure: f64,
    /// Standard deviation of the noise of displayed values.
    pub noise: f64,
}

impl Film {
    /// Sixteen rays per pixel, and nothing between light and photo.
    pub const PLAIN: Self = Self { grid: 4, gain: DVec3::ONE, exposure: 0.0, noise: 0.0 };

    /// The photo that `camera` takes; `stream` is exposure and noise.
    pub fn photograph(&self, world: &World, camera: &Camera, stream: Stream) -> Exposure {
        let gain = self.gain * (self.exposure * stream.normal::<f64>(0)).exp();
        let mut image = Image::filled(camera.width, camera.height, [0.0; 3]);
        let mut depth = vec![0.0; camera.width * camera.height];
        let mut instances = vec![0; depth.len()];
        for top in (0..camera.height).step_by(TILE) {
            for left in (0..camera.width).step_by(TILE) {
                let tile =
                    Tile { left, top, right: camera.width.min(left + TILE), bottom: camera.height.min(top + TILE) };
                for Pixel { at, color, center } in self.tile(world, camera, tile, gain) {
                    image.pixels[3 * at..3 * at + 3].copy_from_slice(&color.as_vec3().to_array());
                    if let Some(hit) = center {
                        depth[at] = hit.t as f32;
                        let number = world.solids.iter().position(|solid| std::ptr::eq(solid, hit.solid));
                        instances[at] = number.map_or(0, |number| number as u16 + 1);
                    }
                }
            }
        }
        if self.noise > 0.0 {
            // Uniform noise: as good for learning as normal noise, and several times as fast to draw.
            let (width, stream) = (self.noise * 12.0_f64.sqrt(), stream.fork(0));
            for (i, value) in image.pixels.iter_mut().enumerate() {
                let noise = width * (stream.uniform::<f64>(i as u64) - 0.5);
                *value = (*value + noise as f32).clamp(0.0, 1.0);
            }
        }
        Exposure { image, depth, instances }
    }

    /// The pixels of a tile.
    fn tile<'a>(&self, world: &'a World, camera: &Camera, tile: Tile, gain: DVec3) -> Vec<Pixel<'a>> {
        let samples = self.grid * self.grid;
        let seen = tile.seen(world, camera);
        let pixels = || (tile.top..tile.bottom).flat_map(|y| (tile.left..tile.right).map(move |x| (x, y)));
        let corners = pixels().map(|(x, y)| DVec2::new(x as f64, y as f64));
        let rays: Vec<(Ray, Option<Hit>)> = corners
            .flat_map(|corner| (0..samples).map(move |sample| corner + self.grid_point(sample)))
            .map(|point| Ray::through(camera, point))
            .map(|ray| (ray, world::trace(&seen, ray.origin, ray.direction)))
            .collect();
        let points = rays.iter().filter_map(|(ray, hit)| hit.map(|hit| ray.at(hit.t)));
        let shading = Shading {
            world,
            casters: world.casters(points),
            gain,
            width: 1.0 / (camera.intrinsics.fx * self.grid as f64),
        };
        pixels()
            .zip(rays.chunks_exact(samples))
            .map(|((x, y), rays)| {
                let mut sum = DVec3::ZERO;
                for (sample, (ray, hit)) in rays.iter().enumerate() {
                    // Another order for the light, so that a pixel's corner and the light's are not tied.
                    sum += shading.color(*ray, *hit, self.grid_point(sample * 7 % samples));
                }
                let center = Ray::through(camera, DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
                let center = world::trace(&seen, center.origin, center.direction);
                Pixel { at: y * camera.width + x, color: sum / samples as f64, center }
            })
            .collect()
    }

    /// Cell center `index` of the sample grid over the unit square.
    fn grid_point(&self, index: usize) -> DVec2 {
        DVec2::new((index % self.grid) as f64 + 0.5, (index / self.grid) as f64 + 0.5) / self.grid as f64
    }
}

/// A pixel: its index, its color and the surface at its center.
struct Pixel<'a> {
    at: usize,
    color: DVec3,
    center: Option<Hit<'a>>,
}

/// Part of an image, pixels; `right` and `bottom` are beyond it.
#[derive(Clone, Copy, Debug)]
struct Tile {
    left: usize,
    top: usize,
    right: usize,
    bottom: usize,
}

impl Tile {
    /// The solids that rays through the tile can meet: those whose ball reaches into the cone around the tile.
    fn seen<'a>(&self, world: &'a World, camera: &Camera) -> Vec<&'a Solid> {
        let [x0, y0, x1, y1] = [self.left, self.top, self.right, self.bottom].map(|edge| edge as f64);
        let toward = |x: f64, y: f64| Ray::through(camera, DVec2::new(x, y)).direction;
        let axis = toward((x0 + x1) / 2.0, (y0 + y1) / 2.0);
        let half = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| axis.angle_between(toward(x, y)));
        let half = half.into_iter().fold(0.0, f64::max) + ROUNDING;
        let eye = camera.pose.center();
        let meets = |solid: &&Solid| {
            let (center, radius) = solid.shape.bounds();
            let distance = center.distance(eye);
            distance <= radius || axis.angle_between(center - eye) <= half + (radius / distance).asin()
        };
        world.solids.iter().filter(meets).collect()
    }
}

/// A ray whose parameter is depth along the optical axis.
#[derive(Clone, Copy, Debug)]
struct Ray {
    origin: DVec3,
    direction: DVec3,
}

impl Ray {
    /// The ray through a point of the image.
    fn through(camera: &Camera, pixel: DVec2) -> Self {
        let direction = camera.pose.rotation.transpose() * camera.intrinsics.unproject(pixel, 1.0);
        Self { origin: camera.pose.center(), direction }
    }

    fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }
}

/// Inputs of the colors of a tile.
struct Shading<'a> {
    world: &'a World,
    /// The solids that can stand between the light and the surfaces of the tile.
    casters: Vec<&'a Solid>,
    gain: DVec3,
    /// Growth of a ray's width per unit of depth.
    width: f64,
}

impl Shading<'_> {
    /// Displayed color of the surface that a ray meets; `light` in the unit square chooses a point of the light.
    fn color(&self, ray: Ray, hit: Option<Hit>, light: DVec2) -> DVec3 {
        let Some(hit) = hit else {
            let [horizon, zenith] = self.world.sky;
            let up = (ray.direction.z / ray.direction.length()).max(0.0);
            return (horizon.lerp(zenith, up) * self.gain).min(DVec3::ONE);
        };
        let point = ray.at(hit.t);
        let (normal, uv) = hit.solid.shape.surface(point);
        let (to_light, end) = self.world.light.toward(point, light);
        let facing = normal.dot(to_light);
        let lit = facing > 0.0 && !world::blocked(&self.casters, point + normal * LIFT, to_light, end);
        let [everywhere, from_above] = self.world.light.ambient;
        let ambient = everywhere + from_above * normal.z;
        let brightness = ambient + if lit { self.world.light.direct * facing } else { 0.0 };
        // A slanted surface fills the ray's width in one direction and more in the other: their mean on a log scale.
        let slant = (-normal.dot(ray.direction) / ray.direction.length()).max(0.05);
        let footprint = self.width * hit.t / slant.sqrt();
        // Square root: display values of linear light, close to the sRGB curve and cheap.
        let linear = hit.solid.texture.color(uv, footprint) * brightness * self.gain;
        linear.clamp(DVec3::ZERO, DVec3::ONE).map(f64::sqrt)
    }
}
