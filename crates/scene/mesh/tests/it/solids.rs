//! Drawn surfaces, and properties of closed ones.

use std::collections::{BTreeMap, HashMap};
use weaver_geometry::glam::DVec3;
use weaver_mesh::Mesh;

/// A cube of side 2 around the origin, `cells` x `cells` squares a side, each vertex moved by a function.
pub fn cube(cells: i32, moved: impl Fn(DVec3) -> DVec3) -> Mesh {
    let (mut mesh, mut places) = (Mesh::default(), HashMap::new());
    for (axis, side) in (0..3).flat_map(|axis| [(axis, -1), (axis, 1)]) {
        for i in 0..cells * cells {
            let mut corner = |du: i32, dv: i32| {
                let mut at = [0; 3];
                at[axis] = side * cells;
                at[(axis + 1) % 3] = 2 * (i % cells + du) - cells;
                at[(axis + 2) % 3] = 2 * (i / cells + dv) - cells;
                *places.entry(at).or_insert_with(|| {
                    let point = DVec3::from_array(at.map(f64::from)) / f64::from(cells);
                    mesh.vertices.push(moved(point).as_vec3().to_array());
                    mesh.vertices.len() as u32 - 1
                })
            };
            let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
            let both = if side > 0 { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] };
            mesh.triangles.extend(both);
        }
    }
    mesh
}

pub fn ball(cells: i32) -> Mesh {
    cube(cells, |p| p.normalize())
}

/// Edges that do not have two triangles, one in each direction.
pub fn open_edges(mesh: &Mesh) -> usize {
    let mut edges: BTreeMap<(u32, u32), [usize; 2]> = BTreeMap::new();
    for [a, b, c] in &mesh.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            edges.entry((*from.min(to), *from.max(to))).or_default()[usize::from(from > to)] += 1;
        }
    }
    edges.values().filter(|directions| **directions != [1, 1]).count()
}

/// Vertices whose triangles are not one fan.
pub fn pinched(mesh: &Mesh) -> usize {
    let mut links: BTreeMap<u32, Vec<(u32, u32)>> = BTreeMap::new();
    for [a, b, c] in &mesh.triangles {
        for (at, from, to) in [(a, b, c), (b, c, a), (c, a, b)] {
            links.entry(*at).or_default().push((*from, *to));
        }
    }
    let is_fan = |link: &Vec<(u32, u32)>| {
        let starts: Vec<u32> = link.iter().map(|l| l.0).filter(|v| link.iter().all(|l| l.1 != *v)).collect();
        let mut at = starts.first().copied().unwrap_or(link[0].0);
        let mut seen = 0;
        while let Some((_, to)) = link.iter().find(|l| l.0 == at).filter(|_| seen < link.len()) {
            (at, seen) = (*to, seen + 1);
        }
        starts.len() < 2 && seen == link.len()
    };
    links.values().filter(|link| !is_fan(link)).count()
}

/// The volume within a closed surface.
pub fn volume(mesh: &Mesh) -> f64 {
    let part = |t: &[u32; 3]| {
        let [a, b, c] = mesh.corners(*t);
        a.dot(b.cross(c)) / 6.0
    };
    mesh.triangles.iter().map(part).sum()
}
