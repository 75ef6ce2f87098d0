//! Bundle adjustment of points and cameras that a program made.

use proptest::prelude::*;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose, se3, so3};
use weaver_kernels::random::Stream;
use weaver_sfm::{Bundle, Lens, Observation};

/// Cameras on an arc around a cloud of points, with all that they see.
pub fn arc(cameras: usize, points: usize, lens: Lens, stream: Stream) -> Bundle {
    let intrinsics = Intrinsics { fx: 300.0, fy: 310.0, cx: 160.0, cy: 120.0 };
    let draw = |n: usize, k: u64| 2.0 * stream.uniform::<f64>(4 * n as u64 + k) - 1.0;
    let mut bundle = Bundle {
        cameras: (0..cameras)
            .map(|i| {
                // Rolled, too: what turns about one axis alone hardly tells the principal point.
                let roll = 1.5 * draw(i + 10_000, 1);
                let rotation =
                    so3::exp(DVec3::Z * roll) * so3::exp(DVec3::new(0.1 * draw(i + 10_000, 0), 0.15 * i as f64, 0.0));
                let pose = Pose::new(rotation, DVec3::new(0.0, 0.0, 5.0));
                Camera { pose, intrinsics, width: 320, height: 240 }
            })
            .collect(),
        lenses: vec![lens],
        lens_of: vec![0; cameras],
        fixed: vec![false; cameras],
        points: (0..points).map(|n| DVec3::new(draw(n, 0), draw(n, 1), draw(n, 2))).collect(),
        ..Bundle::default()
    };
    for (point, position) in bundle.points.iter().enumerate() {
        for (number, camera) in bundle.cameras.iter().enumerate() {
            let pixel = lens.project(camera, camera.pose.apply(*position));
            bundle.observations.push(Observation { camera: number, point, pixel, deviation: 1.0 });
        }
    }
    bundle
}

fn moved(pose: &Pose, by: f64, stream: Stream) -> Pose {
    let v = |k: u64| DVec3::new(stream.normal(k), stream.normal(k + 1), stream.normal(k + 2)) * by;
    se3::exp(v(0), v(3)).compose(pose)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 16))]

    /// All is found again from wrong cameras, points, focal length, distortion and principal point, through wrong observations.
    #[test]
    fn what_was_seen_is_explained(seed in 0..1000u64, log_focal in -0.05..0.05f64, k1 in -0.1..0.1f64, x in -0.01..0.01f64, wrong in 0..20usize) {
        let stream = Stream::new(seed, 0, "test.bundle");
        let shift = DVec2::new(x, -0.5 * x);
        let lens = Lens { log_focal, k1, shift, free_focal: true, free_k1: true, free_shift: true, ..Lens::default() };
        let truth = arc(5, 60, lens, stream);
        let mut bundle = truth.clone();
        bundle.lenses[0] = Lens { log_focal: 0.0, k1: 0.0, shift: DVec2::ZERO, ..lens };
        bundle.fixed[0] = true;
        for (i, camera) in bundle.cameras.iter_mut().enumerate().skip(1) {
            camera.pose = moved(&camera.pose, 0.01, stream.fork(i as u64));
        }
        for (n, point) in bundle.points.iter_mut().enumerate() {
            *point += DVec3::new(stream.normal(n as u64), 0.5, -0.5) * 0.02;
        }
        for o in 0..wrong {
            bundle.observations[7 * o].pixel.x += 40.0;
        }
        for scale in [8.0, 2.0, 0.5] {
            bundle.adjust(scale, 100);
        }
        let mut errors = bundle.errors();
        errors.sort_unstable_by(f64::total_cmp);
        let right = errors.len() - wrong;
        prop_assert!(errors[right - 1] < 1.0 && errors[right / 2] < 0.05, "{:?}", &errors[right - 5..]);
        let found = bundle.lenses[0];
        prop_assert!((found.log_focal - log_focal).abs() < 5e-3 && (found.k1 - k1).abs() < 2e-2, "{found:?}, not {lens:?}");
        prop_assert!(found.shift.distance(shift) < 5e-3, "{found:?}, not {lens:?}");
        let before = bundle.observations.len();
        bundle.prune(5.0);
        prop_assert_eq!(bundle.observations.len(), before - wrong);
    }
}

#[test]
fn fixed_cameras_and_points_stay_to_the_bit() {
    let stream = Stream::new(3, 0, "test.fixed");
    let mut bundle = arc(4, 30, Lens::default(), stream);
    bundle.fixed = vec![true, false, true, true];
    bundle.fixed_points = true;
    let truth = bundle.clone();
    bundle.cameras[1].pose = moved(&bundle.cameras[1].pose, 0.02, stream);
    bundle.adjust(4.0, 30);
    for i in [0, 2, 3] {
        assert_eq!(bundle.cameras[i], truth.cameras[i]);
    }
    assert_eq!(bundle.points, truth.points);
    assert!(bundle.cameras[1].pose.angle_to(&truth.cameras[1].pose) < 1e-8);
}

#[test]
fn what_cannot_be_solved_leaves_all_as_it_was() {
    let mut bundle = arc(3, 10, Lens::default(), Stream::new(4, 0, "test.nan"));
    bundle.observations[3].pixel.x = f64::NAN;
    let before = bundle.clone();
    bundle.adjust(1.0, 10);
    assert_eq!(bundle.cameras, before.cameras);
    let mut empty = Bundle { lenses: vec![Lens::default()], ..Bundle::default() };
    assert_eq!(empty.adjust(1.0, 10).steps, 0);
}
