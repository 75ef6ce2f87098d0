//! Connected pieces of a mesh.

use crate::Mesh;
use crate::manifold::Sets;

impl Mesh {
    /// The `most` largest connected pieces that have at least `least` triangles; pieces of equal size in the order of
    /// their first triangles.
    pub fn largest_pieces(&self, most: usize, least: usize) -> Self {
        let mut sets = Sets::new(self.vertices.len());
        for [a, b, c] in &self.triangles {
            sets.join(*a as usize, *b as usize);
            sets.join(*a as usize, *c as usize);
        }
        let mut counts = vec![0_usize; self.vertices.len()];
        let of: Vec<u32> = self.triangles.iter().map(|t| sets.root(t[0] as usize) as u32).collect();
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
