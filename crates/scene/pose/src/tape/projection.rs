//! Cameras as 4 x 4 matrices, as attention over views takes them.

use super::code::CameraVars;
use super::row_map::{RowMap, RowMapOp};
use weaver_autograd::{Dual, Real, Var};

#[derive(Debug)]
struct Project {
    width: f64,
    height: f64,
}

impl RowMap<16, 32> for Project {
    const NAME: &'static str = "projections";
    const INPUTS: &'static [&'static [usize]] = &[&[3, 4], &[4]];
    const OUTPUTS: &'static [&'static [usize]] = &[&[4, 4], &[4, 4]];
    fn eval<T: Real>(&self, c: [Dual<T, 16>; 16]) -> [Dual<T, 16>; 32] {
        let (zero, one) = (Dual::from(0.0), Dual::from(1.0));
        let [fx, fy] = [c[12] / self.width, c[13] / self.height];
        let [cx, cy] = [c[14] / self.width - 0.5, c[15] / self.height - 0.5];
        let mut out = [zero; 32];
        for j in 0..4 {
            out[j] = fx * c[j] + cx * c[8 + j];
            out[4 + j] = fy * c[4 + j] + cy * c[8 + j];
            out[8 + j] = c[8 + j];
        }
        out[15] = one;
        // [R^T | -R^T t] times the inverse of K', whose columns are (1/fx, 0, 0), (0, 1/fy, 0), (-cx/fx, -cy/fy, 1).
        for i in 0..3 {
            let [a, b, z] = [c[i], c[4 + i], c[8 + i]];
            out[16 + 4 * i] = a / fx;
            out[17 + 4 * i] = b / fy;
            out[18 + 4 * i] = z - a * cx / fx - b * cy / fy;
            out[19 + 4 * i] = -(a * c[3] + b * c[7] + z * c[11]);
        }
        out[31] = one;
        out
    }
}

/// World to normalized image, `[.., 4, 4]`, and its inverse, for images of `size` (H, W) pixels.
///
/// P = diag(K', 1) [R t; 0 1] with K' = [[fx / W, 0, cx / W - 1/2], [0, fy / H, cy / H - 1/2], [0, 0, 1]]; the inverse
/// is in closed form, with R^T for the inverse of R. `cameras`: viewmats `[.., 3, 4]`, intrinsics `[.., 4]` in pixels.
/// Differentiable in both, the entries of R taken as independent. Source: PRoPE, Li et al., arXiv 2507.10496.
///
/// ```
/// use weaver_autograd::Tape;
/// use weaver_pose::{CameraVars, projections};
/// let tape = Tape::<f64>::new();
/// let viewmats = tape.constant(&[1.0, 0.0, 0.0, 5.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0], [3, 4]);
/// let intrinsics = tape.constant(&[8.0, 6.0, 4.0, 3.0], [4]);
/// let [p, inverse] = projections(&CameraVars { viewmats, intrinsics }, [6, 8]);
/// assert_eq!(p.to_vec()[..4], [1.0, 0.0, 0.0, 5.0]);
/// assert_eq!(inverse.to_vec()[..4], [1.0, 0.0, 0.0, -5.0]);
/// ```
#[track_caller]
pub fn projections<'t, T: Real>(cameras: &CameraVars<'t, T>, size: [usize; 2]) -> [Var<'t, T>; 2] {
    let [height, width] = size.map(|side| side as f64);
    cameras.viewmats.tape().apply(RowMapOp(Project { width, height }), &[cameras.viewmats, cameras.intrinsics])
}
