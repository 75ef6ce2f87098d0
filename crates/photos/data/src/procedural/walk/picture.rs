//! Photos of boxes: one ray a pixel where a single face fills it, sixteen at edges, and paint that is filtered for its
//! pixel.

use super::paint::{Paint, hash};
use weaver_geometry::Camera;
use weaver_geometry::glam::{DVec2, DVec3, Vec2, Vec3};
use weaver_io::Image;

/// Pixels along the side of a tile, whose rays share the list of boxes that they may meet.
const TILE: usize = 16;
/// Rays of a pixel at an edge, along each axis.
const GRID: usize = 4;
/// Scene units within which nothing is seen.
const NEAR: f64 = 0.05;
/// Brightness of faces toward -x, +x, -y, +y, -z, +z: of a sun and a sky.
const LIGHT: [f32; 6] = [0.72, 0.9, 1.0, 0.8, 0.5, 0.95];
/// Colors at the horizon and overhead.
const SKY: [Vec3; 2] = [Vec3::new(0.84, 0.88, 0.93), Vec3::new(0.55, 0.7, 0.9)];
/// Largest noise of a value.
const GRAIN: f32 = 0.01;

/// A box along the axes. Boxes of one size and paint look the same wherever they stand.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block {
    pub low: DVec3,
    pub high: DVec3,
    pub paint: Paint,
}

impl Block {
    #[cfg(test)]
    pub fn contains(&self, point: DVec3) -> bool {
        point.cmpgt(self.low).all() && point.cmplt(self.high).all()
    }

    /// Where a ray enters the box, with the face: twice the axis, and one more on the upper side.
    fn hit(&self, origin: DVec3, inverse: DVec3) -> Option<(f64, usize)> {
        let (a, b) = ((self.low - origin) * inverse, (self.high - origin) * inverse);
        let (near, far) = (a.min(b), a.max(b).min_element());
        let t = near.max_element();
        let axis = if near.x == t { 0 } else { 1 + usize::from(near.y != t) };
        (t > NEAR && t <= far).then(|| (t, 2 * axis + usize::from(inverse[axis] < 0.0)))
    }
}

/// The photo that a camera takes, and its depth at every pixel's center, 0 for the sky.
pub(super) fn photograph(blocks: &[Block], camera: &Camera, seed: u32) -> (Image, Vec<f32>) {
    let (width, height) = (camera.width, camera.height);
    let tiles = Tiles::new(blocks, camera);
    let corner = |i: usize| DVec2::new((i % width) as f64, (i / width) as f64);
    let hits: Vec<Hit> = (0..width * height).map(|i| tiles.trace(corner(i) + 0.5)).collect();
    let mut image = Image::filled(width, height, [0.0; 3]);
    for (i, pixel) in image.pixels.chunks_exact_mut(3).enumerate() {
        let (x, y) = (i % width, i / width);
        let same = |is: bool, other: usize| !is || hits[i].same_face(&hits[other]);
        let inside = same(x > 0, i.saturating_sub(1)) && same(y > 0, i.saturating_sub(width));
        let color = if inside && same(x + 1 < width, i + 1) && same(y + 1 < height, i + width) {
            tiles.color(&hits[i], corner(i) + 0.5)
        } else {
            let part = |k: usize| DVec2::new((k % GRID) as f64 + 0.5, (k / GRID) as f64 + 0.5) / GRID as f64;
            let rays = (0..GRID * GRID).map(|k| corner(i) + part(k));
            rays.map(|at| tiles.color(&tiles.trace(at), at)).sum::<Vec3>() / (GRID * GRID) as f32
        };
        for (c, value) in pixel.iter_mut().enumerate() {
            *value = (color[c] + GRAIN * (2.0 * hash(i as u32, c as u32, seed) - 1.0)).clamp(0.0, 1.0);
        }
    }
    (image, hits.iter().map(|hit| hit.z as f32).collect())
}

/// First hit of a ray; none where `z` is 0.
#[derive(Clone, Copy, Debug)]
struct Hit {
    z: f64,
    block: u32,
    face: u8,
}

impl Hit {
    fn same_face(&self, other: &Self) -> bool {
        self.block == other.block && self.face == other.face
    }
}

/// The boxes that each tile of a photo may show.
struct Tiles<'a> {
    blocks: &'a [Block],
    camera: &'a Camera,
    eye: DVec3,
    /// For each tile its boxes with their smallest depths, the nearest first.
    lists: Vec<Vec<(f64, u32)>>,
}

impl<'a> Tiles<'a> {
    fn new(blocks: &'a [Block], camera: &'a Camera) -> Self {
        let [across, down] = [camera.width, camera.height].map(|size| size.div_ceil(TILE));
        let mut lists = vec![Vec::new(); across * down];
        for (number, block) in blocks.iter().enumerate() {
            let ends = [block.low, block.high];
            let corner = |i: usize| DVec3::new(ends[i & 1].x, ends[i >> 1 & 1].y, ends[i >> 2].z);
            let corners: [DVec3; 8] = std::array::from_fn(|i| camera.pose.apply(corner(i)));
            let nearest = corners.iter().map(|c| c.z).fold(f64::INFINITY, f64::min);
            let farthest = corners.iter().map(|c| c.z).fold(f64::NEG_INFINITY, f64::max);
            let (mut low, mut high) = (DVec2::ZERO, DVec2::new(camera.width as f64, camera.height as f64) - 1.0);
            if nearest > NEAR {
                let seen = corners.map(|c| camera.intrinsics.project(c));
                low = low.max(seen.iter().copied().fold(high + 1.0, DVec2::min).floor());
                high = high.min(seen.iter().copied().fold(-DVec2::ONE, DVec2::max).ceil());
            }
            if farthest < NEAR || low.cmpgt(high).any() {
                continue;
            }
            let (low, high) = (low.as_usizevec2() / TILE, high.as_usizevec2() / TILE);
            for tile in (low.y..=high.y).flat_map(|y| (low.x..=high.x).map(move |x| y * across + x)) {
                lists[tile].push((nearest, number as u32));
            }
        }
        lists.iter_mut().for_each(|list| list.sort_by(|a, b| a.0.total_cmp(&b.0)));
        Self { blocks, camera, eye: camera.pose.center(), lists }
    }

    /// The ray through a point of the photo; its parameter is depth.
    fn direction(&self, pixel: DVec2) -> DVec3 {
        self.camera.pose.rotation.transpose() * self.camera.intrinsics.unproject(pixel, 1.0)
    }

    fn trace(&self, pixel: DVec2) -> Hit {
        let inverse = self.direction(pixel).recip();
        let tile = pixel.as_usizevec2() / TILE;
        let mut first = Hit { z: 0.0, block: u32::MAX, face: 0 };
        for (nearest, block) in &self.lists[tile.y * self.camera.width.div_ceil(TILE) + tile.x] {
            if first.z > 0.0 && first.z < *nearest {
                break;
            }
            if let Some((z, face)) = self.blocks[*block as usize].hit(self.eye, inverse)
                && (first.z == 0.0 || z < first.z)
            {
                first = Hit { z, block: *block, face: face as u8 };
            }
        }
        first
    }

    fn color(&self, hit: &Hit, pixel: DVec2) -> Vec3 {
        let direction = self.direction(pixel);
        if hit.z == 0.0 {
            return SKY[0].lerp(SKY[1], (direction.z / direction.length()).clamp(0.0, 1.0) as f32);
        }
        let block = &self.blocks[hit.block as usize];
        let axis = usize::from(hit.face / 2);
        let at = (self.eye + direction * hit.z - block.low).as_vec3();
        let uv = Vec2::new(at[(axis + 1) % 3], at[(axis + 2) % 3]);
        // A slanted face fills a pixel in one direction more than in the other: between the two, nearer to the larger.
        let slant = (direction[axis].abs() / direction.length()).max(0.02);
        let footprint = hit.z / self.camera.intrinsics.fx / slant.powf(0.7);
        block.paint.color(uv, u32::from(hit.face), footprint as f32) * LIGHT[usize::from(hit.face)]
    }
}
