//! Surfels as data.

use weaver_geometry::Pose;
use weaver_geometry::glam::{DQuat, DVec3};
use weaver_kernels::Real;

/// Flat Gaussians.
///
/// The columns of a quaternion's rotation are the tangents t1 and t2 and the normal n. Scales are stored as their
/// logarithms, opacities as logits. The same type holds gradients.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surfels<T> {
    /// Centers, `[N, 3]`, meters.
    pub centers: Vec<T>,
    /// Quaternions wxyz of any length but 0, `[N, 4]`.
    pub quats: Vec<T>,
    /// Logarithms of the standard deviations along t1 and t2, `[N, 2]`.
    pub log_scales: Vec<T>,
    /// Logits of the opacities, `[N]`.
    pub opacity_logits: Vec<T>,
}

/// Borrowed [`Surfels`].
#[derive(Clone, Copy, Debug)]
pub struct SurfelSlices<'a, T> {
    /// `[N, 3]`
    pub centers: &'a [T],
    /// `[N, 4]`
    pub quats: &'a [T],
    /// `[N, 2]`
    pub log_scales: &'a [T],
    /// `[N]`
    pub opacity_logits: &'a [T],
}

/// One surfel in numbers of 64 bits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surfel {
    pub center: DVec3,
    /// t1, t2, n.
    pub axes: [DVec3; 3],
    pub scales: [f64; 2],
    pub opacity: f64,
}

impl<T: Real> Surfels<T> {
    /// Number of surfels.
    pub fn len(&self) -> usize {
        self.opacity_logits.len()
    }

    /// Says if there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// As many zeros, for gradients.
    pub fn zeros(len: usize) -> Self {
        let zeros = |numbers: usize| vec![T::ZERO; numbers * len];
        Self { centers: zeros(3), quats: zeros(4), log_scales: zeros(2), opacity_logits: zeros(1) }
    }

    /// Adds a surfel.
    pub fn push(&mut self, center: [T; 3], quat: [T; 4], log_scales: [T; 2], opacity_logit: T) {
        self.centers.extend(center);
        self.quats.extend(quat);
        self.log_scales.extend(log_scales);
        self.opacity_logits.push(opacity_logit);
    }

    /// Adds all surfels of another.
    pub fn extend(&mut self, other: &Self) {
        let SurfelSlices { centers, quats, log_scales, opacity_logits } = other.slices();
        let parts = [centers, quats, log_scales, opacity_logits];
        self.columns_mut().into_iter().zip(parts).for_each(|(to, from)| to.extend(from));
    }

    /// Keeps the surfels that are marked.
    ///
    /// # Panics
    ///
    /// If there are not as many marks as surfels.
    pub fn keep(&mut self, marks: &[bool]) {
        assert_eq!(marks.len(), self.len(), "keep: one mark for each surfel");
        for (column, numbers) in self.columns_mut().into_iter().zip([3, 4, 2, 1]) {
            let mut at = 0;
            column.retain(|_| {
                at += 1;
                marks[(at - 1) / numbers]
            });
        }
    }

    /// The numbers, for reading.
    ///
    /// # Panics
    ///
    /// If the lengths do not fit one another.
    pub fn slices(&self) -> SurfelSlices<'_, T> {
        let Self { centers, quats, log_scales, opacity_logits } = self;
        let slices = SurfelSlices { centers, quats, log_scales, opacity_logits };
        let n = slices.len();
        let lens = [centers.len(), quats.len(), log_scales.len()];
        assert_eq!(lens, [3 * n, 4 * n, 2 * n], "surfels: centers, quaternions and scales of {n} surfels");
        slices
    }

    fn columns_mut(&mut self) -> [&mut Vec<T>; 4] {
        [&mut self.centers, &mut self.quats, &mut self.log_scales, &mut self.opacity_logits]
    }

    /// Moves each surfel by a rigid motion.
    pub fn transform_each(&mut self, motion: impl Fn(usize) -> Pose) {
        for (n, (c, q)) in self.centers.chunks_exact_mut(3).zip(self.quats.chunks_exact_mut(4)).enumerate() {
            let motion = motion(n);
            let turn = DQuat::from_mat3(&motion.rotation);
            let moved = motion.apply(DVec3::new(c[0].to_f64(), c[1].to_f64(), c[2].to_f64()));
            let [w, x, y, z] = [0, 1, 2, 3].map(|i| q[i].to_f64());
            let turned = turn * DQuat::from_xyzw(x, y, z, w);
            c.iter_mut().zip(moved.to_array()).for_each(|(to, from)| *to = T::from_f64(from));
            let numbers = [turned.w, turned.x, turned.y, turned.z];
            q.iter_mut().zip(numbers).for_each(|(to, from)| *to = T::from_f64(from));
        }
    }
}

impl<T: Real> SurfelSlices<'_, T> {
    /// Number of surfels.
    pub fn len(&self) -> usize {
        self.opacity_logits.len()
    }

    /// Says if there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The unit quaternion of a surfel, and the length of the one that is stored.
    pub(crate) fn unit_quat(&self, n: usize) -> (DQuat, f64) {
        let [w, x, y, z] = [0, 1, 2, 3].map(|i| self.quats[4 * n + i].to_f64());
        let q = DQuat::from_xyzw(x, y, z, w);
        let length = q.length();
        (q * (1.0 / length), length)
    }

    /// A surfel as a camera with this pose (world to camera) sees it.
    pub(crate) fn placed(&self, n: usize, pose: &Pose) -> Surfel {
        let center = DVec3::from_array([0, 1, 2].map(|i| self.centers[3 * n + i].to_f64()));
        let (q, _) = self.unit_quat(n);
        let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| pose.rotation * (q * axis));
        let scales = [0, 1].map(|i| self.log_scales[2 * n + i].to_f64().exp());
        let opacity = 1.0 / (1.0 + (-self.opacity_logits[n].to_f64()).exp());
        Surfel { center: pose.apply(center), axes, scales, opacity }
    }
}
