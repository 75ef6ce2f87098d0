use crate::strategies::{distance, pose, unit, vector};
use proptest::prelude::*;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::trajectory::{between, look_at, orbit, through};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 10))]

    #[test]
    fn looks_at(eye in vector(3.0), target in vector(3.0), up in unit()) {
        prop_assume!((eye - target).length() > 0.1);
        let pose = look_at(eye, target, up);
        prop_assert!((pose.center() - eye).length() < 1e-12);
        let seen = pose.apply(target);
        prop_assert!((seen - DVec3::Z * (eye - target).length()).length() < 1e-12);
        prop_assert!(distance(&(pose.rotation * pose.rotation.transpose()), &DMat3::IDENTITY) < 1e-12);
        prop_assert!((pose.rotation.determinant() - 1.0).abs() < 1e-12);
        let up = pose.rotation * up;
        prop_assert!(up.x.abs() < 1e-9 && up.y <= 1e-9, "{up}");
    }

    #[test]
    fn orbits(eye in vector(3.0), target in vector(3.0), count in 1usize..9) {
        let offset = eye - target;
        prop_assume!(offset.reject_from(DVec3::Y).length() > 0.1);
        let poses = orbit(eye, target, DVec3::Y, count);
        prop_assert_eq!(poses.len(), count);
        prop_assert!((poses[0].center() - eye).length() < 1e-12);
        for pose in &poses {
            prop_assert!(((pose.center() - target).length() - offset.length()).abs() < 1e-12);
            prop_assert!((pose.center().y - eye.y).abs() < 1e-12);
        }
        let step = (poses[0].center() - poses[1 % count].center()).length();
        let last = (poses[0].center() - poses[count - 1].center()).length();
        prop_assert!((step - last).abs() < 1e-12, "the circle closes evenly");
    }

    #[test]
    fn interpolates(a in pose(), b in pose(), t in 0.0..1.0f64) {
        let (total, part) = (a.angle_to(&b), a.angle_to(&between(&a, &b, t)));
        prop_assert!((part - t * total).abs() < 1e-6, "{part} {total}");
        let center = between(&a, &b, t).center();
        prop_assert!((center - a.center().lerp(b.center(), t)).length() < 1e-12);
        let path = through(&[a, b, a], 3);
        prop_assert_eq!(path.len(), 7);
        for (i, key) in [(0, a), (3, b), (6, a)] {
            prop_assert!(distance(&path[i].rotation, &key.rotation) < 1e-12);
            prop_assert!((path[i].translation - key.translation).length() < 1e-11);
        }
    }
}

#[test]
fn looking_along_up() {
    let pose = look_at(DVec3::Y * 2.0, DVec3::ZERO, DVec3::Y);
    assert!((pose.apply(DVec3::ZERO) - DVec3::Z * 2.0).length() < 1e-12);
    assert!(through(&[], 2).is_empty());
}
