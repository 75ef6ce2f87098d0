//! Loop closures: keyframes that return to an earlier one.

use crate::{Edge, GeometricSettings, Keyframe, LoopSettings, PatchTree, register};
use weaver_geometry::glam::DVec3;

/// The motion between the last keyframe and the nearest candidate of a loop closure, if they can be registered, with at
/// most `points` points of the scan.
pub(crate) fn closing(keyframes: &[Keyframe], settings: &LoopSettings, points: usize) -> Option<Edge> {
    let (last, before) = keyframes.split_last()?;
    let earlier = before.len().checked_sub(settings.gap).map(|end| &before[..end])?;
    let away = |keyframe: &Keyframe| keyframe.pose.translation.distance(last.pose.translation);
    let nearest = earlier.iter().enumerate().min_by(|(_, a), (_, b)| away(a).total_cmp(&away(b)));
    let (from, old) = nearest.filter(|(_, keyframe)| away(keyframe) <= settings.reach)?;
    let step = last.frame.points.len().div_ceil(points).max(1);
    let query: Vec<DVec3> = last.frame.points.iter().step_by(step).copied().collect();
    let start = old.pose.inverse().compose(&last.pose);
    let geometric = GeometricSettings { steps: 30, widened: 3.0, ..Default::default() };
    let found = register(&query, &PatchTree::new(&old.frame.points), &start, &geometric).ok()?;
    let fits = found.fitness >= settings.least_fitness;
    fits.then_some(Edge { from, to: before.len(), motion: found.pose, weight: 1.0 })
}
