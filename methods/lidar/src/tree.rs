//! Trees of small planar patches.

use crate::eigen::principal;
use weaver_geometry::glam::DVec3;

/// Upper bound on the largest extent of leaves, meters.
const LEAF: f64 = 0.2;
/// Thickness below which a layer of points is a surface, whose normal its parts inherit, meters.
const SURFACE: f64 = 0.1;

/// A patch of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// The point nearest to the mean.
    pub point: DVec3,
    /// The normal.
    pub normal: DVec3,
    /// Extent along the normal of the points behind the normal, meters.
    pub thickness: f64,
}

#[derive(Clone, Debug)]
enum Node {
    Leaf(Patch),
    Split { mean: DVec3, axis: DVec3, behind: u32 },
}

/// Points cut at their mean across the axis of largest spread, again and again, until a part is smaller than 0.2 m.
#[derive(Clone, Debug, Default)]
pub struct PatchTree {
    /// Parents before children; the first child follows its parent, the second is at `behind`.
    nodes: Vec<Node>,
    leaves: usize,
}

impl PatchTree {
    /// The tree of points.
    pub fn new(points: &[DVec3]) -> Self {
        let mut tree = Self::default();
        if !points.is_empty() {
            tree.grow(&mut points.to_vec(), None, 0);
        }
        tree
    }

    /// Number of patches.
    pub fn leaves(&self) -> usize {
        self.leaves
    }

    fn grow(&mut self, points: &mut [DVec3], surface: Option<(DVec3, f64)>, depth: usize) {
        let (mean, _, [normal, _, axis]) = principal(points.iter().copied());
        let extent = |axis: DVec3| {
            let along = points.iter().map(|p| (*p - mean).dot(axis));
            let (low, high) = along.fold((0.0_f64, 0.0_f64), |(low, high), x| (low.min(x), high.max(x)));
            high - low
        };
        let (own, largest) = ((normal, extent(normal)), extent(axis));
        // Few points are always thin.
        let surface = surface.or_else(|| (points.len() >= 3 && own.1 < SURFACE).then_some(own));
        let split = partition(points, |p| (*p - mean).dot(axis) < 0.0);
        if largest < LEAF || split == 0 || split == points.len() || depth > 64 {
            let nearest = |a: &&DVec3, b: &&DVec3| a.distance_squared(mean).total_cmp(&b.distance_squared(mean));
            let point = points.iter().min_by(nearest).copied().unwrap_or(mean);
            let (normal, thickness) = surface.unwrap_or(own);
            self.nodes.push(Node::Leaf(Patch { point, normal, thickness }));
            self.leaves += 1;
            return;
        }
        let at = self.nodes.len();
        self.nodes.push(Node::Split { mean, axis, behind: 0 });
        let (before, after) = points.split_at_mut(split);
        self.grow(before, surface, depth + 1);
        let second = self.nodes.len() as u32;
        if let Node::Split { behind, .. } = &mut self.nodes[at] {
            *behind = second;
        }
        self.grow(after, surface, depth + 1);
    }

    /// The patch of the cell that holds a point; `None` in a tree without points.
    pub fn patch(&self, p: DVec3) -> Option<&Patch> {
        let mut at = 0;
        loop {
            match self.nodes.get(at)? {
                Node::Leaf(patch) => return Some(patch),
                Node::Split { mean, axis, behind } => {
                    at = if (p - *mean).dot(*axis) < 0.0 { at + 1 } else { *behind as usize };
                }
            }
        }
    }

    /// All patches.
    pub fn patches(&self) -> impl Iterator<Item = &Patch> {
        self.nodes.iter().filter_map(|node| match node {
            Node::Leaf(patch) => Some(patch),
            Node::Split { .. } => None,
        })
    }
}

/// Moves the points that satisfy `first` to the front; returns their number. The order is the same for the same points.
fn partition(points: &mut [DVec3], first: impl Fn(&DVec3) -> bool) -> usize {
    let mut count = 0;
    for i in 0..points.len() {
        if first(&points[i]) {
            points.swap(i, count);
            count += 1;
        }
    }
    count
}
