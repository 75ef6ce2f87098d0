//! One pinhole camera, ready to project with.

use crate::each::each;
use crate::matrix::{self, Mat33, Vec3};
use weaver_kernels::Real;
use weaver_kernels::lanes::Lanes;
use weaver_scene::CameraSlices;

/// One camera, in numbers or in lanes that all hold the same.
#[derive(Clone, Copy, Debug)]
pub(crate) struct View<X> {
    /// A.
    pub axes: Mat33<X>,
    /// t.
    pub shift: Vec3<X>,
    /// -A^-1 t.
    pub center: Vec3<X>,
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

    /// The camera with each of its numbers in all lanes.
    #[inline(always)]
    pub fn in_lanes<V: Lanes<Scalar = T>>(&self) -> View<V> {
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
