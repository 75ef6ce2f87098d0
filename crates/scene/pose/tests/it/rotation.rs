use proptest::prelude::*;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_autograd::{Real, Tape, Var};
use weaver_fixtures::Fixture;
use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;
use weaver_pose::{quaternion_product, rotation_from_xyzw, xyzw_from_rotation};

/// Quaternions of lengths between 0.4 and 1.8 or so, away from 0.
fn quaternions(seed: u64, count: usize) -> Input {
    let mut q = Input::normal(seed, [count, 4]);
    for row in q.data.chunks_mut(4) {
        let length = row.iter().map(|c| c * c).sum::<f64>().sqrt();
        row.iter_mut().for_each(|c| *c *= (0.4 + length / 2.0) / length);
    }
    q
}

#[test]
fn parity() {
    let file = Fixture::open("ops.safetensors");
    let compare = |name: &str, input: &str, f: for<'t> fn(Var<'t, f32>) -> Var<'t, f32>| {
        let tape = Tape::new();
        let x = file.leaf(&tape, &format!("{name}.in.{input}"));
        let y = f(x);
        file.assert_close(&format!("{name}.out"), &y.value());
        y.backward_with(&file.f32(&format!("{name}.cot")));
        file.assert_close(&format!("{name}.grad.{input}"), &x.grad().unwrap());
    };
    compare("quat_to_mat_camera", "q", rotation_from_xyzw);
    compare("mat_to_quat", "m", xyzw_from_rotation);
}

fn unit<T: Real>(v: &[T]) -> Vec<f64> {
    let length = v.iter().map(|c| c.to_f64() * c.to_f64()).sum::<f64>().sqrt();
    let sign = if v[3] < T::ZERO { -1.0 } else { 1.0 };
    v.iter().map(|c| sign * c.to_f64() / length).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 16))]

    #[test]
    fn gradients(seed in 0u64..1_000_000, count in 0usize..4) {
        let (a, b) = (quaternions(seed, count), quaternions(seed + 1, count));
        gradcheck(std::slice::from_ref(&a), |x| vec![rotation_from_xyzw(x[0])]);
        gradcheck(&[a.clone(), b], |x| vec![quaternion_product(x[0], x[1])]);
        // Rotation matrices moved off the manifold: the nine entries are independent for the op.
        let tape = Tape::new();
        let mut m = rotation_from_xyzw(tape.constant(&a.data, a.shape)).to_vec();
        m.iter_mut().zip(Input::normal(seed + 2, [count, 9]).data).for_each(|(m, n)| *m += 0.01 * n);
        gradcheck(&[Input::new(&m, [count, 3, 3])], |x| vec![xyzw_from_rotation(x[0])]);
    }

    #[test]
    fn agrees_with_geometry(seed in 0u64..1_000_000) {
        let tape = Tape::<f64>::new();
        let (a, b) = (quaternions(seed, 1), quaternions(seed + 1, 1));
        let pose = |q: &[f64]| Pose::from_wxyz([q[3], q[0], q[1], q[2]], DVec3::ZERO);
        let near = |found: &[f64], expected: &[f64]| {
            assert!(found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-12), "{found:?} {expected:?}");
        };
        let (qa, qb) = (tape.constant(&a.data, [4]), tape.constant(&b.data, [4]));
        let rows = |p: Pose| p.rotation.transpose().to_cols_array();
        near(&rotation_from_xyzw(qa).value(), &rows(pose(&a.data)));
        let both = quaternion_product(qa, qb);
        near(&rotation_from_xyzw(both).value(), &rows(pose(&a.data).compose(&pose(&b.data))));
        near(&xyzw_from_rotation(rotation_from_xyzw(qa)).value(), &unit(&a.data));
    }
}

/// Where w is 0, nothing is turned around.
#[test]
fn a_half_turn_keeps_its_sign() {
    let tape = Tape::<f64>::new();
    for axis in 0..3 {
        let turn: Vec<f64> = (0..9)
            .map(|i| {
                if i % 4 > 0 {
                    0.0
                } else if i / 4 == axis {
                    1.0
                } else {
                    -1.0
                }
            })
            .collect();
        let q = xyzw_from_rotation(tape.constant(&turn, [3, 3])).to_vec();
        assert!((0..4).all(|i| q[i] == if i == axis { 1.0 } else { 0.0 }), "{axis}: {q:?}");
    }
}

/// Half turns, where w vanishes and each of the other components in turn is the largest.
#[test]
fn every_branch_of_the_inverse() {
    let tape = Tape::<f64>::new();
    for q in [[0.9, 0.1, 0.2, 0.3], [0.1, -0.9, 0.2, 0.3], [0.1, 0.2, 0.9, -0.3], [0.1, 0.2, 0.3, -0.9]] {
        let back = xyzw_from_rotation(rotation_from_xyzw(tape.constant(&q, [4]))).to_vec();
        for (found, expected) in back.iter().zip(unit(&q)) {
            assert!((found - expected).abs() < 1e-14, "{q:?}: {back:?}");
        }
    }
}
