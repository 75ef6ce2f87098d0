//! Projections of lenses: there and back, and their derivatives.

use crate::strategies::unit;
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::lens::{self, Lens};
use weaver_geometry::{Camera, Distortion, Pose};

fn fisheyes() -> impl Strategy<Value = Distortion> {
    let k = [-0.03..0.03f64, -0.01..0.01, -0.002..0.002, -0.0002..0.0002];
    let more = [-2e-5..2e-5f64, -2e-6..2e-6];
    let small = || [-0.003..0.003f64, -0.003..0.003];
    let thin = (k.clone(), small(), small()).prop_map(|(k, p, s)| Distortion::ThinPrismFisheye { k, p, s });
    let aria = (k.clone(), more, small(), [-0.003..0.003f64, -3e-4..3e-4, -0.003..0.003, -3e-4..3e-4])
        .prop_map(|([a, b, c, d], [e, f], p, s)| Distortion::RadTanThinPrism { k: [a, b, c, d, e, f], p, s });
    prop_oneof![
        k.prop_map(|k| Distortion::Fisheye { k }),
        thin,
        aria,
        (0.3..2.8f64).prop_map(|omega| Distortion::Fov { omega })
    ]
}

fn lenses() -> impl Strategy<Value = Lens> {
    let radial = ([-0.25..0.25f64, -0.08..0.08], [-0.004..0.004f64, -0.004..0.004])
        .prop_map(|([k1, k2], p)| Distortion::Radial { k: [k1, k2, 0.0, 0.0, 0.0, 0.0], p });
    prop_oneof![
        3 => fisheyes().prop_map(Lens::Distorted),
        1 => radial.prop_map(Lens::Distorted),
        1 => Just(Lens::Equirectangular),
        1 => Just(Lens::EQUIDISTANT),
    ]
}

/// A direction well within what a lens sees: its angle from the axis is `part` of the last one.
fn within(lens: Lens, around: f64, part: f64) -> DVec3 {
    let angle = part * lens.projection().last_angle().min(2.6);
    (DVec2::from_angle(around) * angle.sin()).extend(angle.cos())
}

proptest! {
    #[test]
    fn directions_go_there_and_back(lens in lenses(), around in -3.1..3.1f64, part in 0.0..0.8f64, length in 0.1..9.0f64) {
        let (projection, ray) = (lens.projection(), within(lens, around, part));
        let at = projection.project(length * ray).expect("a direction that the lens sees");
        let back = projection.ray(at).expect("a place with a direction");
        prop_assert!(back.distance(ray) < 1e-8, "{lens:?}: {ray} came back as {back}");
    }

    #[test]
    fn jacobians_are_central_differences(lens in lenses(), around in -3.1..3.1f64, part in 0.0..0.8f64, length in 0.1..9.0f64) {
        let (projection, ray) = (lens.projection(), length * within(lens, around, part));
        // At the poles of a sphere longitudes have no derivative, and half around they jump.
        prop_assume!(lens != Lens::Equirectangular || ray.x.abs().min(ray.x.hypot(ray.z)) > 0.05 * length);
        let found = projection.jacobian(ray).expect("a direction that the lens sees");
        let step = 1e-6 * length;
        for (i, axis) in DVec3::AXES.into_iter().enumerate() {
            let place = |by: f64| projection.project(ray + by * axis).unwrap();
            let slope = (place(step) - place(-step)) / (2.0 * step);
            let own = DVec2::new(found[0][i], found[1][i]);
            prop_assert!(own.distance(slope) < 1e-6 * (1.0 + slope.length()), "{lens:?} at {ray}: {own}, not {slope}");
        }
    }

    #[test]
    fn wide_lenses_see_beyond_a_right_angle(distortion in fisheyes(), direction in unit()) {
        let projection = Lens::Distorted(distortion).projection();
        prop_assume!(projection.last_angle() > FRAC_PI_2);
        // Before the camera the two ways to the same formula agree.
        if direction.z > 0.05 {
            let flat = distortion.distort(direction.truncate() / direction.z);
            prop_assert!(projection.project(direction).unwrap().distance(flat) < 1e-9 * (1.0 + flat.length()));
        }
        prop_assert_eq!(projection.sees(direction), projection.project(direction).is_some());
    }
}

#[test]
fn near_the_axis_lenses_are_pinholes() {
    let near = DVec3::new(1e-7, -2e-7, 1.0);
    for lens in [Lens::PINHOLE, Lens::EQUIDISTANT, Lens::Equirectangular] {
        let projection = lens.projection();
        assert!(projection.project(near).unwrap().distance(near.truncate()) < 1e-12, "{lens:?}");
        let jacobian = projection.jacobian(DVec3::new(0.0, 0.0, 2.0)).unwrap();
        assert!(jacobian[0].distance(DVec3::X / 2.0) + jacobian[1].distance(DVec3::Y / 2.0) < 1e-12, "{lens:?}");
    }
}

#[test]
fn a_lens_sees_nothing_beyond_its_fold() {
    let folding = Lens::Distorted(Distortion::Fisheye { k: [-0.1, 0.0, 0.0, 0.0] }).projection();
    // a - 0.1 a^3 is largest where 0.3 a^2 = 1.
    assert!((folding.last_angle() - (1.0 / 0.3_f64).sqrt()).abs() < 4e-3);
    assert_eq!(folding.project(DVec3::new(1.0, 0.0, -0.7)), None);
    assert_eq!(folding.ray(DVec2::new(1.3, 0.0)), None);
    let pinhole = Lens::PINHOLE.projection();
    assert_eq!(pinhole.project(DVec3::new(0.1, 0.0, -1.0)), None);
    assert_eq!(Lens::Equirectangular.projection().ray(DVec2::new(3.2, 0.0)), None);
    for lens in [Lens::PINHOLE, Lens::EQUIDISTANT, Lens::Equirectangular] {
        assert_eq!(lens.projection().project(DVec3::ZERO), None, "{lens:?}");
        assert_eq!(lens.projection().project(DVec3::NAN), None, "{lens:?}");
    }
}

#[test]
fn fields_of_view_are_full_angles() {
    let of = |lens: Lens, intrinsics, width, height| {
        lens.field_of_view(&Camera { pose: Pose::IDENTITY, intrinsics, width, height })
    };
    assert!((of(Lens::EQUIDISTANT, lens::fisheye(PI, 90, 90), 90, 90) - PI).abs() < 1e-9);
    assert!((of(Lens::Equirectangular, lens::equirectangular(90, 45), 90, 45) - 2.0 * PI).abs() < 1e-9);
    let mut pinhole = lens::fisheye(1.0, 90, 60);
    (pinhole.fx, pinhole.fy) = (45.0, 45.0);
    assert!((of(Lens::PINHOLE, pinhole, 90, 60) - FRAC_PI_2).abs() < 1e-9);
}
