//! Fisheye photos whose lens is found.

use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_geometry::{Camera, Distortion, Intrinsics, Pose, Similarity};
use weaver_procedural::{ProceduralOptions, Walk};
use weaver_sfm::{EstimateOptions, FisheyeLens, Photo, estimate_fisheye};

const SIZE: [usize; 2] = [240, 320];
/// Pixels of a drawn side of a cube.
const SIDE: usize = 220;

fn turn(face: usize) -> DMat3 {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let (right, down) = [(x, y), (-z, y), (-x, y), (z, y), (x, z), (x, -z)][face];
    DMat3::from_cols(right, down, right.cross(down)).transpose()
}

/// Photos along a street through a fisheye of 180 degrees across, and their poses.
fn photos(lens: &FisheyeLens, count: usize) -> (Vec<Photo<'static>>, Vec<Pose>) {
    let walk = Walk::street(3, &ProceduralOptions { width: 64, height: 48, views: 60 });
    let focal = 0.5 * SIDE as f64 / 47.5_f64.to_radians().tan();
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx: SIDE as f64 / 2.0, cy: SIDE as f64 / 2.0 };
    let taken = |number: usize| {
        let pose = walk.cameras()[3 + number].pose;
        let side = |face: usize| {
            let pose = Pose::new(turn(face), DVec3::ZERO).compose(&pose);
            walk.seen_by(&Camera { pose, intrinsics, width: SIDE, height: SIDE }, 6 * number + face).image
        };
        let sides: Vec<_> = (0..6).map(side).collect();
        let color = |i: usize| {
            let at = DVec2::new((i % SIZE[1]) as f64 + 0.5, (i / SIZE[1]) as f64 + 0.5);
            let Some(ray) = lens.ray(at) else { return [0; 3] };
            let face = (0..6).max_by(|a, b| (turn(*a) * ray).z.total_cmp(&(turn(*b) * ray).z)).unwrap();
            let at = (intrinsics.project(turn(face) * ray) - 0.5).clamp(DVec2::ZERO, DVec2::splat(SIDE as f64 - 1.001));
            let (x, y) = (at.x as usize, at.y as usize);
            let (s, t) = ((at.x - x as f64) as f32, (at.y - y as f64) as f32);
            let value = |dx: usize, dy: usize, c: usize| sides[face].pixels[3 * ((y + dy) * SIDE + x + dx) + c];
            std::array::from_fn(|c| {
                let [a, b] = [0, 1].map(|dy| (1.0 - s) * value(0, dy, c) + s * value(1, dy, c));
                (255.0 * ((1.0 - t) * a + t * b)).round() as u8
            })
        };
        (Photo::new((0..SIZE[0] * SIZE[1]).flat_map(color).collect::<Vec<u8>>(), SIZE), pose)
    };
    (0..count).map(taken).unzip()
}

/// From a focal length that is eight percent off, and no distortion.
///
/// Promise (photos): `--lens fisheye` finds focal length, principal point and distortion of a fisheye of 180 degrees.
#[test]
fn a_fisheye_of_180_degrees_is_found() {
    let k = [0.03, -0.012, 0.004, -0.0008];
    let lens = FisheyeLens { k, center: DVec2::new(162.0, 119.0), ..FisheyeLens::new(SIZE, 100.0) };
    let (mut photos, truth) = photos(&lens, 6);
    photos.iter_mut().for_each(|photo| photo.focal = Some(108.0));
    let found = estimate_fisheye(&photos, &EstimateOptions::default());
    assert!(found.cameras.iter().all(Result::is_ok), "{:?}", found.cameras);
    let camera = found.cameras[0].unwrap();
    println!("{camera:?} {:?}", found.distortion[0]);
    let Some(Distortion::Fisheye { k }) = found.distortion[0] else { panic!("{:?}", found.distortion[0]) };
    let center = DVec2::new(camera.intrinsics.cx, camera.intrinsics.cy);
    let own = FisheyeLens { k, center, ..FisheyeLens::new(SIZE, camera.intrinsics.fx) };
    assert!(center.distance(lens.center) < 1.0, "{own:?}");
    for degrees in [10.0_f64, 40.0, 70.0, 90.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let radius = |lens: &FisheyeLens| lens.project(DVec3::new(sin, 0.0, cos)).unwrap().x - lens.center.x;
        assert!((radius(&own) / radius(&lens) - 1.0).abs() < 0.01, "{degrees}: {own:?}");
    }
    let poses: Vec<Pose> = found.cameras.iter().map(|camera| camera.unwrap().pose).collect();
    let onto = Similarity::fit_poses(&poses, &truth).expect("poses");
    let extent = truth.iter().map(|pose| pose.center().distance(truth[0].center())).fold(0.0, f64::max);
    for (pose, truth) in poses.iter().zip(&truth) {
        let pose = onto.apply_to_pose(pose);
        let (turned, moved) = (pose.angle_to(truth).to_degrees(), pose.center().distance(truth.center()) / extent);
        assert!(turned < 0.3 && moved < 0.02, "{turned} degrees, {moved} of the extent");
    }
    // Points beside the camera count.
    let beside = |o: &weaver_sfm::Observation| {
        let p = found.cameras[o.camera].unwrap().pose.apply(found.points[o.point]);
        p.truncate().length().atan2(p.z).to_degrees()
    };
    assert!(found.observations.iter().any(|o| beside(o) > 80.0));
    assert!(found.error < 0.5, "{}", found.error);
}
