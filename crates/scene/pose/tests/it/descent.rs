//! Properties of a descent under any loss.

use proptest::array::{uniform6, uniform12};
use proptest::prelude::*;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose, se3, trajectory::look_at};
use weaver_pose::descent::{Descent, Method, twist_gradient};

fn camera() -> Camera {
    let intrinsics = Intrinsics { fx: 56.0, fy: 56.0, cx: 32.0, cy: 24.0 };
    Camera { pose: look_at(DVec3::new(1.2, -0.8, -2.6), DVec3::ZERO, DVec3::NEG_Y), intrinsics, width: 64, height: 48 }
}

fn rows(pose: &Pose) -> [f64; 12] {
    let rows = pose.rows();
    std::array::from_fn(|i| rows[i / 4][i % 4])
}

proptest! {
    #[test]
    fn a_twist_gradient_is_the_derivative(twist in uniform6(-2.0..2.0_f64), slopes in uniform12(-1.0..1.0_f64)) {
        let [a, b, c, d, e, f] = twist;
        let pose = se3::exp(DVec3::new(a, b, c), DVec3::new(d, e, f));
        // A loss that is linear in the twelve numbers.
        let loss = |pose: &Pose| rows(pose).iter().zip(&slopes).map(|(m, g)| m * g).sum::<f64>();
        let gradient = twist_gradient(&pose, &slopes);
        for (i, slope) in gradient.iter().enumerate() {
            let at = |h: f64| {
                let mut x = [0.0; 6];
                x[i] = h;
                loss(&se3::exp(DVec3::new(x[0], x[1], x[2]), DVec3::new(x[3], x[4], x[5])).compose(&pose))
            };
            let difference = (at(1e-5) - at(-1e-5)) / 2e-5;
            prop_assert!((difference - slope).abs() < 1e-8 * (1.0 + slope.abs()), "{i}: {difference} {slope}");
        }
    }

    #[test]
    fn logarithms_are_inverse(twist in uniform6(-1.5..1.5_f64)) {
        let [a, b, c, d, e, f] = twist;
        let pose = se3::exp(DVec3::new(a, b, c), DVec3::new(d, e, f));
        let (v, w) = se3::log(&pose);
        let again = se3::exp(v, w);
        prop_assert!(rows(&again).iter().zip(rows(&pose)).all(|(x, y)| (x - y).abs() < 1e-12));
    }
}

#[test]
fn rotations_stay_rotations() {
    for method in [Method::Own, Method::NoPoSplat, Method::TwoXplat] {
        let mut descent = Descent::new(method, camera(), 3.0);
        for step in 0..10_000 {
            let slopes = std::array::from_fn(|i| ((step * 12 + i) as f64).sin());
            descent.step(&slopes, [0.0; 2], 1.0);
        }
        let r = descent.camera().pose.rotation;
        let off = r.transpose() * r - DMat3::IDENTITY;
        assert!(off.to_cols_array().iter().all(|x| x.abs() < 1e-12), "{method:?}: {off}");
    }
}

#[test]
fn noise_moves_nothing() {
    let mut descent = Descent::new(Method::Own, camera(), 3.0);
    for _ in 0..100 {
        descent.step(&[1e-12; 12], [1e-12; 2], 1.0);
    }
    let (moved, guess) = (rows(&descent.camera().pose), rows(&camera().pose));
    assert!(moved.iter().zip(guess).all(|(a, b)| (a - b).abs() < 1e-9), "{moved:?} {guess:?}");
    assert_eq!(descent.camera().intrinsics, camera().intrinsics);
}

#[test]
fn focal_lengths_descend_by_their_logarithms() {
    let mut descent = Descent::new(Method::Own, camera(), 3.0);
    for _ in 0..400 {
        let k = descent.camera().intrinsics;
        descent.step(&[0.0; 12], [(k.fx / 60.0).ln(), (k.fy / 50.0).ln()], 1.0);
    }
    let k = descent.camera().intrinsics;
    assert!((k.fx - 60.0).abs() < 0.1 && (k.fy - 50.0).abs() < 0.1, "{k:?}");
    assert_eq!((k.cx, k.cy), (32.0, 24.0));
}
