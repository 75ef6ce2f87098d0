//! Meshes in which every edge has at most two triangles.

use crate::Mesh;
use std::f64::consts::TAU;
use weaver_geometry::glam::DVec3;

/// An edge, its lesser vertex first, and the half of it in a triangle: three times the triangle, plus the corner where
/// it begins.
pub(crate) type HalfEdge = ([u32; 2], usize);

/// All halves of edges, the ones of an edge side by side.
pub(crate) fn half_edges(triangles: &[[u32; 3]]) -> Vec<HalfEdge> {
    let half = |i: usize| {
        let (from, to) = ends(triangles, i);
        ([from.min(to), from.max(to)], i)
    };
    let mut halves: Vec<HalfEdge> = (0..3 * triangles.len()).map(half).collect();
    halves.sort_unstable();
    halves
}

/// The vertices where a half of an edge begins and ends.
fn ends(triangles: &[[u32; 3]], half: usize) -> (u32, u32) {
    let triangle = triangles[half / 3];
    (triangle[half % 3], triangle[(half + 1) % 3])
}

impl Mesh {
    /// The same surface as a 2-manifold: every edge has at most two triangles, which turn alike, and the triangles
    /// around a vertex are one fan. Where parts of the surface touch in an edge or a vertex, each gets its own.
    ///
    /// An edge of several pairs of triangles becomes as many, each with a vertex of its own in the middle; a pair is
    /// two triangles with the solid between them. Then a vertex becomes one for each fan. Both as in Guéziec et al.,
    /// "Cutting and stitching", 2001. Triangles with two equal corners go.
    ///
    /// ```
    /// use weaver_mesh::Mesh;
    /// // Two triangles that touch in a vertex.
    /// let vertices = vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [-1.0, -1.0, 0.0]];
    /// let mesh = Mesh { vertices, triangles: vec![[0, 1, 2], [0, 3, 4]] };
    /// assert_eq!(mesh.manifold().vertices.len(), 6);
    /// ```
    #[must_use]
    pub fn manifold(&self) -> Self {
        let proper = |t: &&[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
        let triangles = self.triangles.iter().filter(proper).copied().collect();
        let mut mesh = Self { vertices: self.vertices.clone(), triangles };
        mesh.split_edges();
        mesh.split_vertices();
        mesh
    }

    /// Cuts edges with more than two triangles in their middles.
    fn split_edges(&mut self) {
        let halves = half_edges(&self.triangles);
        let crowded = halves.chunk_by(|a, b| a.0 == b.0).filter(|group| group.len() > 2);
        // The vertex in the middle of each half that is cut.
        let mut middles: Vec<(usize, u32)> = Vec::new();
        let mut added = Vec::new();
        for group in crowded {
            let [a, b] = group[0].0.map(|i| self.vertices[i as usize]);
            let middle: [f32; 3] = std::array::from_fn(|k| 0.5 * (a[k] + b[k]));
            for pair in self.pairs(group) {
                let vertex = (self.vertices.len() + added.len()) as u32;
                added.push(middle);
                middles.extend(pair.into_iter().map(|half| (half, vertex)));
            }
        }
        self.vertices.extend(added);
        middles.sort_unstable();
        for cut in middles.chunk_by(|a, b| a.0 / 3 == b.0 / 3) {
            let index = cut[0].0 / 3;
            let triangle = self.triangles[index];
            let mut around = Vec::new();
            for (k, corner) in triangle.into_iter().enumerate() {
                around.push(corner);
                around.extend(cut.iter().filter(|(half, _)| half % 3 == k).map(|(_, vertex)| *vertex));
            }
            let [a, b, c] = self.corners(triangle);
            let center = self.vertices.len() as u32;
            self.vertices.push(((a + b + c) / 3.0).as_vec3().to_array());
            let fan = (0..around.len()).map(|i| [center, around[i], around[(i + 1) % around.len()]]);
            let mut fan: Vec<[u32; 3]> = fan.collect();
            self.triangles[index] = fan.swap_remove(0);
            self.triangles.extend(fan);
        }
    }

    /// The halves of a crowded edge, two and two of those that bound one wedge of the solid; single ones where halves
    /// of one direction are more.
    fn pairs(&self, group: &[HalfEdge]) -> Vec<Vec<usize>> {
        let [from, to] = group[0].0.map(|i| DVec3::from_array(self.vertices[i as usize].map(f64::from)));
        let along = (to - from).normalize_or_zero();
        let (u, v) = along.any_orthonormal_pair();
        let mut around: Vec<(f64, bool, usize)> = group
            .iter()
            .map(|(edge, half)| {
                let opposite = self.vertices[self.triangles[half / 3][(half + 2) % 3] as usize];
                let r = DVec3::from_array(opposite.map(f64::from)) - from;
                (r.dot(v).atan2(r.dot(u)).rem_euclid(TAU), ends(&self.triangles, *half).0 == edge[0], *half)
            })
            .collect();
        around.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
        // Seen along the edge, the solid lies clockwise of a triangle that runs along it.
        let mut pairs = Vec::new();
        while let Some(i) =
            (0..around.len()).find(|i| around[*i].1 && !around[i.checked_sub(1).unwrap_or(around.len() - 1)].1)
        {
            let before = i.checked_sub(1).unwrap_or(around.len() - 1);
            pairs.push(vec![around[i].2, around[before].2]);
            around.remove(i.max(before));
            around.remove(i.min(before));
        }
        pairs.extend(around.into_iter().map(|(_, _, half)| vec![half]));
        pairs
    }

    /// Gives each fan of triangles around a vertex its own.
    fn split_vertices(&mut self) {
        let halves = half_edges(&self.triangles);
        // Corners that are joined by an edge of two triangles share a vertex.
        let mut corners = Sets::new(3 * self.triangles.len());
        for pair in halves.chunk_by(|a, b| a.0 == b.0) {
            let [(_, first), (_, second)] = pair else { continue };
            let next = |half: usize| half / 3 * 3 + (half + 1) % 3;
            if ends(&self.triangles, *first).0 == ends(&self.triangles, *second).1 {
                corners.join(*first, next(*second));
                corners.join(next(*first), *second);
            }
        }
        let mut vertices = Vec::new();
        let mut places = vec![u32::MAX; 3 * self.triangles.len()];
        for corner in 0..places.len() {
            let set = corners.root(corner);
            let vertex = &mut self.triangles[corner / 3][corner % 3];
            if places[set] == u32::MAX {
                places[set] = vertices.len() as u32;
                vertices.push(self.vertices[*vertex as usize]);
            }
            *vertex = places[set];
        }
        self.vertices = vertices;
    }
}

/// Disjoint sets of numbers; the least number of a set stands for it.
pub(crate) struct Sets(Vec<u32>);

impl Sets {
    pub fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    pub fn root(&mut self, of: usize) -> usize {
        let mut at = of as u32;
        while self.0[at as usize] != at {
            let above = self.0[self.0[at as usize] as usize];
            self.0[at as usize] = above;
            at = above;
        }
        at as usize
    }

    pub fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b)] = a.min(b) as u32;
    }
}
