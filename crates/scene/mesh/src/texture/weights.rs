//! Weights of the photos at the vertices of a mesh.

use super::sight::Sight;
use crate::Mesh;
use rayon::prelude::*;
use weaver_geometry::glam::DVec3;

/// The most photos of a vertex.
const MOST: usize = 3;
/// Power of a photo's quality that it is weighed with: high ones blur less.
const POWER: i32 = 4;

/// The photos of each vertex, the best first.
pub struct Weights(Vec<Vec<(u32, f32)>>);

/// The vertices beside each vertex.
pub struct Neighbors {
    starts: Vec<u32>,
    all: Vec<u32>,
}

impl Neighbors {
    /// The vertices that share an edge with one, ascending.
    pub fn of(&self, v: u32) -> &[u32] {
        &self.all[self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize]
    }
}

/// The vertices beside each vertex of a mesh.
pub fn neighbors(mesh: &Mesh) -> Neighbors {
    let directed = |t: &[u32; 3]| [0, 1, 2, 3, 4, 5].map(|i| (t[i % 3], t[(i + 1 + i / 3) % 3]));
    let mut pairs: Vec<(u32, u32)> = mesh.triangles.iter().flat_map(directed).collect();
    pairs.par_sort_unstable();
    pairs.dedup();
    let mut starts = vec![0; mesh.vertices.len() + 1];
    pairs.iter().for_each(|(v, _)| starts[*v as usize + 1] += 1);
    for v in 1..starts.len() {
        starts[v] += starts[v - 1];
    }
    Neighbors { starts, all: pairs.into_iter().map(|(_, other)| other).collect() }
}

impl Weights {
    /// Of each vertex the best photos that see its neighbors, too, or else of those that see it.
    ///
    /// So a photo fades out along the edges toward vertices that it does not see.
    pub fn new(mesh: &Mesh, normals: &[DVec3], sights: &[Sight<'_>]) -> Self {
        let point = |v: usize| DVec3::from_array(mesh.vertices[v].map(f64::from));
        let quality = |v: usize, view: usize| sights[view].quality(point(v), normals[v]);
        let count = mesh.vertices.len();
        let sees = |view: usize| (0..count).into_par_iter().map(|v| quality(v, view).is_some()).collect();
        let seen: Vec<Vec<bool>> = (0..sights.len()).map(sees).collect();
        let neighbors = neighbors(mesh);
        let list = |v: usize| {
            let own = (0..sights.len()).filter(|view| seen[*view][v]);
            let whole = |view: &usize| neighbors.of(v as u32).iter().all(|other| seen[*view][*other as usize]);
            let (inner, outer): (Vec<usize>, Vec<usize>) = own.partition(whole);
            let views = if inner.is_empty() { outer } else { inner };
            best(views.into_iter().filter_map(|view| Some((view as u32, quality(v, view)?))).collect())
        };
        Self((0..count).into_par_iter().map(list).collect())
    }

    /// The photos of a vertex with their weights, whose sum is 1; none where none sees it.
    pub fn of(&self, v: usize) -> &[(u32, f32)] {
        &self.0[v]
    }

    /// The photos of the corners of a triangle, each with its weight at every corner.
    pub fn of_triangle(&self, vertices: [usize; 3]) -> Vec<(usize, [f64; 3])> {
        let mut mixed: Vec<(usize, [f64; 3])> = Vec::new();
        for (k, v) in vertices.into_iter().enumerate() {
            for (view, weight) in self.of(v) {
                let view = *view as usize;
                let at = mixed.iter().position(|(other, _)| *other == view).unwrap_or(mixed.len());
                if at == mixed.len() {
                    mixed.push((view, [0.0; 3]));
                }
                mixed[at].1[k] = f64::from(*weight);
            }
        }
        mixed
    }
}

/// The best of some photos, by their qualities, with weights of sum 1.
fn best(mut views: Vec<(u32, f64)>) -> Vec<(u32, f32)> {
    views.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    views.truncate(MOST);
    let Some((_, top)) = views.first().copied() else { return Vec::new() };
    let sum: f64 = views.iter().map(|(_, quality)| (quality / top).powi(POWER)).sum();
    views.into_iter().map(|(view, quality)| (view, ((quality / top).powi(POWER) / sum) as f32)).collect()
}
