//! Charts: triangles that face alike, laid flat.

use super::raster;
use crate::Mesh;
use crate::manifold::half_edges;
use std::f64::consts::FRAC_PI_2;
use weaver_geometry::glam::{DVec2, DVec3};

/// Least cosine of the angle between a triangle and the chart that it joins, and the chart that it stays in.
const JOINS: f64 = 0.6;
const STAYS: f64 = 0.3;
/// Part of a corner from which a texel counts as within a triangle: those on edges are in two.
const WITHIN: f64 = 1e-6;
/// Rectangles around a chart that the smallest is chosen from.
const TURNS: usize = 18;
/// Texels along a chart that no photo sees, over those along one that is seen.
const UNSEEN: f64 = 0.25;
const NONE: u32 = u32::MAX;

/// Triangles that do not overlap as seen along one direction.
pub struct Chart {
    pub triangles: Vec<u32>,
    /// Directions of its plane, the longer side of its rectangle first.
    axes: [DVec3; 2],
    /// The corner of its rectangle.
    low: DVec2,
    /// Sides of its rectangle, world units times its scale.
    pub size: DVec2,
    scale: f64,
}

impl Chart {
    fn new(mesh: &Mesh, triangles: Vec<u32>, normal: DVec3, scale: f64) -> Self {
        let bounds = |axes: [DVec3; 2]| {
            let corners = triangles.iter().flat_map(|t| mesh.corners(mesh.triangles[*t as usize]));
            let points = corners.map(|p| DVec2::new(p.dot(axes[0]), p.dot(axes[1])));
            let (low, high) = points.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
            (low, high - low)
        };
        let (u, v) = normal.any_orthonormal_pair();
        let turned = |i: usize| {
            let (sin, cos) = (FRAC_PI_2 * i as f64 / TURNS as f64).sin_cos();
            [u * cos + v * sin, v * cos - u * sin]
        };
        let area = |axes: [DVec3; 2]| bounds(axes).1.element_product();
        let least = (0..TURNS).min_by(|a, b| area(turned(*a)).total_cmp(&area(turned(*b)))).unwrap_or(0);
        let mut axes = turned(least);
        let (mut low, mut size) = bounds(axes);
        if size.y > size.x {
            axes = [axes[1], -axes[0]];
            (low, size) = bounds(axes);
        }
        Self { triangles, axes, low, size: size * scale, scale }
    }

    /// The place of a point on the chart's rectangle.
    pub fn flat(&self, point: DVec3) -> DVec2 {
        (DVec2::new(point.dot(self.axes[0]), point.dot(self.axes[1])) - self.low) * self.scale
    }
}

/// The charts of a mesh: from the first triangle without a chart on, the ones beside it that face as the chart does. A
/// triangle that would lie over others, as far as texels of a picture of that size tell, waits for a further chart.
/// Triangles that a photo has `seen` are apart from others, which get less room.
pub fn charts(mesh: &Mesh, size: usize, seen: &[bool]) -> Vec<Chart> {
    let normals: Vec<DVec3> = mesh
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = mesh.corners(*t);
            (b - a).cross(c - a)
        })
        .collect();
    let beside = beside(mesh);
    let texels = size as f64 / mesh.area().sqrt().max(f64::MIN_POSITIVE);
    let mut free = vec![true; mesh.triangles.len()];
    let mut charts = Vec::new();
    // In a list of its own: refused triangles come again.
    let mut open: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
    while !open.is_empty() {
        for seed in &open {
            if !free[*seed as usize] {
                continue;
            }
            let grown = grown(*seed, &normals, &beside, seen, &mut free);
            let scale = if seen[*seed as usize] { 1.0 } else { UNSEEN };
            let normal = grown.iter().map(|t| normals[*t as usize]).sum::<DVec3>().normalize_or(DVec3::Z);
            let faces = |t: &u32| normals[*t as usize].dot(normal) >= STAYS * normals[*t as usize].length();
            let (mut kept, refused): (Vec<u32>, Vec<u32>) = grown.iter().partition(|t| faces(t));
            refused.iter().for_each(|t| free[*t as usize] = true);
            if kept.is_empty() {
                free[*seed as usize] = false;
                charts.push(Chart::new(mesh, vec![*seed], normals[*seed as usize].normalize_or(DVec3::Z), scale));
                continue;
            }
            let overlapping = overlapping(mesh, &Chart::new(mesh, kept.clone(), normal, scale), texels);
            overlapping.iter().for_each(|t| free[*t as usize] = true);
            kept.retain(|t| !free[*t as usize]);
            charts.push(Chart::new(mesh, kept, normal, scale));
        }
        open.retain(|t| free[*t as usize]);
    }
    charts
}

/// The triangle beyond each edge, three for each triangle.
fn beside(mesh: &Mesh) -> Vec<u32> {
    let mut beside = vec![NONE; 3 * mesh.triangles.len()];
    for pair in half_edges(&mesh.triangles).chunk_by(|a, b| a.0 == b.0) {
        if let [(_, one), (_, other)] = pair {
            beside[*one] = (*other / 3) as u32;
            beside[*other] = (*one / 3) as u32;
        }
    }
    beside
}

/// The free triangles around a seed that face as the mean of those before them, which are then taken.
fn grown(seed: u32, normals: &[DVec3], beside: &[u32], seen: &[bool], free: &mut [bool]) -> Vec<u32> {
    let mut grown = vec![seed];
    free[seed as usize] = false;
    let mut sum = normals[seed as usize];
    let mut next = 0;
    while let Some(t) = grown.get(next).map(|t| *t as usize) {
        next += 1;
        for other in beside[3 * t..3 * t + 3].iter().filter(|other| **other != NONE) {
            let normal = normals[*other as usize];
            let alike = sum == DVec3::ZERO || normal.dot(sum) >= JOINS * normal.length() * sum.length();
            if free[*other as usize] && alike && seen[*other as usize] == seen[seed as usize] {
                free[*other as usize] = false;
                sum += normal;
                grown.push(*other);
            }
        }
    }
    grown
}

/// The triangles of a chart that lie over earlier ones.
fn overlapping(mesh: &Mesh, chart: &Chart, texels: f64) -> Vec<u32> {
    let [width, height] = (chart.size * texels).to_array().map(|side| side.ceil() as usize + 1);
    let mut taken = vec![false; width * height];
    let mut over = Vec::new();
    for t in &chart.triangles {
        let at = mesh.corners(mesh.triangles[*t as usize]).map(|p| chart.flat(p) * texels);
        let mut own = Vec::new();
        raster::inside(at, [width, height], |x, y, parts| {
            if parts.iter().all(|part| *part > WITHIN) {
                own.push(y * width + x);
            }
        });
        if own.iter().any(|texel| taken[*texel]) {
            over.push(*t);
        } else {
            own.into_iter().for_each(|texel| taken[texel] = true);
        }
    }
    over
}
