//! The camera head and the cameras that its codes stand for.

use super::reference::Reference;
use weaver_autograd::{Params, Tape, Var};
use weaver_nn::{Builder, Context, Init, WeightInit};
use weaver_pose::{CameraHead, CameraHeadConfig, Cameras, Gauge};

/// 3x3 matrices of rows fx, fy, cx, cy; `corner` is the last entry.
pub fn matrices(rows: &[f32], corner: f32) -> Vec<f32> {
    rows.chunks_exact(4).flat_map(|k| [k[0], 0.0, k[2], 0.0, k[1], k[3], 0.0, 0.0, corner]).collect()
}

/// Rows fx, fy, cx, cy of 3x3 matrices.
pub fn intrinsics(matrices: &[f32]) -> Vec<f32> {
    matrices.chunks_exact(9).flat_map(|k| [k[0], k[4], k[2], k[5]]).collect()
}

/// sum(cot.intrinsics * K).
pub fn weighted_intrinsics<'t>(file: &Reference, rows: Var<'t>, key: &str) -> Var<'t> {
    (rows * rows.tape().constant(&intrinsics(&file.data(key)), rows.shape())).sum()
}

/// Camera-to-world 4x4 matrices of world-to-camera rows `[R | T]`.
fn inverse(rows: &[f32]) -> Vec<f32> {
    let one = |m: &[f32]| {
        let r = |i: usize, j: usize| f64::from(m[4 * j + i]);
        let t = |i: usize| -(0..3).map(|j| r(i, j) * f64::from(m[4 * j + 3])).sum::<f64>();
        let row = |i: usize| [r(i, 0) as f32, r(i, 1) as f32, r(i, 2) as f32, t(i) as f32];
        [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]].concat()
    };
    rows.chunks_exact(12).flat_map(one).collect()
}

pub fn check_cameras(file: &Reference, cameras: &Cameras<'_>) {
    file.check("out.extrinsics", &cameras.w2c.value());
    file.check("out.intrinsics", &matrices(&cameras.intrinsics.value(), 1.0));
}

pub fn run(file: Reference) -> Reference {
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
        gauge: Gauge::Free,
    };
    let (height, width) = (file.size("image_h"), file.size("image_w"));
    let mut params = Params::<f32>::new();
    let head = CameraHead::new(Builder::new(&mut params, 0).scope("camera_head"), config);
    file.load(&mut params);
    let tape = Tape::new();
    let tokens = file.leaf(&tape, "in.tokens");
    let [scenes, views] = [tokens.shape()[0], tokens.shape()[1]];
    let estimates = head.forward(Context::new(&tape, &params), tokens.slice(2, 0, 1).reshape([scenes, views, dim]));
    let mut loss = tape.scalar(0.0);
    for (i, estimate) in estimates.iter().enumerate() {
        file.check(&format!("out.pose{i}"), &estimate.code.value());
        loss = loss + file.weighted(estimate.code, &format!("cot.pose{i}"));
    }
    let last = estimates.last().expect("at least one iteration").code;
    let cameras = weaver_pose::cameras(last, height, width);
    check_cameras(&file, &cameras);
    file.check("out.c2w", &inverse(&cameras.w2c.value()));
    let size = [width, height, width, height].map(|n| n as f32);
    let normalised: Vec<f32> = cameras.intrinsics.value().iter().zip(size.iter().cycle()).map(|(k, n)| k / n).collect();
    file.check("out.intrinsics_normalised", &matrices(&normalised, 1.0));
    loss = loss + file.weighted(cameras.w2c, "cot.extrinsics");
    loss = loss + weighted_intrinsics(&file, cameras.intrinsics, "cot.intrinsics");
    loss.backward();
    file.check_grad("grad.in.tokens", tokens);
    file.check_params(&params, &tape);
    file
}
