//! The camera head and the cameras that its codes stand for.

use super::reference::Reference;
use weaver_autograd::{Params, Real, Tape, Var};
use weaver_nn::{Builder, Context, Init, WeightInit};
use weaver_pose::CameraVars;
use weaver_vggt::{CameraHead, CameraHeadConfig};

/// 3x3 matrices of rows fx, fy, cx, cy; `corner` is the last entry.
pub fn matrices<T: Real>(rows: &[T], corner: f64) -> Vec<T> {
    let (zero, corner) = (T::ZERO, T::from_f64(corner));
    rows.chunks_exact(4).flat_map(|k| [k[0], zero, k[2], zero, k[1], k[3], zero, zero, corner]).collect()
}

/// Rows fx, fy, cx, cy of 3x3 matrices.
pub fn intrinsics<T: Real>(matrices: &[T]) -> Vec<T> {
    matrices.chunks_exact(9).flat_map(|k| [k[0], k[4], k[2], k[5]]).collect()
}

/// sum(cot.intrinsics * K).
pub fn weighted_intrinsics<'t, T: Real>(file: &Reference, rows: Var<'t, T>, key: &str) -> Var<'t, T> {
    (rows * rows.tape().constant(&intrinsics(&file.data(key)), rows.shape())).sum()
}

/// Camera-to-world 4x4 matrices of world-to-camera rows `[R | T]`.
fn inverse<T: Real>(rows: &[T]) -> Vec<T> {
    let one = |m: &[T]| {
        let r = |i: usize, j: usize| m[4 * j + i];
        let t = |i: usize| -(0..3).map(|j| r(i, j) * m[4 * j + 3]).sum::<T>();
        let row = |i: usize| [r(i, 0), r(i, 1), r(i, 2), t(i)];
        [row(0), row(1), row(2), [T::ZERO, T::ZERO, T::ZERO, T::ONE]].concat()
    };
    rows.chunks_exact(12).flat_map(one).collect()
}

pub fn check_cameras<T: Real>(file: &Reference, cameras: &CameraVars<'_, T>) {
    file.check("out.extrinsics", &cameras.viewmats.value());
    file.check("out.intrinsics", &matrices(&cameras.intrinsics.value(), 1.0));
}

pub fn run<T: Real>(file: Reference) -> Reference {
    let dim = file.size("dim");
    let config = CameraHeadConfig {
        dim,
        depth: file.size("trunk_depth"),
        heads: file.size("heads"),
        mlp_ratio: file.size("mlp_ratio"),
        iterations: file.size("iterations"),
        weight: WeightInit::TruncatedNormal(0.02),
        token: Init::Normal(0.02),
        layer_scale: 0.01,
        base_fov: None,
        relative: false,
    };
    let (height, width) = (file.size("image_h"), file.size("image_w"));
    let mut params = Params::<T>::new();
    let head = CameraHead::new(Builder::new(&mut params, 0).scope("camera_head"), config);
    file.load(&mut params);
    let tape = Tape::<T>::new();
    let tokens = file.leaf(&tape, "in.tokens");
    let [scenes, views] = [tokens.shape()[0], tokens.shape()[1]];
    let estimates = head.forward(Context::new(&tape, &params), tokens.slice(2, 0, 1).reshape([scenes, views, dim]));
    let mut loss = tape.scalar(T::ZERO);
    for (i, estimate) in estimates.iter().enumerate() {
        file.check(&format!("out.pose{i}"), &estimate.code.value());
        loss = loss + file.weighted(estimate.code, &format!("cot.pose{i}"));
    }
    let last = estimates.last().expect("at least one iteration").code;
    let cameras = weaver_pose::cameras(last, height, width);
    check_cameras(&file, &cameras);
    file.check("out.c2w", &inverse(&cameras.viewmats.value()));
    let size = [width, height, width, height].map(T::from_usize);
    let normalized: Vec<T> = cameras.intrinsics.value().iter().zip(size.iter().cycle()).map(|(k, n)| *k / *n).collect();
    file.check("out.intrinsics_normalised", &matrices(&normalized, 1.0));
    loss = loss + file.weighted(cameras.viewmats, "cot.extrinsics");
    loss = loss + weighted_intrinsics(&file, cameras.intrinsics, "cot.intrinsics");
    file.backward(loss);
    file.check_grad("grad.in.tokens", tokens);
    file.check_params(&params, &tape);
    file
}
