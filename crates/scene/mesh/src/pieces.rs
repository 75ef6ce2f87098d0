//! Connected pieces of a mesh.

use crate::Mesh;

impl Mesh {
    /// The `most` largest connected pieces that have at least `least` triangles; pieces of equal size in the order of
    /// their first triangles.
    pub fn largest_pieces(&self, most: usize, least: usize) -> Self {
        let mut parents: Vec<u32> = (0..self.vertices.len() as u32).collect();
        for [a, b, c] in &self.triangles {
            for other in [b, c] {
                let (a, b) = (root(&mut parents, *a), root(&mut parents, *other));
                // The lesser index stands for the piece.
                parents[a.max(b) as usize] = a.min(b);
            }
        }
        let mut counts = vec![0_usize; self.vertices.len()];
        let of: Vec<u32> = self.triangles.iter().map(|t| root(&mut parents, t[0])).collect();
        of.iter().for_each(|piece| counts[*piece as usize] += 1);
        let mut pieces: Vec<u32> = (0..counts.len() as u32).filter(|i| counts[*i as usize] >= least.max(1)).collect();
        pieces.sort_by_key(|i| std::cmp::Reverse(counts[*i as usize]));
        pieces.truncate(most);
        let mut kept = vec![false; counts.len()];
        pieces.iter().for_each(|piece| kept[*piece as usize] = true);
        let mut mesh = Self::default();
        let mut places = vec![u32::MAX; self.vertices.len()];
        for (triangle, _) in self.triangles.iter().zip(&of).filter(|(_, piece)| kept[**piece as usize]) {
            mesh.triangles.push(triangle.map(|i| {
                let place = &mut places[i as usize];
                if *place == u32::MAX {
                    *place = mesh.vertices.len() as u32;
                    mesh.vertices.push(self.vertices[i as usize]);
                }
                *place
            }));
        }
        mesh
    }
}

/// The vertex that stands for the piece of a vertex.
fn root(parents: &mut [u32], mut vertex: u32) -> u32 {
    while parents[vertex as usize] != vertex {
        let above = parents[parents[vertex as usize] as usize];
        parents[vertex as usize] = above;
        vertex = above;
    }
    vertex
}
