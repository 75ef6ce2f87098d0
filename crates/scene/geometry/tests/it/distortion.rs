//! Lenses against numbers of OpenCV, and there and back.

use proptest::prelude::*;
use weaver_geometry::glam::DVec2;
use weaver_geometry::{Camera, Distortion, Intrinsics, Pose, Undistortion};

/// Points and where `cv2.projectPoints` and `cv2.fisheye.projectPoints` of OpenCV 5.0 put them.
///
/// Promise (photos): the distortion models of OpenCV equal OpenCV's.
#[test]
fn points_are_seen_where_opencv_sees_them() {
    let near = [[0.3, -0.2], [-0.55, 0.4], [0.05, 0.6]];
    let far = [[0.3, -0.2], [-1.5, 1.1], [0.05, 2.6]];
    let p = [0.0013, -0.0027];
    let cases = [
        (
            Distortion::Radial { k: [-0.21, 0.07, 0.0, 0.0, 0.0, 0.0], p },
            near,
            [
                [0.29117190000000004, -0.19417960000000004],
                [-0.5082708906250001, 0.3693446250000001],
                [0.045739421875000005, 0.5610893124999999],
            ],
        ),
        (
            Distortion::Radial { k: [-0.21, 0.07, 0.011, 0.12, -0.03, 0.004], p },
            near,
            [
                [0.2868324708581008, -0.1912866472387339],
                [-0.48504120794033967, 0.35245031032024704],
                [0.04398110465571526, 0.539989505868583],
            ],
        ),
        (
            Distortion::Fisheye { k: [0.03, -0.011, 0.004, -0.0007] },
            far,
            [
                [0.2889193398684913, -0.1926128932456609],
                [-0.8906335754641896, 0.653131288673739],
                [0.023825206885104467, 1.2389107580254324],
            ],
        ),
    ];
    for (lens, points, seen) in cases {
        for (point, expected) in points.into_iter().zip(seen) {
            let found = lens.distort(point.into());
            assert!(found.distance(expected.into()) < 1e-14, "{lens:?}: {point:?} at {found}, not {expected:?}");
        }
    }
}

/// Points and where `pycolmap.Camera.img_from_cam` of pycolmap 4.2.1 puts them.
///
/// Promise (photos): the fisheye models of COLMAP equal COLMAP's.
#[test]
fn points_are_seen_where_colmap_sees_them() {
    let points = [[0.3, -0.2], [-1.5, 1.1], [0.05, 2.6]];
    let (k, p) = ([0.03, -0.011, 0.004, -0.0007], [0.0013, -0.0027]);
    let cases = [
        (
            // COLMAP's order of parameters is k1, k2, p1, p2, k3, k4, sx1, sy1.
            Distortion::ThinPrismFisheye { k, p, s: [0.002, -0.003] },
            [
                [0.28824414267886844, -0.19242221682239766],
                [-0.8969629781637228, 0.6552030590197744],
                [0.022880531210013103, 1.2400629334774305],
            ],
        ),
        (
            Distortion::Fov { omega: 0.9 },
            [
                [0.30988475430807605, -0.20658983620538407],
                [-0.9524589383891962, 0.6984698881520772],
                [0.025465083933788393, 1.3241843645569964],
            ],
        ),
        (
            Distortion::RadTanThinPrism {
                k: [0.03, -0.011, 0.004, -0.0007, 0.0002, -0.0001],
                p,
                s: [0.002, -0.0005, -0.003, 0.0007],
            },
            [
                [0.2898275079066261, -0.19363501735611893],
                [-0.8822997278273749, 0.6435137664649576],
                [0.02756538949160064, 1.2240113710995035],
            ],
        ),
    ];
    for (lens, seen) in cases {
        for (point, expected) in points.into_iter().zip(seen) {
            let found = lens.distort(point.into());
            assert!(found.distance(expected.into()) < 1e-13, "{lens:?}: {point:?} at {found}, not {expected:?}");
        }
    }
}

#[test]
fn a_lens_that_folds_back_is_known_up_to_there() {
    // r - 0.3 r^3 is largest at 1 / sqrt(0.9), where it is two thirds of that.
    let lens = Distortion::radial(-0.3);
    let fold = 1.0 / 0.9_f64.sqrt();
    assert!(lens.reach() <= fold && lens.reach() > 0.98 * fold, "{}", lens.reach());
    assert!(lens.undistort(DVec2::new(0.7, 0.0)).is_some_and(|p| p.x < fold));
    assert_eq!(lens.undistort(DVec2::new(0.71, 0.0)), None);
    // The half space before an ideal fisheye is within a circle of a quarter turn.
    let fisheye = Distortion::Fisheye { k: [0.0; 4] };
    assert_eq!(fisheye.undistort(DVec2::new(0.0, 1.58)), None);
    assert!(fisheye.undistort(DVec2::new(0.0, 1.0)).unwrap().distance(DVec2::new(0.0, 1.0_f64.tan())) < 1e-12);
    // A denominator that vanishes.
    let pole = Distortion::Radial { k: [0.0, 0.0, 0.0, -1.0, 0.0, 0.0], p: [0.0; 2] };
    assert!(pole.reach() < 1.0 && pole.reach() > 0.95, "{}", pole.reach());
}

#[test]
fn no_distortion_is_none() {
    assert_eq!(Distortion::radial(0.0).or_none(), None);
    assert!(Distortion::radial(1e-9).or_none().is_some());
    assert!(Distortion::Fisheye { k: [0.0; 4] }.or_none().is_some(), "an ideal fisheye is no pinhole camera");
}

fn lens() -> impl Strategy<Value = Distortion> {
    let radial = ([-0.25..0.25f64, -0.08..0.08, -0.02..0.02], [-0.1..0.1f64, -0.03..0.03, -0.01..0.01]);
    let radial = (radial, [-0.004..0.004f64, -0.004..0.004])
        .prop_map(|(([k1, k2, k3], [k4, k5, k6]), p)| Distortion::Radial { k: [k1, k2, k3, k4, k5, k6], p });
    let fisheye = [-0.06..0.06f64, -0.02..0.02, -0.004..0.004, -0.0005..0.0005].prop_map(|k| Distortion::Fisheye { k });
    prop_oneof![radial, fisheye]
}

fn camera(width: usize, height: usize, focal: f64) -> Camera {
    let intrinsics = Intrinsics { fx: focal, fy: 0.97 * focal, cx: 0.49 * width as f64, cy: 0.52 * height as f64 };
    Camera { pose: Pose::IDENTITY, intrinsics, width, height }
}

proptest! {
    #[test]
    fn points_go_there_and_back(lens in lens(), angle in 0.0..6.3f64, part in 0.0..0.9f64) {
        let point = DVec2::from_angle(angle) * part * lens.reach().min(2.0);
        let back = lens.undistort(lens.distort(point)).expect("a point within reach");
        prop_assert!(back.distance(point) < 1e-8, "{lens:?}: {point} came back as {back}");
    }

    #[test]
    fn undone_photos_have_no_blank_border_and_lose_little(lens in lens()) {
        let large = camera(4000, 3000, 3600.0);
        let undone = Undistortion::new(large, lens).expect("a usual lens");
        let (w, h) = (4000.0, 3000.0);
        let within = |at: DVec2| at.x > -1.0 && at.y > -1.0 && at.x < w + 1.0 && at.y < h + 1.0;
        for i in 0..=50 {
            let t = f64::from(i) / 50.0;
            for at in [DVec2::new(t * w, 0.0), DVec2::new(t * w, h), DVec2::new(0.0, t * h), DVec2::new(w, t * h)] {
                let seen = undone.distorted(at);
                prop_assert!(within(seen), "{lens:?}: {at} is seen at {seen}");
                prop_assert!(undone.undistorted(seen).expect("what is seen").distance(at) < 1e-4);
            }
        }
        // A smaller photo of the same lens is undone in the same way.
        let small = Undistortion::new(camera(200, 150, 180.0), lens).expect("the same lens");
        prop_assert!((small.to.intrinsics.fx * 20.0 / undone.to.intrinsics.fx - 1.0).abs() < 1e-9);
        // A shorter lens would show blank borders, unless the middle is lost.
        let zoom = undone.to.intrinsics.fx / large.intrinsics.fx;
        let mut shorter = undone;
        shorter.to.intrinsics.fx *= 0.99;
        shorter.to.intrinsics.fy *= 0.99;
        let blank = (0..=300).map(|i| f64::from(i) / 300.0).any(|t| {
            [DVec2::new(t * w, 0.0), DVec2::new(t * w, h), DVec2::new(0.0, t * h), DVec2::new(w, t * h)]
                .into_iter().any(|at| !within(shorter.distorted(at)))
        });
        prop_assert!(blank || zoom < 0.5001, "{lens:?} at {zoom}");
    }

    #[test]
    fn another_focal_length_takes_the_same_photo(lens in lens(), factor in 0.8..1.25f64, x in -0.5..0.5f64, y in -0.4..0.4f64) {
        match lens.refocused(factor) {
            None => prop_assert!(matches!(lens, Distortion::Fisheye { .. }), "a fisheye"),
            Some(other) => {
                let at = DVec2::new(x, y);
                prop_assert!((other.distort(at / factor) * factor).distance(lens.distort(at)) < 1e-12);
            }
        }
    }
}

#[test]
fn a_distortion_that_leaves_no_photo_is_refused() {
    assert_eq!(Undistortion::new(camera(40, 30, 30.0), Distortion::radial(-40.0)), None);
    assert_eq!(Undistortion::new(camera(40, 30, 30.0), Distortion::radial(f64::NAN)), None);
}
