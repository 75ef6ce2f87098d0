//! Some of the observations, by which many cameras are adjusted.

use super::{Bundle, Observation};
use std::borrow::Cow;

/// Cameras up to which all observations take part in every adjustment.
pub(crate) const LARGE: usize = 64;
/// Observations that determine a camera nearly as well as all of its own.
const ENOUGH: u32 = 400;
/// Observations of a point that take part, at most: the work of a point grows with the square of their number.
const OF_POINT: usize = 12;
/// Observations of a point from which on a wrong one stands out.
const SEVERAL: usize = 3;
/// The numbers of points times this factor are in an order without a pattern.
const SCATTER: u32 = 2_654_435_761;

impl Bundle {
    /// True if there are many cameras, and many more observations than they need.
    pub(crate) fn has_plenty(&self) -> bool {
        self.some().is_some()
    }

    /// Many cameras with some of the observations, adjusted to them; few as they are.
    pub(crate) fn by_some(&self, scale: f64, most_steps: usize) -> Cow<'_, Self> {
        let Some(observations) = self.some() else { return Cow::Borrowed(self) };
        let mut bundle = Self { observations, ..self.clone() };
        bundle.adjust(scale, most_steps);
        Cow::Owned(bundle)
    }

    /// Observations that determine many cameras, enough for each; `None` where there are few cameras, or most
    /// observations would be needed: because there are few, or because few points have them all.
    ///
    /// Source of the factor: Knuth, The art of computer programming, volume 3, 1973, section 6.4.
    pub(super) fn some(&self) -> Option<Vec<Observation>> {
        let seen = self.summed(self.seen());
        let moving = |camera: &usize| !self.fixed[*camera] && seen[*camera] > 0 && self.leads(*camera);
        let moving = (0..seen.len()).filter(moving).count();
        if moving <= LARGE || self.fixed_points {
            return None;
        }
        let points = self.observations.chunk_by(|a, b| a.point == b.point).filter(|seen| seen.len() > 1);
        let mut points: Vec<&[Observation]> = points.collect();
        points.sort_by_key(|seen| (seen.len() < SEVERAL, (seen[0].point as u32).wrapping_mul(SCATTER)));
        // Of a rig, the first camera counts for all.
        let first = |o: &Observation| self.mounted(o.camera).on;
        let mut counts = vec![0; seen.len()];
        let mut some = Vec::new();
        for seen in points {
            if seen.iter().all(|o| counts[first(o)] >= ENOUGH) {
                continue;
            }
            // The cameras that have fewest, so that none is left with few.
            let mut seen = seen.to_vec();
            seen.sort_by_key(|o| counts[first(o)]);
            seen.truncate(OF_POINT);
            seen.iter().for_each(|o| counts[first(o)] += 1);
            some.extend(seen);
        }
        some.sort_unstable_by_key(|o| (o.point, o.camera));
        let [some_of_all, least] = [2 * some.len(), 3 * moving * ENOUGH as usize / 2];
        (least..=self.observations.len()).contains(&some_of_all).then_some(some)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundle::Lens;
    use weaver_geometry::glam::{DVec2, DVec3};
    use weaver_geometry::{Camera, Intrinsics, Pose, so3};
    use weaver_kernels::random::Stream;

    /// Cameras around a ball of points. Two in five of them see each point, a fifth of a pixel off.
    fn around(cameras: usize) -> Bundle {
        let stream = Stream::new(7, 0, "test.some");
        let draw = |k: usize| stream.normal::<f64>(k as u64);
        let intrinsics = Intrinsics { fx: 300.0, fy: 300.0, cx: 160.0, cy: 120.0 };
        let camera = |i: usize| {
            let turn = so3::exp(DVec3::Y * (std::f64::consts::TAU * i as f64 / cameras as f64));
            Camera { pose: Pose::new(turn, DVec3::Z * 4.0), intrinsics, width: 320, height: 240 }
        };
        let mut bundle = Bundle {
            cameras: (0..cameras).map(camera).collect(),
            lenses: vec![Lens { free_focal: true, ..Lens::default() }],
            lens_of: vec![0; cameras],
            fixed: (0..cameras).map(|i| i == 0).collect(),
            ..Bundle::default()
        };
        for point in 0..2500 {
            let at = DVec3::new(draw(3 * point), draw(3 * point + 1), draw(3 * point + 2)).normalize();
            bundle.points.push(at);
            for (number, camera) in bundle.cameras.iter().enumerate().filter(|(i, _)| (i + point) % 5 < 2) {
                let k = 10_000 + 2 * (point * cameras + number);
                let pixel = intrinsics.project(camera.pose.apply(at)) + 0.2 * DVec2::new(draw(k), draw(k + 1));
                bundle.observations.push(Observation { camera: number, point, pixel, deviation: 1.0 });
            }
        }
        bundle
    }

    #[test]
    fn every_camera_keeps_enough() {
        let bundle = around(LARGE + 2);
        let some = bundle.some().expect("many cameras");
        assert!(some.is_sorted_by_key(|o| (o.point, o.camera)));
        assert!(some.chunk_by(|a, b| a.point == b.point).all(|seen| (2..=OF_POINT).contains(&seen.len())));
        let mut counts = vec![0; bundle.cameras.len()];
        some.iter().for_each(|o| counts[o.camera] += 1);
        assert!(counts.iter().all(|count| (ENOUGH..ENOUGH + ENOUGH / 4).contains(count)), "{counts:?}");
        assert!(around(LARGE).some().is_none(), "few cameras");
        let few = bundle.observations.iter().filter(|o| o.point < 600).copied().collect();
        assert!(Bundle { observations: few, ..bundle }.some().is_none(), "few observations");
    }

    /// By some observations cameras come to nearly the same place as by all, and points follow.
    #[test]
    fn some_stand_for_all() {
        let truth = around(LARGE + 2);
        let draw = |k: usize| Stream::new(8, 0, "test.moved").normal::<f64>(k as u64);
        let mut moved = truth.clone();
        for (i, camera) in moved.cameras.iter_mut().enumerate().skip(1) {
            let [turn, shift] = [0, 3].map(|k| DVec3::new(draw(6 * i + k), draw(6 * i + k + 1), draw(6 * i + k + 2)));
            let Pose { rotation, translation } = camera.pose;
            camera.pose = Pose::new(so3::exp(0.003 * turn) * rotation, translation + 0.01 * shift);
        }
        let before = moved.median_error();
        let mut exact = moved.clone();
        exact.adjust(2.0, 20);
        moved.adjust_roughly(2.0, 20);
        let [after, best] = [moved.median_error(), exact.median_error()];
        assert!(before > 1.0 && after < 1.05 * best, "{before} -> {after}, by all {best}");
        assert!(!moved.fixed[1] && moved.lenses[0].free_focal && moved.observations.len() == truth.observations.len());
    }
}
