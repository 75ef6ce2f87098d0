//! Chamfer distances as benchmarks of surfaces have them.

use crate::Mesh;
use crate::comparison::{distances, mean};
use std::collections::HashMap;
use weaver_kernels::random::Stream;

/// Sizes of a benchmark, in the unit of its scans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Benchmark {
    /// Distance between points that are compared.
    pub spacing: f64,
    /// Distance from which on points are no errors of a surface, but something else.
    pub far: f64,
    /// Reach of the box that is judged beyond the reference, toward smaller and toward larger coordinates.
    pub beyond: [f64; 2],
}

impl Benchmark {
    /// The sizes of DTU (Aanæs et al., 2016), millimeters.
    pub const DTU: Self = Self { spacing: 0.2, far: 20.0, beyond: [60.0, 120.0] };

    /// Points on a unit of area of a mesh, before they are thinned to the spacing.
    pub fn per_area(&self) -> f64 {
        1.0 / (self.spacing * self.spacing)
    }
}

/// Distances between two surfaces, in their unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chamfer {
    /// Mean distance of the points to the reference.
    pub accuracy: f64,
    /// Mean distance of the reference's points to them.
    pub completeness: f64,
    /// Mean of the two.
    pub chamfer: f64,
    /// Points that were compared, and points of the reference.
    pub points: [usize; 2],
}

/// The Chamfer distance of a mesh to a scan as DTU has it: points of the mesh, its vertices included, in random order
/// and [thinned](spread) to the spacing, those outside the box left out; means over the distances below
/// [`Benchmark::far`], both ways. The masks of the scanner's view are not applied: a mesh that goes on where the scan
/// has nothing is judged there, up to that distance. `None` where nothing is left to compare, as of a mesh without
/// triangles.
///
/// ```
/// use weaver_mesh::{Benchmark, Mesh, mesh_chamfer};
/// let corners = |z: f32| vec![[0.0, 0.0, z], [9.0, 0.0, z], [0.0, 9.0, z], [9.0, 9.0, z]];
/// let mesh = Mesh { vertices: corners(1.0), triangles: vec![[0, 1, 2], [1, 3, 2]] };
/// let scan = Mesh { vertices: corners(0.0), ..mesh.clone() }.sample(100.0, 1);
/// let found = mesh_chamfer(&mesh, &scan, &Benchmark::DTU, 0).unwrap();
/// assert!((found.chamfer - 1.0).abs() < 0.02);
/// ```
pub fn mesh_chamfer(mesh: &Mesh, reference: &[[f32; 3]], sizes: &Benchmark, seed: u64) -> Option<Chamfer> {
    if mesh.triangles.is_empty() {
        return None;
    }
    let mut points = mesh.vertices.clone();
    points.extend(mesh.sample(sizes.per_area(), seed));
    let edge = |i: usize| {
        let of = || reference.iter().map(|p| f64::from(p[i]));
        (of().fold(f64::INFINITY, f64::min) - sizes.beyond[0], of().fold(f64::NEG_INFINITY, f64::max) + sizes.beyond[1])
    };
    let edges = [edge(0), edge(1), edge(2)];
    points.retain(|p| p.iter().zip(edges).all(|(x, (low, high))| (low..=high).contains(&f64::from(*x))));
    let points = spread(&points, sizes.spacing, seed);
    let near = |d: Vec<f64>| mean(d.into_iter().filter(|d| *d < sizes.far));
    let accuracy = near(distances(&points, reference))?;
    let completeness = near(distances(reference, &points))?;
    Some(Chamfer {
        accuracy,
        completeness,
        chamfer: (accuracy + completeness) / 2.0,
        points: [points.len(), reference.len()],
    })
}

/// The Chamfer distance of two clouds: of each the point nearest to the middle of every cube of a side of the spacing;
/// means of the distances, each at most [`Benchmark::far`], both ways. `None` where one has no points.
///
/// ```
/// use weaver_mesh::{Benchmark, point_chamfer};
/// let plane = |z: f32| (0..100).map(|i| [i as f32 % 10.0, (i / 10) as f32, z]).collect::<Vec<_>>();
/// let found = point_chamfer(&plane(1.0), &plane(0.0), &Benchmark::DTU).unwrap();
/// assert!((found.chamfer - 1.0).abs() < 1e-6);
/// ```
pub fn point_chamfer(points: &[[f32; 3]], reference: &[[f32; 3]], sizes: &Benchmark) -> Option<Chamfer> {
    let [points, reference] = [points, reference].map(|points| middles(points, sizes.spacing));
    let bounded = |d: Vec<f64>| mean(d.into_iter().map(|d| d.min(sizes.far)));
    let accuracy = bounded(distances(&points, &reference))?;
    let completeness = bounded(distances(&reference, &points))?;
    Some(Chamfer {
        accuracy,
        completeness,
        chamfer: (accuracy + completeness) / 2.0,
        points: [points.len(), reference.len()],
    })
}

/// Points at least `spacing` apart: taken in random order, a point stays if none that stayed before is that near.
pub fn spread(points: &[[f32; 3]], spacing: f64, seed: u64) -> Vec<[f32; 3]> {
    let cube = |p: &[f32; 3]| p.map(|x| (f64::from(x) / spacing).floor() as i64);
    let apart = |a: &[f32; 3], b: &[f32; 3]| a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
    let mut kept: Vec<[f32; 3]> = Vec::new();
    let mut cubes: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    for i in Stream::new(seed, 1, "mesh").permutation(points.len()) {
        let point = &points[i];
        let [x, y, z] = cube(point);
        let mut around = (0..27_i64).filter_map(|at| cubes.get(&[x + at % 3 - 1, y + at / 3 % 3 - 1, z + at / 9 - 1]));
        if !around.any(|near| near.iter().any(|k| apart(&kept[*k as usize], point) < spacing * spacing)) {
            cubes.entry([x, y, z]).or_default().push(kept.len() as u32);
            kept.push(*point);
        }
    }
    kept
}

/// Of every cube of this side the point that is nearest to its middle, in the order of the points.
fn middles(points: &[[f32; 3]], side: f64) -> Vec<[f32; 3]> {
    let mut best: HashMap<[i64; 3], (f64, usize)> = HashMap::new();
    for (i, point) in points.iter().enumerate() {
        let cube = point.map(|x| (f64::from(x) / side).floor() as i64);
        let middle = cube.map(|c| (c as f64 + 0.5) * side);
        let off = point.iter().zip(middle).map(|(x, m)| (f64::from(*x) - m).powi(2)).sum();
        let found = best.entry(cube).or_insert((off, i));
        if off < found.0 {
            *found = (off, i);
        }
    }
    let mut kept: Vec<usize> = best.into_values().map(|(_, i)| i).collect();
    kept.sort_unstable();
    kept.into_iter().map(|i| points[i]).collect()
}
