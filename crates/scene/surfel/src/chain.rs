//! From sums over pixels to the numbers of a surfel and to the pose.

use crate::Sight;
use crate::response::sum;
use crate::surfels::Surfel;
use weaver_geometry::glam::{DQuat, DVec3};
use weaver_kernels::Real;

/// Numbers of a surfel: center 3, quaternion 4, scales 2, opacity 1.
pub(crate) const NUMBERS: usize = 10;

/// A surfel's gradient through one view.
pub(crate) struct SurfelGradient {
    pub numbers: [f64; NUMBERS],
    /// With respect to a translation and a rotation of the camera's frame.
    pub pose: [f64; 6],
}

impl<T: Real> Sight<'_, T> {
    /// The gradient of surfel `n` through a view, from its sums and the sums of its normal, `dnormal`.
    ///
    /// With the offset from the center in the coordinates a and b, which suffice since it lies in the plane:
    /// dc = n sum q/D + sum g a t1/s1 + sum g b t2/s2, and the turn is t1 x dt1 + t2 x dt2 + n x dn.
    pub(crate) fn gradient(&self, view: usize, n: usize, sums: &[T], dnormal: [T; 3]) -> SurfelGradient {
        let of = |at: usize| sums[at].to_f64();
        let pose = &self.poses[view];
        let Surfel { center, axes: [t1, t2, normal], scales: [s1, s2], opacity } = self.surfels.placed(n, pose);
        let dnormal = DVec3::from_array(dnormal.map(|x| x.to_f64()));
        let mut dcenter = normal * of(sum::RANGE) + t1 * (of(sum::FIRST) / s1) + t2 * (of(sum::FIRST + 1) / s2);
        let [du, dv] = self.camera.project_gradients(center);
        dcenter -= 2.0 * (du * of(sum::LOW_PASS) + dv * of(sum::LOW_PASS + 1));
        dcenter += center.normalize() * of(sum::DISTANCE);
        let mixed = of(sum::SECOND + 1) * (s1 / s2 - s2 / s1);
        let turn =
            normal.cross(dnormal) + normal * mixed - t2 * (of(sum::RANGE + 1) * s1) + t1 * (of(sum::RANGE + 2) * s2);
        // A unit quaternion turned by w moves by half of (0, w) q.
        let (q, length) = self.surfels.unit_quat(n);
        let world = pose.rotation.transpose();
        let w = world * turn;
        let dq = (DQuat::from_xyzw(w.x, w.y, w.z, 0.0) * q) * (2.0 / length);
        let numbers = {
            let DVec3 { x, y, z } = world * dcenter;
            let logit = (1.0 - opacity) * of(sum::G);
            [x, y, z, dq.w, dq.x, dq.y, dq.z, of(sum::SECOND), of(sum::SECOND + 2), logit]
        };
        let turn = center.cross(dcenter) + turn;
        let pose = [dcenter.x, dcenter.y, dcenter.z, turn.x, turn.y, turn.z];
        SurfelGradient { numbers, pose }
    }
}
