//! Pose codes to cameras, and cameras to pose codes.

use super::rotation::quaternion;
use super::row_map::{RowMap, RowMapOp};
use crate::rotation::matrix;
use weaver_autograd::{Dual, Real, Var};
use weaver_geometry::fov::{field_of_view, focal_length};
use weaver_geometry::pose_code::TANGENT_OFFSET;

/// Numbers in a pose code: translation 3, quaternion xyzw 4, field of view 2.
pub const LENGTH: usize = 9;

/// Cameras on the tape.
#[derive(Clone, Copy, Debug)]
pub struct CameraVars<'t, T: Real = f32> {
    /// World-to-camera `[R | T]`, OpenCV axes, `[.., 3, 4]`.
    pub viewmats: Var<'t, T>,
    /// fx, fy, cx, cy in pixels, `[.., 4]`.
    pub intrinsics: Var<'t, T>,
}

impl<'t, T: Real> CameraVars<'t, T> {
    /// Some of V cameras in a row, for viewmats `[V, 3, 4]` and intrinsics `[V, 4]`.
    #[must_use]
    #[track_caller]
    pub fn slice(&self, first: usize, count: usize) -> Self {
        let [viewmats, intrinsics] = [self.viewmats, self.intrinsics].map(|all| all.slice(0, first, count));
        Self { viewmats, intrinsics }
    }

    /// Where V cameras stand, o = -R^T t, for viewmats `[V, 3, 4]`: `[V, 3]`. Differentiable, the entries of R taken as
    /// independent.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// use weaver_pose::CameraVars;
    /// let tape = Tape::<f64>::new();
    /// let viewmats = tape.constant(&[1.0, 0.0, 0.0, 5.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0], [1, 3, 4]);
    /// let cameras = CameraVars { viewmats, intrinsics: tape.constant(&[1.0, 1.0, 0.5, 0.5], [1, 4]) };
    /// assert_eq!(cameras.centers().to_vec(), [-5.0, 0.0, -2.0]);
    /// ```
    #[track_caller]
    pub fn centers(&self) -> Var<'t, T> {
        let [rotations, translations] = [(0, 3), (3, 1)].map(|(first, count)| self.viewmats.slice(2, first, count));
        rotations.matmul_with(translations, true, false).reshape([self.viewmats.shape()[0], 3]) * -1.0
    }
}

fn rectified<T: Real, const N: usize>(x: Dual<T, N>) -> Dual<T, N> {
    if x.value > T::ZERO { x } else { x * 0.0 }
}

#[derive(Debug)]
struct Activate;

impl RowMap<9, 9> for Activate {
    const NAME: &'static str = "activate_pose_code";
    const INPUTS: &'static [&'static [usize]] = &[&[LENGTH]];
    const OUTPUTS: &'static [&'static [usize]] = &[&[LENGTH]];
    fn eval<T: Real>(&self, mut code: [Dual<T, 9>; 9]) -> [Dual<T, 9>; 9] {
        code[7] = rectified(code[7]);
        code[8] = rectified(code[8]);
        code
    }
}

/// Pose codes with their fields of view clamped to be at least 0, the other seven numbers unchanged.
///
/// `code` `[.., 9]` gives `[.., 9]`. Differentiable; the gradient of a clamped field of view is 0. This is how a camera
/// head's running estimate becomes the code that it emits.
#[track_caller]
pub fn activate<T: Real>(code: Var<'_, T>) -> Var<'_, T> {
    let [activated] = code.tape().apply(RowMapOp(Activate), &[code]);
    activated
}

#[derive(Debug)]
struct Decode {
    height: f64,
    width: f64,
    tangent_offset: f64,
}

impl RowMap<9, 16> for Decode {
    const NAME: &'static str = "pose_code_to_cameras";
    const INPUTS: &'static [&'static [usize]] = &[&[LENGTH]];
    const OUTPUTS: &'static [&'static [usize]] = &[&[3, 4], &[4]];
    fn eval<T: Real>(&self, code: [Dual<T, 9>; 9]) -> [Dual<T, 9>; 16] {
        let r = matrix([code[3], code[4], code[5], code[6]]);
        let focal = |size: f64, fov| focal_length(fov, size, self.tangent_offset, Dual::tan);
        let (fx, fy) = (focal(self.width, code[8]), focal(self.height, code[7]));
        let (cx, cy) = (Dual::from(0.5 * self.width), Dual::from(0.5 * self.height));
        let [t, u, v] = [code[0], code[1], code[2]];
        [r[0], r[1], r[2], t, r[3], r[4], r[5], u, r[6], r[7], r[8], v, fx, fy, cx, cy]
    }
}

/// The cameras that pose codes describe, for images of `height` x `width` pixels.
///
/// viewmats = [R(q) | T]; fy = (H / 2) / (tan(fov_y / 2) + 1e-3), fx likewise from W; the principal point is the
/// image's center. `code` `[.., 9]`, with fields of view of at least 0, gives viewmats `[.., 3, 4]` and intrinsics
/// `[.., 4]` in pixels. Differentiable in all nine numbers. The encoding is "absT_quaR_FoV" of VGGT (Wang et al. 2025,
/// arXiv 2503.11651) with AnySplat's margin on the tangent.
#[track_caller]
pub fn cameras<T: Real>(code: Var<'_, T>, height: usize, width: usize) -> CameraVars<'_, T> {
    cameras_with(code, [height, width], TANGENT_OFFSET)
}

/// As [`cameras`], for images of `size` (H, W), with another margin than 1e-3 on the tangent of half the field of view:
/// f = (size / 2) / (tan(fov / 2) + `tangent_offset`).
///
/// VGGT's own weights have none, and 0 inverts [`encode`]; a field of view of 0 then has an infinite focal length.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let code = tape.leaf(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.9, 1.2], [1, 9]);
/// let focal = |offset| weaver_pose::cameras_with(code, [48, 64], offset).intrinsics.to_vec()[0];
/// assert!((focal(0.0) - 32.0 / 0.6_f64.tan()).abs() < 1e-12);
/// assert!((32.0 / focal(1e-3) - 32.0 / focal(0.0) - 1e-3).abs() < 1e-12);
/// ```
#[track_caller]
pub fn cameras_with<T: Real>(code: Var<'_, T>, size: [usize; 2], tangent_offset: f64) -> CameraVars<'_, T> {
    let [height, width] = size.map(|side| side as f64);
    let decode = Decode { height, width, tangent_offset };
    let [viewmats, intrinsics] = code.tape().apply(RowMapOp(decode), &[code]);
    CameraVars { viewmats, intrinsics }
}

#[derive(Debug)]
struct Encode {
    height: f64,
    width: f64,
}

impl RowMap<16, 9> for Encode {
    const NAME: &'static str = "cameras_to_pose_code";
    const INPUTS: &'static [&'static [usize]] = &[&[3, 4], &[4]];
    const OUTPUTS: &'static [&'static [usize]] = &[&[LENGTH]];
    fn eval<T: Real>(&self, c: [Dual<T, 16>; 16]) -> [Dual<T, 16>; 9] {
        let [x, y, z, w] = quaternion([c[0], c[1], c[2], c[4], c[5], c[6], c[8], c[9], c[10]]);
        let fov = |size: f64, focal| field_of_view(focal, size, Dual::atan);
        [c[3], c[7], c[11], x, y, z, w, fov(self.height, c[13]), fov(self.width, c[12])]
    }
}

/// The pose codes of cameras, for images of `height` x `width` pixels.
///
/// A code holds T and the unit quaternion (w not negative) of viewmats = [R | T]; fov_y = 2 atan(H / 2 / fy), fov_x
/// likewise from W. `viewmats` `[.., 3, 4]` and `intrinsics` fx, fy, cx, cy in pixels `[.., 4]` give `[.., 9]`.
/// Differentiable in both, the nine entries of R taken as independent. A code has no principal point, whose gradient
/// is 0. Decoding does not give back exactly these focal lengths, because [`cameras`] adds [`TANGENT_OFFSET`].
/// Source: VGGT, Wang et al. 2025, arXiv 2503.11651.
#[track_caller]
pub fn encode<'t, T: Real>(viewmats: Var<'t, T>, intrinsics: Var<'t, T>, height: usize, width: usize) -> Var<'t, T> {
    let encode = Encode { height: height as f64, width: width as f64 };
    let [code] = viewmats.tape().apply(RowMapOp(encode), &[viewmats, intrinsics]);
    code
}
