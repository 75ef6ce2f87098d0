//! Fewer triangles on the same surface.

mod quadric;

use crate::Mesh;
use crate::manifold::half_edges;
use quadric::Quadric;
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;
use weaver_geometry::glam::DVec3;

/// Weight of the planes that stand on the border, over the squared lengths of its edges.
const BORDER: f64 = 10.0;
/// Least cosine of the angle that a triangle turns by when a corner of it moves.
const TURN: f64 = 0.3;
/// Least double area of a triangle over the square of its longest edge, unless it had less.
const SLENDER: f64 = 0.1;
/// Collapses after which the observer is called.
const PART: usize = 1 << 14;

impl Mesh {
    /// The mesh with at most `most` triangles, and the colors of its vertices: the edge whose collapse errs least goes,
    /// again and again. More triangles stay where no collapse is left that keeps the surface's topology.
    ///
    /// The error of a vertex is the sum of squared distances from the planes of the triangles that it stands for, and
    /// from their colors, where a whole step of a color is as bad as a distance of the mean edge; planes on the border
    /// keep it. No collapse makes an edge of three triangles or joins two borders, none turns a triangle over.
    /// `colors` are `[N]` or none, and `observe` is called with the number of triangles now and then.
    /// Sources: Garland and Heckbert, "Surface simplification using quadric error metrics", 1997; Hoppe, "New quadric
    /// metric for simplifying meshes with appearance attributes", 1999.
    ///
    /// # Panics
    /// When there are colors, and not one for each vertex.
    ///
    /// ```
    /// use weaver_mesh::Mesh;
    /// // A square of 8 x 8 quadrilaterals.
    /// let vertices = (0..81).map(|i| [(i % 9) as f32, (i / 9) as f32, 0.0]).collect();
    /// let quad = |i: u32| [[i, i + 1, i + 10], [i, i + 10, i + 9]];
    /// let triangles = (0..72).filter(|i| i % 9 < 8).flat_map(quad).collect();
    /// let (mesh, _) = Mesh { vertices, triangles }.simplified(&[], 2, |_| {});
    /// assert_eq!((mesh.triangles.len(), mesh.area().round()), (2, 64.0));
    /// ```
    pub fn simplified(&self, colors: &[[u8; 3]], most: usize, mut observe: impl FnMut(usize)) -> (Self, Vec<[u8; 3]>) {
        assert!(colors.is_empty() || colors.len() == self.vertices.len(), "a color for each vertex, or none");
        let mut surface = Surface::new(self, colors);
        // A collapse that was not allowed may be later: others have changed its surroundings.
        loop {
            let before = surface.left;
            surface.collapse(most, &mut observe);
            if surface.left <= most || surface.left == before {
                return surface.finish(!colors.is_empty());
            }
        }
    }
}

/// A mesh whose edges collapse.
struct Surface {
    positions: Vec<DVec3>,
    /// Colors as lengths.
    colors: Vec<DVec3>,
    /// Length of a whole step of a color.
    step: f64,
    quadrics: Vec<Quadric>,
    /// Number of changes of a vertex.
    changes: Vec<u32>,
    kinds: Vec<Kind>,
    triangles: Vec<[u32; 3]>,
    /// Triangles around a vertex; none around one that is gone.
    around: Vec<Vec<u32>>,
    /// Triangles that are there.
    left: usize,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Inner,
    Border,
    /// On an edge that no two triangles share alike.
    Fixed,
}

/// An edge with the error of its collapse; the least is the greatest of a heap.
#[derive(PartialEq)]
struct Candidate {
    error: f64,
    edge: [u32; 2],
    changes: [u32; 2],
}

impl Eq for Candidate {}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.error.total_cmp(&other.error).then(self.edge.cmp(&other.edge)).then(self.changes.cmp(&other.changes))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Surface {
    fn new(mesh: &Mesh, colors: &[[u8; 3]]) -> Self {
        let count = mesh.vertices.len();
        let positions: Vec<DVec3> = mesh.vertices.iter().map(|v| DVec3::from_array(v.map(f64::from))).collect();
        let length = |i: usize| {
            let t = mesh.triangles[i / 3];
            positions[t[i % 3] as usize].distance(positions[t[(i + 1) % 3] as usize])
        };
        let edges = 3 * mesh.triangles.len();
        let step = (0..edges).map(length).sum::<f64>() / edges.max(1) as f64 / 255.0;
        let color = |i: usize| colors.get(i).map_or(DVec3::ZERO, |c| DVec3::from_array(c.map(f64::from)) * step);
        let colors: Vec<DVec3> = (0..count).map(color).collect();
        let mut surface = Self {
            step,
            quadrics: vec![Quadric::ZERO; count],
            changes: vec![0; count],
            kinds: vec![Kind::Inner; count],
            triangles: mesh.triangles.clone(),
            around: vec![Vec::new(); count],
            left: mesh.triangles.len(),
            positions,
            colors,
        };
        for (i, triangle) in mesh.triangles.iter().enumerate() {
            let corners = triangle.map(|v| v as usize);
            let quadric =
                Quadric::of_triangle(corners.map(|v| surface.positions[v]), corners.map(|v| surface.colors[v]));
            for v in corners {
                surface.around[v].push(i as u32);
                surface.quadrics[v] += quadric;
            }
        }
        surface.find_borders();
        surface
    }

    /// Puts planes on the border, and fixes vertices that are on no manifold.
    fn find_borders(&mut self) {
        for group in half_edges(&self.triangles).chunk_by(|a, b| a.0 == b.0) {
            let (edge, half) = group[0];
            let [a, b] = edge.map(|v| v as usize);
            let from = |half: usize| self.triangles[half / 3][half % 3];
            match group {
                [_] => {
                    let [p, q] = [a, b].map(|v| self.positions[v]);
                    let upright = (q - p).cross(self.normal(self.triangles[half / 3])).normalize_or_zero();
                    let plane = Quadric::of_plane(upright, p, BORDER * p.distance_squared(q));
                    for v in [a, b] {
                        self.quadrics[v] += plane;
                        self.kinds[v] = if self.kinds[v] == Kind::Fixed { Kind::Fixed } else { Kind::Border };
                    }
                }
                [(_, one), (_, other)] if from(*one) != from(*other) => {}
                _ => [a, b].iter().for_each(|v| self.kinds[*v] = Kind::Fixed),
            }
        }
    }

    /// The normal of a triangle, as long as its double area.
    fn normal(&self, triangle: [u32; 3]) -> DVec3 {
        let [a, b, c] = triangle.map(|v| self.positions[v as usize]);
        (b - a).cross(c - a)
    }

    /// Collapses edges by their errors until so few triangles are left, or no edge is.
    fn collapse(&mut self, most: usize, observe: &mut impl FnMut(usize)) {
        let mut heap: BinaryHeap<Reverse<Candidate>> = BinaryHeap::new();
        for v in 0..self.around.len() as u32 {
            let above = self.neighbors(v).into_iter().filter(|other| *other > v);
            heap.extend(above.filter_map(|other| self.candidate(v, other)).map(Reverse));
        }
        let mut done = 0;
        while self.left > most {
            let Some(Reverse(Candidate { edge: [a, b], changes, .. })) = heap.pop() else { return };
            if [a, b].map(|v| self.changes[v as usize]) != changes || !self.is_sound(a, b) {
                continue;
            }
            let at = self.target(a, b);
            if [(a, b), (b, a)].iter().any(|(v, other)| self.spoils(*v, *other, at)) {
                continue;
            }
            self.join(a, b, at);
            heap.extend(self.neighbors(a).into_iter().filter_map(|other| self.candidate(a, other)).map(Reverse));
            done += 1;
            if done % PART == 0 {
                observe(self.left);
            }
        }
    }

    /// The vertices around a vertex, ascending.
    fn neighbors(&self, v: u32) -> Vec<u32> {
        let corners = self.around[v as usize].iter().flat_map(|t| self.triangles[*t as usize]);
        let mut others: Vec<u32> = corners.filter(|other| *other != v).collect();
        others.sort_unstable();
        others.dedup();
        others
    }

    /// The edge of two vertices; none where one is fixed.
    fn candidate(&self, a: u32, b: u32) -> Option<Candidate> {
        let edge = [a.min(b), a.max(b)];
        let [first, second] = edge.map(|v| v as usize);
        if [first, second].iter().any(|v| self.kinds[*v] == Kind::Fixed) {
            return None;
        }
        let mut quadric = self.quadrics[first];
        quadric += self.quadrics[second];
        let length = self.positions[first].distance(self.positions[second]);
        let error = quadric.error(self.target(edge[0], edge[1]), length);
        Some(Candidate { error, edge, changes: [self.changes[first], self.changes[second]] })
    }

    /// Where the vertex of a collapsed edge goes: the best place, or the border's vertex where only one is on it.
    fn target(&self, a: u32, b: u32) -> DVec3 {
        let [p, q] = [a, b].map(|v| self.positions[v as usize]);
        match [a, b].map(|v| self.kinds[v as usize]) {
            [Kind::Border, Kind::Inner] => p,
            [Kind::Inner, Kind::Border] => q,
            _ => {
                let mut quadric = self.quadrics[a as usize];
                quadric += self.quadrics[b as usize];
                quadric.best([p, q])
            }
        }
    }

    /// True if the surface stays a manifold of the same topology: the edge is a border where both ends are, its ends
    /// have no neighbors in common but the corners opposite to it, and these have triangles left.
    fn is_sound(&self, a: u32, b: u32) -> bool {
        let shared = self.around[a as usize].iter().filter(|t| self.triangles[**t as usize].contains(&b)).count();
        let both = [a, b].iter().all(|v| self.kinds[*v as usize] == Kind::Border);
        let others = self.neighbors(b);
        let common: Vec<u32> = self.neighbors(a).into_iter().filter(|v| others.binary_search(v).is_ok()).collect();
        let least = |v: u32| if self.kinds[v as usize] == Kind::Inner { 3 } else { 1 };
        let stays = |v: &u32| self.around[*v as usize].len() > least(*v);
        (shared == 1) == both && common.len() == shared && common.iter().all(stays)
    }

    /// True if a triangle around a vertex, the edge to the other one apart, would turn over or become a sliver.
    fn spoils(&self, v: u32, other: u32, to: DVec3) -> bool {
        let shape = |[a, b, c]: [DVec3; 3]| {
            let normal = (b - a).cross(c - a);
            let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
            (normal, normal.length() / longest)
        };
        let spoiled = |t: &&u32| {
            let triangle = self.triangles[**t as usize];
            let now = triangle.map(|i| self.positions[i as usize]);
            let then = std::array::from_fn(|k| if triangle[k] == v { to } else { now[k] });
            let ((before, had), (after, has)) = (shape(now), shape(then));
            let turned = after.dot(before) <= TURN * after.length() * before.length() && before != DVec3::ZERO;
            let slender = has.is_nan() || has <= SLENDER.min(0.5 * had);
            !triangle.contains(&other) && (turned || slender)
        };
        self.around[v as usize].iter().find(spoiled).is_some()
    }

    /// Makes two vertices one, which keeps the number of the first.
    fn join(&mut self, a: u32, b: u32, at: DVec3) {
        let [first, second] = [a, b].map(|v| v as usize);
        for t in std::mem::take(&mut self.around[second]) {
            let triangle = self.triangles[t as usize];
            if triangle.contains(&a) {
                let others = triangle.into_iter().filter(|v| *v != b);
                others.for_each(|v| self.around[v as usize].retain(|other| *other != t));
                self.left -= 1;
            } else {
                self.triangles[t as usize] = triangle.map(|v| if v == b { a } else { v });
                self.around[first].push(t);
            }
        }
        if self.kinds[second] == Kind::Border {
            self.kinds[first] = Kind::Border;
        }
        let added = self.quadrics[second];
        self.quadrics[first] += added;
        self.positions[first] = at;
        self.colors[first] = self.quadrics[first].color(at);
        self.changes[first] += 1;
        self.changes[second] += 1;
    }

    /// The remaining mesh, in the order of before.
    fn finish(self, colored: bool) -> (Mesh, Vec<[u8; 3]>) {
        let mut kept = vec![false; self.triangles.len()];
        self.around.iter().flatten().for_each(|t| kept[*t as usize] = true);
        let (mut mesh, mut colors, mut places) = (Mesh::default(), Vec::new(), vec![u32::MAX; self.around.len()]);
        for v in (0..self.around.len()).filter(|v| !self.around[*v].is_empty()) {
            places[v] = mesh.vertices.len() as u32;
            mesh.vertices.push(self.positions[v].as_vec3().to_array());
            let byte = |x: f64| (x / self.step).round().clamp(0.0, 255.0) as u8;
            colors.extend(colored.then(|| self.colors[v].to_array().map(byte)));
        }
        let left = self.triangles.iter().zip(kept).filter(|(_, kept)| *kept);
        mesh.triangles = left.map(|(t, _)| t.map(|v| places[v as usize])).collect();
        (mesh, colors)
    }
}
