//! One pinhole camera, ready to project with.

use crate::each::each;
use crate::matrix::{self, Mat33, Vec3};
use weaver_kernels::Real;
use weaver_kernels::lanes::Lanes;
use weaver_scene::CameraSlices;

/// Gradients of a camera's axes (9), shift (3), focal lengths (2), principal point (2) and center (3), in this order.
pub const CAMERA_SUMS: usize = 19;

/// One camera as projection uses it, in numbers or in lanes that all hold the same; names follow
/// docs/explain/rasterizer.md.
#[derive(Clone, Copy, Debug)]
pub struct View<X> {
    /// A, the rows of the view matrix.
    pub axes: [[X; 3]; 3],
    /// t.
    pub shift: [X; 3],
    /// -A^-1 t, in world coordinates.
    pub center: [X; 3],
    /// fx, fy.
    pub focal: [X; 2],
    /// cx, cy.
    pub principal: [X; 2],
    /// Lower limits of x/z and y/z in the Jacobian.
    pub low: [X; 2],
    /// Upper limits.
    pub high: [X; 2],
}

impl<T: Real> View<T> {
    /// View `v` of the cameras.
    pub fn of(cameras: &CameraSlices<'_, T>, v: usize) -> Self {
        let m = &cameras.viewmats[v * cameras.matrix_len()..];
        let k = &cameras.intrinsics[4 * v..];
        let axes: Mat33<T> = std::array::from_fn(|i| std::array::from_fn(|j| m[4 * i + j]));
        let shift: Vec3<T> = std::array::from_fn(|i| m[4 * i + 3]);
        let center = matrix::apply(&matrix::inverse(&axes), shift.map(|x| -x.to_f64())).map(T::from_f64);
        let (focal, principal) = ([k[0], k[1]], [k[2], k[3]]);
        let size = [T::from_usize(cameras.width), T::from_usize(cameras.height)];
        // The frustum, widened by 30 % of half its size, bounds x/z and y/z in the Jacobian.
        let margin = T::from_f64(0.15);
        let low = std::array::from_fn(|i| -(principal[i] + margin * size[i]) / focal[i]);
        let high = std::array::from_fn(|i| (size[i] - principal[i] + margin * size[i]) / focal[i]);
        Self { axes, shift, center, focal, principal, low, high }
    }

    /// Gradients of view matrix (12, row-major) and intrinsics (4) from the sums over all splats.
    ///
    /// The sums treat the center as if it were free; it is -A^-1 t.
    pub fn gradient(&self, sums: &[f64; CAMERA_SUMS]) -> ([T; 12], [T; 4]) {
        let dcenter: Vec3<f64> = [sums[16], sums[17], sums[18]];
        // Plain colors do not look at the center, which need not exist then.
        let still = dcenter == [0.0; 3];
        let moved = if still { [0.0; 3] } else { matrix::apply_transposed(&matrix::inverse(&self.axes), dcenter) };
        let mut matrix = [T::ZERO; 12];
        for i in 0..3 {
            for j in 0..3 {
                let through_center = if moved[i] == 0.0 { 0.0 } else { moved[i] * self.center[j].to_f64() };
                matrix[4 * i + j] = T::from_f64(sums[3 * i + j] - through_center);
            }
            matrix[4 * i + 3] = T::from_f64(sums[9 + i] - moved[i]);
        }
        (matrix, [12, 13, 14, 15].map(|i| T::from_f64(sums[i])))
    }

    /// The camera with each of its numbers in all lanes.
    #[inline(always)]
    pub(crate) fn in_lanes<V: Lanes<Scalar = T>>(&self) -> View<V> {
        let Self { axes, shift, center, focal, principal, low, high } = *self;
        View {
            axes: each!(3, |i| each!(3, |j| V::splat(axes[i][j]))),
            shift: each!(3, |i| V::splat(shift[i])),
            center: each!(3, |i| V::splat(center[i])),
            focal: each!(2, |i| V::splat(focal[i])),
            principal: each!(2, |i| V::splat(principal[i])),
            low: each!(2, |i| V::splat(low[i])),
            high: each!(2, |i| V::splat(high[i])),
        }
    }
}
