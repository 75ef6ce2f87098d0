//! Pixels of one photo in another one, by inverse depth.

use weaver_geometry::Camera;
use weaver_geometry::glam::{DMat3, DVec3};

/// The way of a pixel into another photo: `p = A (u, v, 1) + t w`, homogeneous, with `w` the inverse depth at the
/// pixel. Its third component is the depth in the other photo over the depth in this one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Warp {
    /// Columns of `A = K' R K^-1`.
    pub columns: [[f32; 3]; 3],
    /// `t = K' t`.
    pub shift: [f32; 3],
}

impl Warp {
    /// The way from one camera's pixels to another's.
    pub fn new(from: &Camera, to: &Camera) -> Self {
        let relative = to.pose.relative_to(&from.pose);
        let (a, b) = (&from.intrinsics, &to.intrinsics);
        let inverse = DMat3::from_cols(
            DVec3::new(1.0 / a.fx, 0.0, 0.0),
            DVec3::new(0.0, 1.0 / a.fy, 0.0),
            DVec3::new(-a.cx / a.fx, -a.cy / a.fy, 1.0),
        );
        let k = DMat3::from_cols(DVec3::new(b.fx, 0.0, 0.0), DVec3::new(0.0, b.fy, 0.0), DVec3::new(b.cx, b.cy, 1.0));
        let linear = k * relative.rotation * inverse;
        let narrow = |v: DVec3| v.as_vec3().to_array();
        Self {
            columns: [linear.x_axis, linear.y_axis, linear.z_axis].map(narrow),
            shift: narrow(k * relative.translation),
        }
    }

    /// The homogeneous place of a pixel at an inverse depth.
    #[inline(always)]
    pub fn apply(&self, [u, v]: [f32; 2], w: f32) -> [f32; 3] {
        let [x, y, z] = &self.columns;
        let mut place = [0.0; 3];
        for i in 0..3 {
            place[i] = x[i] * u + y[i] * v + z[i] + self.shift[i] * w;
        }
        place
    }

    /// Change of the homogeneous place for each pixel along an axis, 0 or 1, along which the inverse depth has this
    /// slope.
    #[inline(always)]
    pub fn along(&self, axis: usize, slope: f32) -> [f32; 3] {
        let mut change = self.columns[axis];
        for (change, shift) in change.iter_mut().zip(&self.shift) {
            *change += shift * slope;
        }
        change
    }

    /// The place of a pixel at an inverse depth, and its inverse depth there; `None` behind the other camera.
    #[inline(always)]
    pub fn place(&self, pixel: [f32; 2], w: f32) -> Option<([f32; 2], f32)> {
        let [x, y, z] = self.apply(pixel, w);
        (z > 1e-6).then(|| ([x / z, y / z], w / z))
    }
}
