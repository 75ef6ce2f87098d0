use proptest::prelude::*;
use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_geometry::{Pose, so3};
use weaver_kernels::random::Stream;
use weaver_sfm::{TwoView, rotation_only, two_view};

/// A pixel at a focal length of 400 pixels.
const PIXEL: f64 = 1.0 / 400.0;

/// A uniform direction.
fn direction(draw: Stream) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|i| draw.normal(i))).normalize()
}

/// A pose with a rotation of up to `degrees`, and a translation of length 1.
fn pose(draw: Stream, degrees: f64) -> Pose {
    let angle = degrees.to_radians() * draw.uniform::<f64>(0);
    Pose::new(so3::exp(direction(draw.fork(1)) * angle), direction(draw.fork(2)))
}

/// The parts of a scene before view i; both views see 90 degrees of it.
#[derive(Clone, Copy)]
enum Scene {
    /// Depths of 2 to 6.
    Box,
    /// The plane of these points p: n . p = 1.
    Plane(DVec3),
}

impl Scene {
    /// A point that both views see, if draw `k` hits one.
    fn point(self, draw: Stream, k: u64, pose: &Pose) -> Option<DVec3> {
        let [x, y, z] = [0, 1, 2].map(|i| draw.uniform::<f64>(3 * k + i) * 2.0 - 1.0);
        let ray = DVec3::new(x, y, 1.0);
        let depth = match self {
            Self::Box => 4.0 + 2.0 * z,
            Self::Plane(normal) => 1.0 / normal.dot(ray),
        };
        let there = pose.apply(ray * depth);
        let seen = depth > 0.1 && there.z > 0.1 && there.truncate().abs().max_element() < there.z;
        seen.then_some(ray * depth)
    }

    /// Matches of `n` points; `None` if the views hardly overlap.
    fn matches(self, draw: Stream, pose: &Pose, n: usize) -> Option<Vec<[DVec2; 2]>> {
        let points = (0..50_000).filter_map(|k| self.point(draw, k, pose)).take(n);
        let matches: Vec<_> = points.map(|x| [x, pose.apply(x)].map(|x| x.truncate() / x.z)).collect();
        (matches.len() == n).then_some(matches)
    }
}

/// Adds Gaussian noise, and replaces a share of the matches in view j by anything.
fn disturb(matches: &mut [[DVec2; 2]], draw: Stream, noise: f64, wrong: f64) {
    let (errors, place, fate) = (draw.fork(0), draw.fork(1), draw.fork(2));
    for (k, x) in (0..).zip(matches) {
        if fate.uniform::<f64>(k) < wrong {
            x[1] = DVec2::new(place.uniform(2 * k), place.uniform(2 * k + 1)) * 2.0 - 1.0;
        }
        for (i, x) in (0..).zip(x) {
            *x += DVec2::new(errors.normal(4 * k + i), errors.normal(4 * k + i + 2)) * noise;
        }
    }
}

/// Angles between rotations and between directions of translation, in radians.
fn errors(found: &Pose, truth: &Pose) -> [f64; 2] {
    let turn = so3::log(&(found.rotation * truth.rotation.transpose())).length();
    [turn, found.translation.angle_between(truth.translation)]
}

/// The pose and the matches of a seeded case, with rotations of up to 45 degrees.
fn case(
    seed: u64,
    n: usize,
    noise: f64,
    wrong: f64,
    scene: impl Fn(Stream) -> Scene,
) -> (Pose, Scene, Vec<[DVec2; 2]>) {
    let drawn = (0..).map(|try_| Stream::new(seed, try_, "two views")).find_map(|draw| {
        let (pose, scene) = (pose(draw.fork(0), 45.0), scene(draw.fork(1)));
        scene.matches(draw.fork(2), &pose, n).map(|matches| (pose, scene, matches))
    });
    let (pose, scene, mut matches) = drawn.unwrap();
    disturb(&mut matches, Stream::new(seed, 0, "noise"), noise, wrong);
    (pose, scene, matches)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]

    #[test]
    fn exact_matches_give_the_exact_pose(seed in any::<u64>()) {
        let draw = Stream::new(seed, 0, "exact");
        let truth = pose(draw.fork(0), 60.0);
        let matches = Scene::Box.matches(draw.fork(1), &truth, 60);
        prop_assume!(matches.is_some());
        let matches = matches.unwrap();
        let found = two_view(&matches, PIXEL).unwrap();
        let [turn, shift] = errors(&found.pose, &truth);
        prop_assert!(turn < 1e-6 && shift < 1e-5, "{turn} {shift}");
        prop_assert!(found.inliers.iter().all(|&inlier| inlier) && found.front == 1.0);
        prop_assert!((found.score - 60.0).abs() < 1e-6);
        // Depths belong to the points: rho is where R x_i + rho t meets the ray of view j.
        for ([x, y], rho) in matches.iter().zip(&found.depths) {
            let there = found.pose.apply(x.extend(1.0) / *rho);
            prop_assert!(*rho > 0.0 && (there.truncate() / there.z).distance(*y) < 1e-5);
        }
    }
}

#[test]
fn noise_and_wrong_matches_are_withstood() {
    let found = |seed| {
        let (truth, _, matches) = case(seed, 200, 0.5 * PIXEL, 0.3, |_| Scene::Box);
        errors(&two_view(&matches, PIXEL).unwrap().pose, &truth).map(f64::to_degrees)
    };
    let (turns, shifts): (Vec<f64>, Vec<f64>) = (0..20).map(found).map(|[turn, shift]| (turn, shift)).unzip();
    println!("rotation {turns:.3?}, translation {shifts:.3?} degrees");
    // A tenth of a degree and half a degree are usual.
    let (turn, shift) = (median(turns), median(shifts));
    assert!(turn < 0.3 && shift < 1.0, "{turn} {shift}");
}

/// The other pose that explains the same plane n . p = 1: the homography R + t n^T is also R' + t' n'^T.
///
/// With s = R^T t, its square 1 + n m^T + m n^T, m = s + |s|^2 n / 2, does not change when n and m are exchanged. Of
/// the two q = |s'|^2 that solve s' = n - q m / 2, one is for a view from behind the plane.
///
/// Source: Longuet-Higgins, "The reconstruction of a plane surface from two perspective projections" (1986).
fn other_of_plane(pose: &Pose, n: DVec3) -> Pose {
    let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z);
    let s = pose.rotation.transpose() * pose.translation;
    let m = s + n * s.length_squared() / 2.0;
    let b = 1.0 + n.dot(m);
    let root = (b * b - n.length_squared() * m.length_squared()).sqrt();
    let turned = n - m * (b - root) / m.length_squared();
    let homography = pose.rotation + outer(pose.translation, n);
    let rotation = homography * (DMat3::IDENTITY + outer(turned, m)).inverse();
    Pose::new(rotation, (rotation * turned).normalize())
}

#[test]
fn planes_give_one_of_their_two_poses() {
    let plane = |draw: Stream| {
        let tilt = DVec3::new(draw.uniform::<f64>(0) - 0.5, draw.uniform::<f64>(1) - 0.5, 1.0);
        Scene::Plane(tilt.normalize() / 3.0)
    };
    let (mut right, mut either) = (0, 0);
    for seed in 0..20 {
        let (truth, scene, matches) = case(seed, 200, 0.5 * PIXEL, 0.0, plane);
        let Scene::Plane(normal) = scene else { unreachable!("planes are drawn") };
        let other = other_of_plane(&truth, normal);
        assert!((other.rotation.determinant() - 1.0).abs() < 1e-9);
        let found = two_view(&matches, PIXEL).unwrap().pose;
        let near = |pose| errors(&found, pose)[0].to_degrees() < 2.0;
        right += usize::from(near(&truth));
        either += usize::from(near(&truth) || near(&other));
    }
    println!("{right} of 20 right, {either} one of two");
    assert!(right > 10 && either >= 18, "{right} of 20 right, {either} one of two");
}

#[test]
fn a_pure_rotation_is_recognized() {
    for seed in 0..10 {
        let (mut truth, _, _) = case(seed, 8, 0.0, 0.0, |_| Scene::Box);
        truth.translation = DVec3::ZERO;
        let mut matches = Scene::Box.matches(Stream::new(seed, 1, "turn"), &truth, 100).unwrap();
        let (rotation, explained) = rotation_only(&matches, PIXEL);
        assert_eq!(explained, 100);
        assert!(so3::log(&(rotation * truth.rotation.transpose())).length() < 1e-6);
        // Any translation fits: the small remainder that it explains gives the rotation away.
        assert!(two_view(&matches, PIXEL).unwrap().parallax < PIXEL);

        disturb(&mut matches, Stream::new(seed, 0, "noise"), 0.5 * PIXEL, 0.3);
        let (rotation, explained) = rotation_only(&matches, PIXEL);
        assert!(so3::log(&(rotation * truth.rotation.transpose())).length() < 0.005);
        assert!((50..=85).contains(&explained), "{explained}");
    }
}

#[test]
fn a_translation_is_no_pure_rotation() {
    let (_, _, matches) = case(3, 200, 0.5 * PIXEL, 0.0, |_| Scene::Box);
    let (_, explained) = rotation_only(&matches, PIXEL);
    let found = two_view(&matches, PIXEL).unwrap();
    let inliers = found.inliers.iter().filter(|&&inlier| inlier).count();
    assert!(2 * explained < inliers && found.parallax > 0.05, "{explained} {inliers} {}", found.parallax);
}

#[test]
fn too_few_matches_are_none() {
    let (_, _, matches) = case(0, 8, 0.0, 0.0, |_| Scene::Box);
    assert!(two_view(&matches, PIXEL).is_some());
    assert_eq!(two_view(&matches[..7], PIXEL), None);
    assert_eq!(two_view(&[], PIXEL), None);
    assert_eq!(rotation_only(&[], PIXEL), (DMat3::IDENTITY, 0));
}

#[test]
fn scales_that_admit_nothing_are_none() {
    let (_, _, matches) = case(0, 20, PIXEL, 0.0, |_| Scene::Box);
    for tau in [0.0, f64::NAN] {
        assert_eq!(two_view(&matches, tau), None);
        assert_eq!(rotation_only(&matches, tau).1, 0);
    }
}

#[test]
fn matches_that_are_not_finite_are_outliers() {
    let (truth, _, clean) = case(1, 60, 0.0, 0.0, |_| Scene::Box);
    let spoiled = [DVec2::NAN, DVec2::new(f64::INFINITY, 0.0), DVec2::splat(1e200), DVec2::new(0.0, f64::NAN)];
    let mut matches = clean.clone();
    matches.extend(spoiled.map(|x| [x, DVec2::ZERO]));
    matches.extend(spoiled.map(|x| [DVec2::ZERO, x]));
    let TwoView { pose, inliers, depths, .. } = two_view(&matches, PIXEL).unwrap();
    assert!(errors(&pose, &truth)[0] < 1e-6);
    assert!(
        inliers
            .iter()
            .zip(&depths)
            .enumerate()
            .all(|(k, (inlier, rho))| *inlier == (k < 60) && (*rho > 0.0) == (k < 60))
    );
    assert_eq!(rotation_only(&matches, PIXEL), rotation_only(&clean, PIXEL));
    // Seven are left, or none.
    assert_eq!(two_view(&matches[53..], PIXEL), None);
    assert_eq!(two_view(&[[DVec2::NAN; 2]; 20], PIXEL), None);
}

#[test]
fn the_same_matches_twice_are_no_trouble() {
    // No rotation or translation is determined by one match, however often it is there.
    let matches = [[DVec2::new(0.1, 0.2), DVec2::new(0.1, 0.2)]; 30];
    if let Some(found) = two_view(&matches, PIXEL) {
        assert!(found.pose.rotation.is_finite() && found.pose.translation.is_finite());
        assert!(found.score.is_finite() && found.parallax.is_finite());
    }
    assert_eq!(rotation_only(&matches, PIXEL).1, 30);
}
