//! Cameras as rows of numbers, the form that rasterizers and networks take.

use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::lens::Lens;
use weaver_geometry::{Camera, Intrinsics, Pose};

/// Model of a camera: the direction that each pixel looks in.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Model {
    /// A plane image: pixel (u, v) looks along ((u - cx) / fx, (v - cy) / fy, 1).
    #[default]
    Pinhole,
    /// Pixel (u, v) looks along the direction that the lens sees at ((u - cx) / fx, (v - cy) / fy); nowhere where it
    /// sees none. All views of a call have the same intrinsics.
    Lens(Lens),
}

/// `V` cameras with images of one size, borrowed as rows of numbers.
#[derive(Clone, Copy, Debug)]
pub struct CameraSlices<'a, T> {
    /// World to camera, OpenCV axes, `[V, 3, 4]` or `[V, 4, 4]` (the last row is not read): p = A m + t. A and t are
    /// twelve free numbers; nothing assumes that A is a rotation.
    pub viewmats: &'a [T],
    /// fx, fy, cx, cy in pixels, pixel centers at +0.5, `[V, 4]`.
    pub intrinsics: &'a [T],
    /// Color of the background, `[V, 3]`, or `[3]` for all views.
    pub background: &'a [T],
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
    pub height: usize,
    /// Model of all of them.
    pub model: Model,
}

impl<T: Copy> CameraSlices<'_, T> {
    /// Number of views.
    pub fn views(&self) -> usize {
        self.intrinsics.len() / 4
    }

    /// Number of numbers of one view matrix, 12 or 16.
    pub fn matrix_len(&self) -> usize {
        self.viewmats.len() / self.views().max(1)
    }

    /// The background of view `v`.
    pub fn background_of(&self, v: usize) -> [T; 3] {
        let at = if self.background.len() == 3 { 0 } else { 3 * v };
        [self.background[at], self.background[at + 1], self.background[at + 2]]
    }

    /// Converts to pinhole cameras, from any model. The background is not used and may be empty.
    pub fn to_cameras(&self) -> Vec<Camera>
    where
        T: Into<f64>,
    {
        (self.viewmats.chunks_exact(self.matrix_len().max(12)).zip(self.intrinsics.chunks_exact(4)))
            .map(|(m, k)| {
                let m: [f64; 12] = std::array::from_fn(|i| m[i].into());
                let rotation = DMat3::from_cols_array(&[m[0], m[4], m[8], m[1], m[5], m[9], m[2], m[6], m[10]]);
                let [fx, fy, cx, cy] = std::array::from_fn(|i| k[i].into());
                Camera {
                    pose: Pose::new(rotation, DVec3::new(m[3], m[7], m[11])),
                    intrinsics: Intrinsics { fx, fy, cx, cy },
                    width: self.width,
                    height: self.height,
                }
            })
            .collect()
    }
}

/// `V` pinhole cameras with images of one size, as rows of numbers: owned memory for [`CameraSlices`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraRows {
    /// World to camera, `[V, 3, 4]`.
    pub viewmats: Vec<f32>,
    /// fx, fy, cx, cy in pixels, `[V, 4]`.
    pub intrinsics: Vec<f32>,
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
    pub height: usize,
}

impl CameraRows {
    /// Makes the rows of cameras, which must all have the same image size.
    pub fn new(cameras: &[Camera]) -> Self {
        let (width, height) = cameras.first().map_or((0, 0), |camera| (camera.width, camera.height));
        debug_assert!(cameras.iter().all(|camera| (camera.width, camera.height) == (width, height)));
        Self {
            viewmats: cameras.iter().flat_map(|camera| viewmat(&camera.pose)).collect(),
            intrinsics: cameras.iter().flat_map(intrinsics_row).collect(),
            width,
            height,
        }
    }

    /// The cameras with a background, `[3]` or `[V, 3]`, in the form that a rasterizer takes.
    pub fn as_slices<'a>(&'a self, background: &'a [f32]) -> CameraSlices<'a, f32> {
        let Self { viewmats, intrinsics, width, height } = self;
        CameraSlices { viewmats, intrinsics, background, width: *width, height: *height, model: Model::Pinhole }
    }
}

/// The world-to-camera matrix `[R | t]` of a pose, `[3, 4]`, row by row.
pub fn viewmat(pose: &Pose) -> [f32; 12] {
    let r = pose.rotation.to_cols_array_2d();
    let t = pose.translation.to_array();
    std::array::from_fn(|at| if at % 4 == 3 { t[at / 4] } else { r[at % 4][at / 4] } as f32)
}

/// The intrinsics of a camera, `[4]`: fx, fy, cx, cy in pixels.
pub fn intrinsics_row(camera: &Camera) -> [f32; 4] {
    let k = camera.intrinsics;
    [k.fx, k.fy, k.cx, k.cy].map(|x| x as f32)
}
