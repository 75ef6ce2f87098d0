use proptest::prelude::*;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_fixtures::Fixture;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::{Intrinsics, Pose};
use weaver_pose::{cameras, unproject};

/// fx, fy, cx, cy of 3x3 matrices.
fn intrinsics_of(matrices: &[f32]) -> Vec<f32> {
    matrices.chunks(9).flat_map(|k| [k[0], k[4], k[2], k[5]]).collect()
}

#[test]
fn parity() {
    let file = Fixture::open("ops.safetensors");
    let tape = Tape::new();
    let depth = file.leaf(&tape, "unproject.in.d");
    let viewmats = file.leaf(&tape, "unproject.in.e");
    let intrinsics = tape.leaf(&intrinsics_of(&file.f32("unproject.in.k")), [1, 2, 4]);
    let points = unproject(depth.reshape([1, 2, 4, 5]), viewmats, intrinsics, 0.0);
    file.assert_close("unproject.out", &points.value());
    points.backward_with(&file.f32("unproject.cot"));
    file.assert_close("unproject.grad.d", &depth.grad().unwrap());
    file.assert_close("unproject.grad.e", &viewmats.grad().unwrap());
    let dk: Vec<f32> =
        intrinsics.grad().unwrap().chunks(4).flat_map(|k| [k[0], 0.0, k[2], 0.0, k[1], k[3], 0.0, 0.0, 0.0]).collect();
    file.assert_close("unproject.grad.k", &dk);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 20))]

    #[test]
    fn gradients(seed in 0u64..1_000_000, views in 0usize..3, h in 0usize..11, w in 0usize..4, centered: bool) {
        let offset = if centered { 0.5 } else { 0.0 };
        let inputs = [
            Input::uniform(seed, 0.5, 2.0, [views, h, w]),
            Input::normal(seed + 1, [views, 3, 4]),
            Input::uniform(seed + 2, 1.0, 3.0, [views, 4]),
        ];
        gradcheck(&inputs, |x| vec![unproject(x[0], x[1], x[2], offset)]);
    }

    /// The same as the plain camera of weaver-geometry, pixel by pixel.
    #[test]
    fn agrees_with_geometry(seed in 0u64..1_000_000) {
        let (h, w) = (3, 4);
        let code = Input::uniform(seed, 0.4, 1.3, [2, 9]);
        let depth = Input::uniform(seed + 1, 0.5, 3.0, [2, h, w]);
        let tape = Tape::<f64>::new();
        let c = cameras(tape.constant(&code.data, [2, 9]), h, w);
        let points = unproject(tape.constant(&depth.data, [2, h, w]), c.viewmats, c.intrinsics, 0.5);
        for view in 0..2 {
            let g = &code.data[9 * view..][..9];
            let pose = Pose::from_wxyz([g[6], g[3], g[4], g[5]], DVec3::new(g[0], g[1], g[2]));
            let f = |size: usize, fov: f64| size as f64 / 2.0 / ((fov / 2.0).tan() + 1e-3);
            let k = Intrinsics { fx: f(w, g[8]), fy: f(h, g[7]), cx: w as f64 / 2.0, cy: h as f64 / 2.0 };
            for (i, point) in points.value().chunks(3).skip(view * h * w).take(h * w).enumerate() {
                let pixel = DVec2::new((i % w) as f64 + 0.5, (i / w) as f64 + 0.5);
                let expected = pose.inverse().apply(k.unproject(pixel, depth.data[view * h * w + i]));
                assert!((DVec3::from_slice(point) - expected).length() < 1e-12);
            }
        }
    }
}

/// The same bits on one thread and on four.
#[test]
fn any_number_of_threads() {
    let (views, h, w) = (3, 37, 21);
    let single = |input: Input| -> Vec<f32> { input.data.iter().map(|x| *x as f32).collect() };
    let depth = single(Input::uniform(1, 0.5, 2.0, [views, h, w]));
    let pose = single(Input::normal(2, [views, 3, 4]));
    let intrinsics = single(Input::uniform(3, 1.0, 3.0, [views, 4]));
    let cotangent = single(Input::normal(4, [views, h, w, 3]));
    let run = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let tape = Tape::<f32>::new();
            let x =
                [tape.leaf(&depth, [views, h, w]), tape.leaf(&pose, [views, 3, 4]), tape.leaf(&intrinsics, [views, 4])];
            let points = unproject(x[0], x[1], x[2], 0.5);
            points.backward_with(&cotangent);
            [points.to_vec(), x[0].grad().unwrap(), x[1].grad().unwrap(), x[2].grad().unwrap()]
        })
    };
    assert_eq!(run(1), run(4));
}
