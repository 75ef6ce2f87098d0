//! Points that photos see.

use std::collections::BTreeSet;
use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;

/// Points on the surfaces of a scene, with the photos that see them, as from structure from motion.
///
/// Positions are in the world and in the units of the cameras that go with them. The pixel of a point in a photo
/// follows from its camera.
///
/// ```
/// use weaver_data::SparsePoints;
/// use weaver_geometry::glam::DVec3;
///
/// let positions = vec![DVec3::Z, 3.0 * DVec3::Z, 9.0 * DVec3::Z];
/// let points = SparsePoints { positions, visible: vec![vec![0, 1], vec![1]] };
/// // The second point counts once, the third not at all.
/// assert_eq!(points.mean_distance(DVec3::ZERO), Some(2.0));
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SparsePoints {
    /// Positions.
    pub positions: Vec<DVec3>,
    /// For each photo, the indices of the points that it sees.
    pub visible: Vec<Vec<u32>>,
}

impl SparsePoints {
    /// Mean distance from a place to the points that at least one photo sees, each counted once; `None` where none sees
    /// any.
    pub fn mean_distance(&self, from: DVec3) -> Option<f64> {
        mean_distance(&self.positions, &self.visible, from)
    }

    /// The points that some photos see, in the frame of a camera, lengths times `scale`.
    pub(crate) fn seen_from(reference: &Pose, scale: f64, points: &[DVec3], visible: &[&[u32]]) -> Self {
        let seen: Vec<u32> = seen(visible).into_iter().collect();
        let renumbered = |p: &u32| seen.partition_point(|q| q < p) as u32;
        Self {
            positions: seen.iter().map(|&p| reference.apply(points[p as usize]) * scale).collect(),
            visible: visible.iter().map(|view| view.iter().map(renumbered).collect()).collect(),
        }
    }
}

/// Indices that occur in any of the lists, ascending.
fn seen<V: AsRef<[u32]>>(visible: &[V]) -> BTreeSet<u32> {
    visible.iter().flat_map(|view| view.as_ref().iter().copied()).collect()
}

/// [`SparsePoints::mean_distance`].
pub(crate) fn mean_distance<V: AsRef<[u32]>>(points: &[DVec3], visible: &[V], from: DVec3) -> Option<f64> {
    let seen = seen(visible);
    let sum: f64 = seen.iter().map(|&p| points[p as usize].distance(from)).sum();
    (!seen.is_empty()).then(|| sum / seen.len() as f64)
}
