//! Pictures on meshes, painted from photos.

mod charts;
mod exposure;
mod fill;
mod packing;
mod raster;
mod sampling;
mod sight;
mod weights;

use crate::field::SIDES;
use crate::{Mesh, MeshError};
use charts::Chart;
use exposure::gains;
use rayon::prelude::*;
use sight::Sight;
use weaver_geometry::Camera;
use weaver_geometry::glam::{DVec2, DVec3};
use weights::Weights;

/// Texels around a chart that belong to no other.
const GUTTER: usize = 2;
/// Color where nothing was seen, nor beside it.
const UNSEEN: DVec3 = DVec3::splat(128.0);
/// Parts in which triangles are painted.
const PARTS: usize = 32;

/// A photo and its camera, which has no distortion.
#[derive(Clone, Copy, Debug)]
pub struct PhotoView<'a> {
    /// Pose, intrinsics and size.
    pub camera: Camera,
    /// Pixels `[H, W, 3]`, sRGB.
    pub rgb: &'a [u8],
    /// True where a pixel counts `[H, W]`; none if all do.
    pub mask: Option<&'a [bool]>,
}

/// A picture for a mesh: charts of triangles side by side.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Texture {
    /// Places on the picture from its upper left corner, in its sides, `[K, 2]`.
    pub coordinates: Vec<[f32; 2]>,
    /// The vertex of each place, `[K]`: one on a border of charts has several places.
    pub vertices: Vec<u32>,
    /// The places of the corners of each triangle, `[M]`.
    pub corners: Vec<[u32; 3]>,
    /// Texels of a side.
    pub size: usize,
    /// Texels `[size, size, 3]`, sRGB.
    pub pixels: Vec<u8>,
    /// Share of the area of triangles that a photo sees, of those that have a texel.
    pub seen: f64,
}

impl Texture {
    /// Paints a mesh from photos, on a picture of `size` x `size` texels.
    ///
    /// Triangles that face alike become charts, which are laid flat along their mean normals. A vertex has the three
    /// best of the photos in which it and its neighbors are seen, weighed with (f^2 cos a / z^2)^4 for the focal length
    /// f, the angle a to its normal and the depth z. A texel mixes the weights at the corners of its triangle, so that
    /// photos go over into one another without a step. Before, photos are multiplied by gains that bring their colors
    /// together where several see the same. Parts that no photo sees take the colors beside them, and so does the space
    /// between charts. `observe` is called with the parts that are done, and their number.
    /// Source: after Waechter et al., "Let there be color!", 2014, with a gain for each photo and mixed weights in
    /// place of patches of one photo whose borders are leveled.
    ///
    /// # Errors
    /// [`MeshError`] where a photo does not have its camera's size, or the charts do not fit.
    pub fn paint(
        mesh: &Mesh,
        photos: &[PhotoView<'_>],
        size: usize,
        mut observe: impl FnMut(usize, usize),
    ) -> Result<Self, MeshError> {
        if !SIDES.contains(&size) {
            return Err(MeshError::Side { found: size });
        }
        for (view, photo) in photos.iter().enumerate() {
            let expected = photo.camera.width * photo.camera.height;
            let masked = photo.mask.map_or(expected, <[bool]>::len);
            if photo.rgb.len() != 3 * expected || masked != expected {
                return Err(MeshError::Photo { view, expected, pixels: photo.rgb.len() / 3, masked });
            }
        }
        let of = photos.len() + PARTS;
        let mut sights = Vec::new();
        for (i, photo) in photos.iter().enumerate() {
            sights.push(Sight::new(mesh, photo));
            observe(i + 1, of);
        }
        let normals = mesh.vertex_normals();
        let weights = Weights::new(mesh, &normals, &sights);
        let seen = |t: &[u32; 3]| t.iter().any(|v| !weights.of(*v as usize).is_empty());
        let seen: Vec<bool> = mesh.triangles.iter().map(seen).collect();
        let charts = charts::charts(mesh, size, &seen);
        let painter = Painter { mesh, normals, gains: gains(mesh, &weights, &sights), weights, sights };
        let (texels, places) =
            packing::placed(&charts, size).ok_or(MeshError::Charts { size, charts: charts.len() })?;
        let mut texture = Self { size, corners: vec![[0; 3]; mesh.triangles.len()], ..Self::default() };
        // Which chart a triangle is in, and where that is.
        for (chart, place) in charts.iter().zip(&places) {
            texture.lay(mesh, chart, texels, *place);
        }
        painter.paint(&mut texture, |part| observe(photos.len() + part, of));
        Ok(texture)
    }

    /// Adds the places of a chart whose upper left corner lies at a texel.
    fn lay(&mut self, mesh: &Mesh, chart: &Chart, texels: f64, place: [usize; 2]) {
        let corner = DVec2::new(place[0] as f64, place[1] as f64) + GUTTER as f64;
        let mut known = std::collections::HashMap::new();
        for t in &chart.triangles {
            self.corners[*t as usize] = mesh.triangles[*t as usize].map(|v| {
                *known.entry(v).or_insert_with(|| {
                    let flat = chart.flat(DVec3::from_array(mesh.vertices[v as usize].map(f64::from)));
                    let at = (flat * texels + corner) / self.size as f64;
                    self.coordinates.push(at.as_vec2().to_array());
                    self.vertices.push(v);
                    self.coordinates.len() as u32 - 1
                })
            });
        }
    }
}

impl Mesh {
    /// Normals of vertices: means over their triangles by area.
    fn vertex_normals(&self) -> Vec<DVec3> {
        let mut normals = vec![DVec3::ZERO; self.vertices.len()];
        for triangle in &self.triangles {
            let [a, b, c] = self.corners(*triangle);
            triangle.iter().for_each(|v| normals[*v as usize] += (b - a).cross(c - a));
        }
        normals.into_iter().map(DVec3::normalize_or_zero).collect()
    }
}

/// Everything that colors come from.
struct Painter<'a> {
    mesh: &'a Mesh,
    normals: Vec<DVec3>,
    sights: Vec<Sight<'a>>,
    weights: Weights,
    gains: Vec<DVec3>,
}

/// A texel, its color, and whether a photo has it.
type Texel = (usize, [u8; 3], bool);

impl Painter<'_> {
    fn paint(&self, texture: &mut Texture, mut observe: impl FnMut(usize)) {
        let size = texture.size;
        let unseen = self.unseen_colors();
        let mut texels = vec![[0_u8; 4]; size * size];
        let (mut seen, mut all) = (0.0, 0.0);
        let triangles: Vec<usize> = (0..self.mesh.triangles.len()).collect();
        for (i, part) in triangles.chunks(triangles.len().div_ceil(PARTS).max(1)).enumerate() {
            let painted: Vec<Vec<Texel>> = part.par_iter().map(|t| self.triangle(*t, texture, &unseen)).collect();
            for (t, own) in part.iter().zip(painted).filter(|(_, own)| !own.is_empty()) {
                let [a, b, c] = self.mesh.corners(self.mesh.triangles[*t]);
                let area = (b - a).cross(c - a).length();
                all += area;
                seen += area * own.iter().filter(|texel| texel.2).count() as f64 / own.len() as f64;
                own.into_iter().for_each(|(at, [r, g, b], _)| texels[at] = [r, g, b, 255]);
            }
            observe(i + 1);
        }
        fill::fill(&mut texels, size);
        texture.pixels = texels.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]).collect();
        texture.seen = seen / f64::max(all, f64::MIN_POSITIVE);
        observe(PARTS);
    }

    /// The texels of a triangle.
    fn triangle(&self, t: usize, texture: &Texture, unseen: &[DVec3]) -> Vec<Texel> {
        let size = texture.size;
        let triangle = self.mesh.triangles[t];
        let vertices = triangle.map(|v| v as usize);
        let corners = self.mesh.corners(triangle);
        let normals = vertices.map(|v| self.normals[v]);
        let at = texture.corners[t].map(|k| {
            let [x, y] = texture.coordinates[k as usize];
            DVec2::new(f64::from(x), f64::from(y)) * size as f64
        });
        // World units along a texel's sides.
        let Some(spans) = raster::spans(at, corners) else { return Vec::new() };
        let mixed = self.weights.of_triangle(vertices);
        let mut texels = Vec::new();
        raster::inside(at, [size; 2], |x, y, parts| {
            let mix = |of: [DVec3; 3]| of[0] * parts[0] + of[1] * parts[1] + of[2] * parts[2];
            let (point, normal) = (mix(corners), mix(normals));
            let (mut sum, mut all) = (DVec3::ZERO, 0.0);
            for (view, weights) in &mixed {
                let weight: f64 = (0..3).map(|k| weights[k] * parts[k]).sum();
                let sight = &self.sights[*view];
                if weight > 0.0 && sight.quality(point, normal).is_some() {
                    sum += weight * self.gains[*view] * sight.color(point, spans);
                    all += weight;
                }
            }
            let color = if all > 0.0 { sum / all } else { mix(vertices.map(|v| unseen[v])) };
            texels.push((y * size + x, color.to_array().map(|c| c.round().clamp(0.0, 255.0) as u8), all > 0.0));
        });
        texels
    }

    /// Colors of vertices; one that no photo sees has the mean of its neighbors.
    fn unseen_colors(&self) -> Vec<DVec3> {
        let own = |v: usize| {
            let point = DVec3::from_array(self.mesh.vertices[v].map(f64::from));
            let list = self.weights.of(v);
            let color = |(view, weight): &(u32, f32)| {
                f64::from(*weight) * self.gains[*view as usize] * self.sights[*view as usize].mean(point)
            };
            (!list.is_empty()).then(|| list.iter().map(color).sum())
        };
        let mut colors: Vec<Option<DVec3>> = (0..self.mesh.vertices.len()).into_par_iter().map(own).collect();
        let neighbors = weights::neighbors(self.mesh);
        let mut open: Vec<u32> = (0..colors.len() as u32).filter(|v| colors[*v as usize].is_none()).collect();
        // Ring by ring, from known colors.
        loop {
            let known = |v: u32| {
                let around: Vec<DVec3> = neighbors.of(v).iter().filter_map(|n| colors[*n as usize]).collect();
                (!around.is_empty()).then(|| around.iter().sum::<DVec3>() / around.len() as f64)
            };
            let ring: Vec<Option<DVec3>> = open.par_iter().map(|v| known(*v)).collect();
            let before = open.len();
            for (v, color) in open.iter().zip(&ring) {
                colors[*v as usize] = *color;
            }
            open.retain(|v| colors[*v as usize].is_none());
            if open.len() == before {
                return colors.into_iter().map(|color| color.unwrap_or(UNSEEN)).collect();
            }
        }
    }
}
