use crate::strategies::{distance, pose, vector};
use proptest::prelude::*;
use weaver_geometry::glam::DVec3;
use weaver_geometry::pose_code::{TANGENT_OFFSET, decode, encode};
use weaver_geometry::{Camera, Intrinsics, NotRigid, Pose, axes};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 10))]

    #[test]
    fn inverse_and_compose(a in pose(), b in pose(), x in vector(3.0)) {
        prop_assert!((a.inverse().apply(a.apply(x)) - x).length() < 1e-12);
        prop_assert!((a.compose(&b).apply(x) - a.apply(b.apply(x))).length() < 1e-12);
        prop_assert!(a.apply(a.center()).length() < 1e-12);
        let own = a.relative_to(&a);
        prop_assert!(distance(&own.rotation, &Pose::IDENTITY.rotation) < 1e-12 && own.translation.length() < 1e-12);
    }

    #[test]
    fn rows_round_trip(a in pose()) {
        let back = Pose::from_rows(&a.rows()).unwrap();
        prop_assert!(distance(&a.rotation, &back.rotation) < 1e-14);
        prop_assert_eq!(a.translation, back.translation);
    }

    #[test]
    fn opengl_round_trip(a in pose(), x in vector(3.0)) {
        let gl = axes::to_opengl(&a);
        // The same point: right stays, up is minus down, back is minus forward.
        let seen = gl.inverse().apply(x);
        prop_assert!((a.apply(x) - DVec3::new(seen.x, -seen.y, -seen.z)).length() < 1e-12);
        let back = axes::from_opengl(&gl);
        prop_assert!(distance(&a.rotation, &back.rotation) < 1e-14);
        prop_assert!((a.translation - back.translation).length() < 1e-12);
    }

    #[test]
    fn pose_code_round_trip(pose in pose(), fx in 20.0..200.0f64, fy in 20.0..200.0f64, stretch in 0.1..3.0f64) {
        let intrinsics = Intrinsics { fx, fy, cx: 32.0, cy: 24.0 };
        let camera = Camera { pose, intrinsics, width: 64, height: 48 };
        let mut code = encode(&camera);
        for q in &mut code[3..7] { *q *= -stretch; }
        let back = decode(code, 64, 48, 0.0);
        prop_assert!(distance(&pose.rotation, &back.pose.rotation) < 1e-12);
        prop_assert_eq!(pose.translation, back.pose.translation);
        prop_assert!((back.intrinsics.fx - fx).abs() < 1e-9 && (back.intrinsics.fy - fy).abs() < 1e-9);
        let offset = decode(code, 64, 48, TANGENT_OFFSET).intrinsics;
        prop_assert!((offset.fx - 32.0 / (32.0 / fx + 1e-3)).abs() < 1e-9);
        prop_assert!((offset.fy - 24.0 / (24.0 / fy + 1e-3)).abs() < 1e-9);
    }
}

#[test]
fn pose_code_order() {
    // A quarter turn about x, twice as wide as high.
    let pose = Pose::from_wxyz([1.0, 1.0, 0.0, 0.0], DVec3::new(1.0, 2.0, 3.0));
    let intrinsics = Intrinsics { fx: 50.0, fy: 50.0, cx: 50.0, cy: 25.0 };
    let code = encode(&Camera { pose, intrinsics, width: 100, height: 50 });
    let half = 0.5f64.sqrt();
    let expected = [1.0, 2.0, 3.0, half, 0.0, 0.0, half, 2.0 * 0.5f64.atan(), std::f64::consts::FRAC_PI_2];
    for (a, b) in code.iter().zip(expected) {
        assert!((a - b).abs() < 1e-12, "{code:?}");
    }
}

#[test]
fn matrices_that_are_not_rigid() {
    let rows = |scale: f64, last: f64, t: f64| [[scale, 0.0, 0.0, t], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, last, 0.0]];
    assert!(Pose::from_rows(&rows(1.0, 1.0, 5.0)).is_ok());
    assert!(Pose::from_rows(&rows(1.0 + 1e-5, 1.0, 5.0)).is_ok());
    assert!(matches!(Pose::from_rows(&rows(1.01, 1.0, 0.0)), Err(NotRigid::Deviation(d)) if d > 0.02));
    assert_eq!(Pose::from_rows(&rows(1.0, -1.0, 0.0)), Err(NotRigid::Mirror));
    assert_eq!(Pose::from_rows(&rows(1.0, 1.0, f64::NAN)), Err(NotRigid::NotFinite));
    assert!(matches!(Pose::from_rows(&rows(1e300, 1.0, 0.0)), Err(NotRigid::Deviation(_))));
    assert!(matches!(Pose::from_rows(&[[0.0; 4]; 3]), Err(NotRigid::Deviation(_))));
}
