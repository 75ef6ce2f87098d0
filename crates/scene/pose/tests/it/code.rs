use proptest::prelude::*;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_fixtures::Fixture;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, Pose, pose_code};
use weaver_pose::{activate, cameras, cameras_with, encode};

/// fx, fy, cx, cy of 3x3 matrices.
fn four_of(matrices: &[f32]) -> Vec<f32> {
    matrices.chunks(9).flat_map(|k| [k[0], k[4], k[2], k[5]]).collect()
}

/// 3x3 matrices with fx, fy, cx, cy in their places and `corner` in the last.
fn matrices_of(rows: &[f32], corner: f32) -> Vec<f32> {
    rows.chunks(4).flat_map(|k| [k[0], 0.0, k[2], 0.0, k[1], k[3], 0.0, 0.0, corner]).collect()
}

/// Decoding and encoding for images of 56 x 84 pixels (H x W).
#[test]
fn parity() {
    let file = Fixture::open("ops.safetensors");
    let tape = Tape::new();
    let code = file.leaf(&tape, "camera_decode_extrinsics.in.p");
    let viewmats = cameras(code, 56, 84).viewmats;
    file.assert_close("camera_decode_extrinsics.out", &viewmats.value());
    viewmats.backward_with(&file.f32("camera_decode_extrinsics.cot"));
    file.assert_close("camera_decode_extrinsics.grad.p", &code.grad().unwrap());

    let tape = Tape::new();
    let code = file.leaf(&tape, "camera_decode_intrinsics.in.p");
    let intrinsics = cameras(code, 56, 84).intrinsics;
    file.assert_close("camera_decode_intrinsics.out", &matrices_of(&intrinsics.value(), 1.0));
    intrinsics.backward_with(&four_of(&file.f32("camera_decode_intrinsics.cot")));
    file.assert_close("camera_decode_intrinsics.grad.p", &code.grad().unwrap());

    let tape = Tape::new();
    let viewmats = file.leaf(&tape, "camera_encode.in.e");
    let intrinsics = tape.leaf(&four_of(&file.f32("camera_encode.in.k")), [1, 3, 4]);
    let code = encode(viewmats, intrinsics, 56, 84);
    file.assert_close("camera_encode.out", &code.value());
    code.backward_with(&file.f32("camera_encode.cot"));
    file.assert_close("camera_encode.grad.e", &viewmats.grad().unwrap());
    file.assert_close("camera_encode.grad.k", &matrices_of(&intrinsics.grad().unwrap(), 0.0));
}

/// Cameras of all attitudes, as viewmats and intrinsics.
fn any_cameras(seed: u64, count: usize) -> [Input; 2] {
    let (q, t) = (Input::normal(seed, [count, 4]), Input::normal(seed ^ 1, [count, 3]));
    let mut viewmats = Vec::new();
    for (q, t) in q.data.chunks(4).zip(t.data.chunks(3)) {
        let r = Pose::from_wxyz([q[0], q[1], q[2], q[3]], DVec3::ZERO).rotation;
        (0..3).for_each(|i| viewmats.extend([r.row(i).x, r.row(i).y, r.row(i).z, t[i]]));
    }
    [Input::new(&viewmats, [count, 3, 4]), Input::uniform(seed ^ 2, 20.0, 80.0, [count, 4])]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 20, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn decoding(seed in 0u64..1_000_000, scenes in 0usize..3, views in 1usize..4) {
        let mut code = Input::uniform(seed, 0.3, 1.5, [scenes, views, 9]);
        code.data.iter_mut().step_by(2).for_each(|c| *c = 0.2 - *c);
        code.data.chunks_mut(9).for_each(|c| c[7..].iter_mut().for_each(|fov| *fov = 0.4 + fov.abs()));
        gradcheck(&[code], |x| {
            let c = cameras(x[0], 48, 64);
            vec![c.viewmats, c.intrinsics]
        });
    }

    #[test]
    fn encoding(seed in 0u64..1_000_000, count in 0usize..4) {
        let [mut viewmats, intrinsics] = any_cameras(seed, count);
        // Off the manifold: the nine entries are independent for the op.
        viewmats.data.iter_mut().zip(Input::normal(seed ^ 3, [count, 12]).data).for_each(|(m, n)| *m += 0.01 * n);
        gradcheck(&[viewmats, intrinsics], |x| vec![encode(x[0], x[1], 48, 64)]);
    }

    /// The same code as from the plain camera of weaver-geometry.
    #[test]
    fn encoding_agrees_with_geometry(seed in 0u64..1_000_000) {
        let [viewmats, intrinsics] = any_cameras(seed, 3);
        let tape = Tape::<f64>::new();
        let found = encode(tape.constant(&viewmats.data, viewmats.shape), tape.constant(&intrinsics.data, [3, 4]), 48, 64);
        for ((code, rows), k) in found.value().chunks(9).zip(viewmats.data.chunks(12)).zip(intrinsics.data.chunks(4)) {
            let row = |i: usize| [rows[4 * i], rows[4 * i + 1], rows[4 * i + 2], rows[4 * i + 3]];
            let pose = Pose::from_rows(&[row(0), row(1), row(2)]).unwrap();
            let intrinsics = Intrinsics { fx: k[0], fy: k[1], cx: k[2], cy: k[3] };
            let expected = pose_code::encode(&Camera { pose, intrinsics, width: 64, height: 48 });
            prop_assert!(code.iter().zip(expected).all(|(c, e)| (c - e).abs() < 1e-12), "{code:?} {expected:?}");
        }
    }
}

/// VGGT's decoding, which has no margin, and SplatWeaver's, against the formula; the margin is all that differs.
///
/// Promise (results): focal lengths are decoded with the margin on the tangent that the weights were trained with, or
/// without one.
#[test]
fn both_margins_on_the_tangent() {
    let tape = Tape::<f64>::new();
    let code = tape.leaf(&[0.1, 0.2, 0.3, 0.0, 0.6, 0.0, 0.8, 0.7, 1.1], [1, 9]);
    for (offset, found) in [(0.0, cameras_with(code, [48, 64], 0.0)), (1e-3, cameras(code, 48, 64))] {
        let focal = [32.0 / (0.55_f64.tan() + offset), 24.0 / (0.35_f64.tan() + offset)];
        let intrinsics = found.intrinsics.to_vec();
        assert!((0..2).all(|i| (intrinsics[i] - focal[i]).abs() < 1e-10), "{intrinsics:?} {focal:?}");
        assert_eq!(found.viewmats.to_vec(), cameras(code, 48, 64).viewmats.to_vec());
    }
    // Without it, decoding and encoding are inverse.
    let plain = cameras_with(code, [48, 64], 0.0);
    let back = encode(plain.viewmats, plain.intrinsics, 48, 64).to_vec();
    assert!(back.iter().zip(code.to_vec()).all(|(a, b)| (a - b).abs() < 1e-10), "{back:?}");
}

/// As a rectifier, whose derivative at 0 is 0.
#[test]
fn a_field_of_view_of_0_has_no_gradient() {
    let tape = Tape::<f64>::new();
    let code = tape.leaf(&[0.1, 0.2, 0.3, 0.0, 0.6, 0.0, 0.8, 0.0, 0.0], [1, 9]);
    activate(code).sum().backward();
    assert_eq!(code.grad().unwrap().to_vec()[7..], [0.0, 0.0]);
}

#[test]
fn the_margin_reaches_the_gradient() {
    let code = Input::new(&[0.1, 0.2, 0.3, 0.1, 0.6, 0.2, 0.8, 0.7, 1.1], [1, 9]);
    for offset in [0.0, 1e-3, 0.2] {
        gradcheck(std::slice::from_ref(&code), |x| vec![cameras_with(x[0], [48, 64], offset).intrinsics]);
    }
}
