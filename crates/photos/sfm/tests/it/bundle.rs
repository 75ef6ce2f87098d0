//! Bundle adjustment of points and cameras that a program made.

use proptest::prelude::*;
use rayon::ThreadPoolBuilder;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose, se3, so3};
use weaver_kernels::random::Stream;
use weaver_sfm::{Bundle, Covariance, Lens, Observation};

/// Cameras on an arc around a cloud of points, with all that they see.
pub fn arc(cameras: usize, points: usize, lens: Lens, stream: Stream) -> Bundle {
    let intrinsics = Intrinsics { fx: 300.0, fy: 310.0, cx: 160.0, cy: 120.0 };
    let draw = |n: usize, k: u64| 2.0 * stream.uniform::<f64>(4 * n as u64 + k) - 1.0;
    let mut bundle = Bundle {
        cameras: (0..cameras)
            .map(|i| {
                // Rolled, too: rotations about one axis alone hardly determine the principal point.
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

    /// All is found again from wrong cameras, points, focal length, distortion and principal point, through wrong
    /// observations.
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

/// All a little wrong: cameras rotated and shifted, points shifted, by this fraction of the largest disturbance.
fn disturbed(truth: &Bundle, by: f64, noise: f64, stream: Stream) -> Bundle {
    let mut bundle = truth.clone();
    for (i, camera) in bundle.cameras.iter_mut().enumerate() {
        let shift = DVec3::new(stream.normal(i as u64), stream.normal(100 + i as u64), 0.5) * by;
        camera.pose = moved(&camera.pose, by, stream.fork(i as u64));
        camera.pose.translation += shift * camera.pose.translation.length();
    }
    let stream = stream.fork(1 << 20);
    for (n, point) in bundle.points.iter_mut().enumerate() {
        *point += DVec3::new(stream.normal(3 * n as u64), stream.normal(3 * n as u64 + 1), 0.5) * by;
    }
    let stream = stream.fork(1 << 21);
    for (n, o) in bundle.observations.iter_mut().enumerate() {
        o.pixel += DVec2::new(stream.normal(2 * n as u64), stream.normal(2 * n as u64 + 1)) * noise;
    }
    bundle
}

/// A lens with everything but the principal point adjusted.
const FREE: Lens = Lens {
    log_focal: 0.0,
    k1: 0.0,
    k2: 0.0,
    shift: DVec2::ZERO,
    expected: 0.0,
    weight: 0.0,
    distortion_weight: 0.0,
    shift_weight: 0.0,
    free_focal: true,
    free_k1: true,
    free_k2: true,
    free_shift: false,
};

#[test]
fn cameras_three_percent_wrong_converge_in_few_steps() {
    for seed in 0..5 {
        let stream = Stream::new(seed, 0, "test.converge");
        let truth = arc(8, 80, Lens { free_k2: false, ..FREE }, stream);
        let mut bundle = disturbed(&truth, 0.03, 0.3, stream);
        let solved = bundle.adjust(20.0, 15);
        assert!(solved.converged, "{solved:?}");
        let mut exact = disturbed(&truth, 0.0, 0.3, stream);
        let from_truth = exact.adjust(20.0, 100);
        assert!(solved.cost < from_truth.cost * (1.0 + 1e-5), "{solved:?}, and {from_truth:?} from the truth");
    }
}

/// Lengths of the world that are all twice as long are found twice as long, to the bit.
#[test]
fn the_scale_of_the_world_does_not_matter() {
    // Directly, and by conjugate gradients.
    for (cameras, points) in [(6, 50), (210, 12)] {
        let stream = Stream::new(7, 0, "test.scale");
        let mut bundle = disturbed(&arc(cameras, points, FREE, stream), 0.01, 0.3, stream);
        let weights = |scale: f64| {
            let shift = 50.0 / (scale * scale);
            [shift, shift, shift, 30.0, 40.0, 50.0]
        };
        bundle.expected = bundle.cameras.iter().map(|c| (c.pose, weights(1.0))).collect();
        let scaled = |scale: f64| {
            let mut scaled = bundle.clone();
            scaled.cameras.iter_mut().for_each(|c| c.pose.translation *= scale);
            scaled.points.iter_mut().for_each(|p| *p *= scale);
            for (pose, of) in &mut scaled.expected {
                pose.translation *= scale;
                *of = weights(scale);
            }
            (scaled.adjust(4.0, 6), scaled)
        };
        let (one, found) = scaled(1.0);
        assert!(one.steps > 2, "{one:?}");
        for scale in [1024.0, 0.0078125] {
            let (other, again) = scaled(scale);
            assert_eq!(one, other);
            assert_eq!(found.lenses, again.lenses);
            for (a, b) in found.cameras.iter().zip(&again.cameras) {
                assert_eq!((a.pose.rotation, a.pose.translation * scale), (b.pose.rotation, b.pose.translation));
            }
            assert!(found.points.iter().zip(&again.points).all(|(a, b)| *a * scale == *b));
        }
    }
}

#[test]
fn the_same_bits_at_any_number_of_threads() {
    for (cameras, points) in [(20, 900), (210, 100)] {
        let stream = Stream::new(8, 0, "test.threads");
        let bundle = disturbed(&arc(cameras, points, FREE, stream), 0.01, 0.3, stream);
        let with = |threads: usize| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let mut bundle = bundle.clone();
            let solved = pool.install(|| bundle.adjust(4.0, 3));
            (solved, bundle.cameras, bundle.points, bundle.lenses)
        };
        let one = with(1);
        assert_eq!(one.0.steps, 3);
        assert_eq!(one, with(2));
        assert_eq!(one, with(3));
    }
}

#[test]
fn both_coefficients_of_distortion_are_found() {
    for (k1, k2) in [(-0.15, 0.05), (0.1, -0.08), (0.02, 0.0)] {
        let stream = Stream::new(9, 0, "test.distortion");
        let lens = Lens { k1, k2, log_focal: 0.03, ..FREE };
        let mut bundle = disturbed(&arc(6, 120, lens, stream), 0.005, 0.0, stream);
        bundle.lenses[0] = FREE;
        assert!(bundle.adjust(4.0, 100).converged);
        let found = bundle.lenses[0];
        let error = [found.k1 - k1, found.k2 - k2, found.log_focal - 0.03].map(f64::abs);
        assert!(error.iter().all(|e| *e < 1e-4), "{found:?}, not {lens:?}");
        // The prior pulls.
        bundle.lenses[0].distortion_weight = 1e7;
        bundle.adjust(4.0, 100);
        assert!(bundle.lenses[0].k1.abs() < 0.5 * k1.abs(), "{:?}", bundle.lenses[0]);
    }
}

proptest! {
    #[test]
    fn undistorting_is_the_inverse_of_projecting(
        k1 in -0.3..0.3f64, k2 in -0.2..0.2f64, log_focal in -0.2..0.2f64, x in -0.7..0.7f64, y in -0.7..0.7f64,
    ) {
        let lens = Lens { k1, k2, log_focal, shift: DVec2::new(0.01, -0.02), ..Lens::default() };
        let bundle = arc(1, 0, lens, Stream::new(0, 0, "test.undistort"));
        let camera = bundle.cameras[0];
        let r2 = x * x + y * y;
        // Up to where the lens folds back.
        let grows = (0..=100).all(|i| {
            let s = r2 * 0.01 * f64::from(i);
            1.0 + 3.0 * k1 * s + 5.0 * k2 * s * s > 0.05
        });
        prop_assume!(grows);
        let seen = lens.project(&camera, DVec3::new(2.0 * x, 2.0 * y, 2.0));
        let pinhole = bundle.camera(0).intrinsics.project(DVec3::new(x, y, 1.0));
        let found = lens.undistort(&camera, seen);
        prop_assert!(found.distance(pinhole) < 1e-8, "{found}, not {pinhole}");
        let straight = Lens { k1: 0.0, k2: 0.0, ..lens };
        prop_assert_eq!(straight.undistort(&camera, seen), seen);
    }

    /// Even at pixels where nothing can be seen, the result is a pixel.
    #[test]
    fn undistorting_is_finite(k1 in -1.0..1.0f64, k2 in -1.0..1.0f64, x in -1000.0..1000.0f64, y in -1000.0..1000.0f64) {
        let lens = Lens { k1, k2, ..Lens::default() };
        let camera = arc(1, 0, lens, Stream::new(0, 0, "test.undistort")).cameras[0];
        prop_assert!(lens.undistort(&camera, DVec2::new(x, y)).is_finite());
    }
}

/// Errors of cameras after the best movement of the world, to first order: rotations in radians, and centers.
fn after_alignment(found: &Bundle, truth: &Bundle) -> Vec<[DVec3; 2]> {
    let n = truth.cameras.len();
    let centers: Vec<DVec3> = truth.cameras.iter().map(|c| c.pose.center()).collect();
    let middle = centers.iter().sum::<DVec3>() / n as f64;
    let size = (centers.iter().map(|c| c.distance_squared(middle)).sum::<f64>() / n as f64).sqrt();
    let off = |i: usize| {
        let (a, b) = (&found.cameras[i].pose, &truth.cameras[i].pose);
        // In coordinates of the world.
        let turn = b.rotation.transpose() * so3::log(&(a.rotation * b.rotation.transpose()));
        [turn, (a.center() - centers[i]) / size]
    };
    let movement = |i: usize, k: usize| {
        let from = (centers[i] - middle) / size;
        let axis = DVec3::from_array(std::array::from_fn(|j| f64::from(j == k % 3)));
        match k {
            0..3 => [DVec3::ZERO, axis],
            3..6 => [-axis, axis.cross(from)],
            _ => [DVec3::ZERO, from],
        }
    };
    let mut off: Vec<[DVec3; 2]> = (0..n).map(off).collect();
    let dot = |a: [DVec3; 2], b: [DVec3; 2]| a[0].dot(b[0]) + a[1].dot(b[1]);
    // By turns, which converges as movements hardly have anything in common.
    for k in (0..200).flat_map(|_| 0..7) {
        let (mut along, mut all) = (0.0, 0.0);
        for (i, off) in off.iter().enumerate() {
            along += dot(*off, movement(i, k));
            all += dot(movement(i, k), movement(i, k));
        }
        for (i, off) in off.iter_mut().enumerate() {
            let [turn, shift] = movement(i, k);
            *off = [off[0] - turn * (along / all), off[1] - shift * (along / all)];
        }
    }
    off.into_iter().map(|[turn, shift]| [turn, shift * size]).collect()
}

/// Points found from noisy keypoints are spread as their covariance says, and about the truth.
#[test]
fn the_covariance_is_that_of_what_is_found() {
    const DRAWS: usize = 200;
    // Pixels; several times as much, and the distortion is so uncertain that it is spread unlike a normal distribution.
    const NOISE: f64 = 0.1;
    let stream = Stream::new(10, 0, "test.covariance");
    let lens = Lens { k1: -0.1, k2: 0.05, free_shift: true, ..FREE };
    let truth = arc(6, 60, lens, stream);
    let mut spread = [0.0; 6];
    let mut expected = [0.0; 6];
    let mut mean = 0.0;
    let part = 1.0 / DRAWS as f64;
    for draw in 0..DRAWS {
        let mut bundle = disturbed(&truth, 0.0, NOISE, stream.fork(draw as u64));
        assert!(bundle.adjust(2.0, 100).converged);
        let covariance = bundle.covariance(2.0).expect("as many observations as needed");
        let square = |of: &[f64]| of.iter().map(|x| x * x).sum::<f64>();
        let found = bundle.lenses[0];
        mean += part * found.log_focal;
        let shift = found.shift - lens.shift;
        let numbers = [found.log_focal, found.k1 - lens.k1, found.k2 - lens.k2, shift.length()];
        (0..4).for_each(|i| spread[i] += part * numbers[i].powi(2));
        for off in after_alignment(&bundle, &truth) {
            spread[4] += part * off[0].length_squared();
            spread[5] += part * off[1].length_squared();
        }
        let Covariance { focal, k1, k2, shift, rotation, center, sigma } = &covariance;
        let each = [focal, k1, k2, shift, rotation, center];
        (0..6).for_each(|i| expected[i] += part * square(each[i]));
        assert!((sigma / NOISE - 1.0).abs() < 0.2, "{sigma}");
    }
    assert!(mean.abs() < 0.003, "focal lengths are {} times too long", mean.exp());
    for (name, (spread, expected)) in
        ["focal", "k1", "k2", "shift", "rotation", "center"].iter().zip(spread.iter().zip(&expected))
    {
        let ratio = (spread / expected).sqrt();
        assert!((ratio - 1.0).abs() < 0.15, "{name}: {ratio} times the deviation that is told");
    }
}

/// Fixed numbers and priors hold the world beside observations.
#[test]
fn covariance_respects_what_is_fixed_and_expected() {
    let stream = Stream::new(11, 0, "test.held");
    let mut bundle = disturbed(&arc(6, 60, Lens { free_k1: false, free_k2: false, ..FREE }, stream), 0.0, 0.5, stream);
    bundle.adjust(2.0, 100);
    let free = bundle.covariance(2.0).expect("a covariance");
    assert!(free.k1[0].is_nan() && free.shift[0].is_nan() && free.focal[0] > 0.0);
    // With two fixed, the movement that the others share with them is determined.
    let mut fixed = bundle.clone();
    (fixed.fixed[0], fixed.fixed[5]) = (true, true);
    let fixed = fixed.covariance(2.0).expect("a covariance");
    assert!(fixed.rotation[0].is_nan() && fixed.rotation[2] > 0.0 && fixed.center[2].is_finite());
    // The gauge does not concern lenses, and one camera holds no more than that.
    let mut one = bundle.clone();
    one.fixed[0] = true;
    let one = one.covariance(2.0).expect("a covariance");
    assert!((one.focal[0] / free.focal[0] - 1.0).abs() < 1e-4, "{} and {}", one.focal[0], free.focal[0]);
    assert!(fixed.focal[0] < free.focal[0]);
    // So exact are cameras expected that they are hardly uncertain.
    let mut expected = bundle.clone();
    expected.expected = bundle.cameras.iter().map(|c| (c.pose, [1e12; 6])).collect();
    let expected = expected.covariance(2.0).expect("a covariance");
    assert!(expected.rotation.iter().chain(&expected.center).all(|x| *x < 2e-6), "{expected:?}");
    // Not enough is seen.
    bundle.observations.truncate(20);
    assert_eq!(bundle.covariance(2.0), None);
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

/// Some free cameras and all points among many fixed cameras; some points are seen by fixed cameras alone.
#[test]
fn a_few_cameras_move_among_many_that_do_not() {
    let stream = Stream::new(5, 0, "test.local");
    let truth = arc(30, 60, Lens::default(), stream);
    let mut bundle = disturbed(&truth, 0.01, 0.0, stream);
    let free = |camera: usize| (10..13).contains(&camera);
    bundle.fixed = (0..30).map(|camera| !free(camera)).collect();
    for camera in (0..30).filter(|camera| !free(*camera)) {
        bundle.cameras[camera] = truth.cameras[camera];
    }
    bundle.observations.retain(|o| !free(o.camera) || o.point < 40);
    assert!(bundle.adjust(8.0, 30).converged);
    for (camera, (found, truth)) in bundle.cameras.iter().zip(&truth.cameras).enumerate() {
        assert!(found == truth || free(camera));
        assert!(found.pose.angle_to(&truth.pose) < 1e-6 && found.pose.center().distance(truth.pose.center()) < 1e-6);
    }
    assert!(bundle.points.iter().zip(&truth.points).all(|(found, truth)| found.distance(*truth) < 1e-6));
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
