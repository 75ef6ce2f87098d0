//! The covariance against stored references, the plain rotation of weaver-geometry, and finite differences.

use crate::scene::relative;
use proptest::prelude::*;
use safetensors::SafeTensors;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_geometry::Pose;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_splat::covariance;

/// Quaternions of lengths between 0.4 and 1.8 or so, away from 0.
fn quaternions(seed: u64, n: usize) -> Input {
    let mut q = Input::normal(seed, [n, 4]);
    for row in q.data.chunks_mut(4) {
        let length = row.iter().map(|c| c * c).sum::<f64>().sqrt();
        row.iter_mut().for_each(|c| *c *= (0.4 + length / 2.0) / length);
    }
    q
}

/// Each of these numbers is below 1e-5, twenty times the error of 32-bit arithmetic alone.
#[test]
fn equals_the_official_code() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../tests/fixtures/ops.safetensors");
    let bytes = std::fs::read(path).expect("the fixture is part of the repository");
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let read = |key: &str| -> Vec<f32> {
        let tensor = file.tensor(&format!("covariance.{key}")).unwrap();
        tensor.data().chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
    };
    // The file has quaternions xyzw.
    let scalar_first = |q: &[f32]| -> Vec<f32> { q.chunks(4).flat_map(|q| [q[3], q[0], q[1], q[2]]).collect() };
    let check = |key: &str, found: &[f32], expected: &[f32]| {
        let expected: Vec<f64> = expected.iter().map(|x| f64::from(*x)).collect();
        let peak = expected.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        let worst = found.iter().zip(&expected).fold(0.0, |m: f64, (a, b)| m.max((f64::from(*a) - b).abs()));
        let errors = [relative(found, &expected, 0.0), worst / peak];
        assert!(errors.iter().all(|error| *error <= 1e-5), "{key}: {errors:?}");
    };
    let (scales, quats) = (read("in.s"), scalar_first(&read("in.q")));
    let (n, tape) = (scales.len() / 3, Tape::<f32>::new());
    let (scales, quats) = (tape.leaf(&scales, [n, 3]), tape.leaf(&quats, [n, 4]));
    let found = covariance(scales, quats);
    check("out", &found.value(), &read("out"));
    found.backward_with(&read("cot"));
    check("grad.s", &scales.grad().unwrap(), &read("grad.s"));
    check("grad.q", &quats.grad().unwrap(), &scalar_first(&read("grad.q")));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 20, failure_persistence: None, ..Default::default() })]

    #[test]
    fn passes_gradcheck(seed: u64, n in 0_usize..5) {
        gradcheck(&[Input::uniform(seed, 0.2, 1.5, [n, 3]), quaternions(!seed, n)], |x| vec![covariance(x[0], x[1])]);
    }

    /// Over more than one chunk of Gaussians.
    #[test]
    fn agrees_with_geometry(seed: u64) {
        let n = 300;
        let (scales, quats) = (Input::uniform(seed, 0.2, 1.5, [n, 3]), quaternions(!seed, n));
        let tape = Tape::<f64>::new();
        let found = covariance(tape.constant(&scales.data, [n, 3]), tape.constant(&quats.data, [n, 4])).to_vec();
        for ((found, s), q) in found.chunks(9).zip(scales.data.chunks(3)).zip(quats.data.chunks(4)) {
            let r = Pose::from_wxyz([q[0], q[1], q[2], q[3]], DVec3::ZERO).rotation;
            let s = DMat3::from_diagonal(DVec3::from_slice(s));
            let expected = (r * s * s * r.transpose()).to_cols_array();
            prop_assert!(found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-13), "{found:?} {expected:?}");
        }
    }
}

#[test]
fn a_quaternion_of_zeros_is_no_rotation() {
    let tape = Tape::<f64>::new();
    let (scales, quats) = (tape.leaf(&[1.0, 2.0, 3.0], [1, 3]), tape.leaf(&[0.0; 4], [1, 4]));
    let found = covariance(scales, quats);
    assert_eq!(found.to_vec(), [1.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 9.0]);
    found.sum().backward();
    assert_eq!((scales.grad().unwrap(), quats.grad().unwrap()), (vec![2.0, 4.0, 6.0], vec![0.0; 4]));
}
