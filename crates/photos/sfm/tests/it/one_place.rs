//! Photos taken by turning on the spot, and by cameras that step aside a little.

use weaver_geometry::glam::{DMat3, DVec3};
use weaver_kernels::random::Stream;
use weaver_sfm::{Confidence, Estimate, EstimateOptions, LeftOut, Photo, estimate};

const SIZE: [usize; 2] = [240, 320];
const FOCAL: f64 = 0.9 * 320.0;
/// Distance and half the width of two painted walls, the nearer one before the middle of the other.
const WALLS: [(f64, f64); 2] = [(4.0, f64::INFINITY), (4.0 / 3.0, 0.4)];

/// Gray of a wall that has something of every size to find again.
fn paint(wall: usize, u: f64, v: f64) -> f64 {
    let knot = |size: f64, x: f64, y: f64| {
        let number = ((x + 5000.0) * 10_000.0 + y + 5000.0) as u64;
        Stream::new(wall as u64, size as u64, "test.paint").uniform::<f64>(number)
    };
    let octave = |size: f64| {
        let (x, y) = (u * size, v * size);
        let (i, j) = (x.floor(), y.floor());
        let [a, b] = [x - i, y - j].map(|t| t * t * (3.0 - 2.0 * t));
        let row = |j: f64| knot(size, i, j) * (1.0 - a) + knot(size, i + 1.0, j) * a;
        row(j) * (1.0 - b) + row(j + 1.0) * b
    };
    0.3 * octave(2.0) + 0.3 * octave(5.0) + 0.4 * octave(11.0)
}

/// The view of a camera at a place, turned; only a camera that is not at the origin sees the nearer wall.
fn view(center: DVec3, turn: DMat3, noise: f64, number: u64) -> Photo<'static> {
    let [height, width] = SIZE;
    let stream = Stream::new(9, number, "test.noise");
    let pixel = |i: usize| {
        let at = |n: usize, of: usize| (n as f64 + 0.5 - of as f64 / 2.0) / FOCAL;
        let ray = turn * DVec3::new(at(i % width, width), at(i / width, height), 1.0);
        let meets = |(depth, half): (f64, f64)| {
            let p = center + ray * ((depth - center.z) / ray.z);
            (p.x.abs() < half && p.y.abs() < half).then_some(p / depth)
        };
        let near = meets(WALLS[1]).filter(|_| center != DVec3::ZERO).map(|p| paint(1, 4.0 * p.x, 4.0 * p.y));
        let far = || meets(WALLS[0]).map_or(0.5, |p| paint(0, 4.0 * p.x, 4.0 * p.y));
        let gray = 255.0 * near.unwrap_or_else(far) + noise * stream.normal::<f64>(i as u64);
        [gray.round().clamp(0.0, 255.0) as u8; 3]
    };
    Photo::new((0..height * width).flat_map(pixel).collect::<Vec<u8>>(), SIZE)
}

/// So many views, some degrees apart, each so far aside from the one before, in distances of the farther wall.
fn views(count: usize, degrees: f64, noise: f64, aside: f64) -> Vec<Photo<'static>> {
    let each = (0..count).map(|number| {
        let step = number as f64 - (count as f64 - 1.0) / 2.0;
        let turn = DMat3::from_rotation_y((degrees * step).to_radians()) * DMat3::from_rotation_x(0.1 * step.sin());
        view(4.0 * aside * DVec3::new(step, 0.25 * step.cos(), 0.0), turn, noise, number as u64)
    });
    each.collect()
}

fn found(count: usize, degrees: f64, noise: f64, aside: f64) -> Estimate {
    estimate(&views(count, degrees, noise, aside), &EstimateOptions { keypoints: 1000, ..EstimateOptions::default() })
}

/// Promise (fits): photos taken by turning on the spot get no cameras, with the reason.
#[test]
fn turning_on_the_spot_is_refused() {
    for (count, degrees, noise) in [(6, 3.0, 0.0), (9, 5.0, 2.0)] {
        let found = found(count, degrees, noise, 0.0);
        assert_eq!(found.cameras, vec![Err(LeftOut::OnePlace); count], "{count} photos, {degrees} degrees apart");
        assert!(found.points.is_empty() && found.confidence() == Confidence::None);
    }
}

/// Promise (fits): a camera that moves aside by a hundredth of the distance is placed, and good.
#[test]
fn a_hundredth_of_the_distance_aside_is_good() {
    for (count, degrees, noise) in [(6, 3.0, 0.0), (9, 5.0, 2.0)] {
        let found = found(count, degrees, noise, 0.01);
        assert_eq!(found.confidence(), Confidence::Good, "{count} photos: {:?}", found.uncertainty);
        let focal = found.cameras[0].expect("a camera").intrinsics.fx;
        assert!((focal / FOCAL - 1.0).abs() < 0.01, "{focal} instead of {FOCAL}");
    }
}

/// Photos that join a scene by a turn alone stay in it.
///
/// Promise (fits): photos that only turn within a scene keep their place.
#[test]
fn a_scene_keeps_photos_that_only_turn() {
    let mut photos = views(7, 3.0, 1.0, 0.01);
    let steps = [-2.0_f64, 2.0, 4.0].map(|degrees| DMat3::from_rotation_y(degrees.to_radians()));
    photos.extend((0..).zip(steps).map(|(n, turn)| view(DVec3::X * 0.12, turn, 1.0, 100 + n)));
    let found = estimate(&photos, &EstimateOptions { keypoints: 1000, ..EstimateOptions::default() });
    assert!(found.cameras.iter().all(Result::is_ok), "{:?}", found.cameras);
}
