//! Cameras as matrices, rays, frames and relative poses; directions as harmonics.

use proptest::prelude::*;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_geometry::glam::{DQuat, DVec2, DVec3};
use weaver_geometry::{Intrinsics, Pose, sh};
use weaver_pose::{CameraVars, Rays, average_frame, harmonics, projections, relative_poses};

/// Poses with rotations of any size.
fn poses(seed: u64, count: usize) -> Vec<Pose> {
    let numbers = Input::normal(seed, [count, 7]).data;
    let of = |n: &[f64]| Pose {
        rotation: weaver_geometry::glam::DMat3::from_quat(DQuat::from_xyzw(n[0], n[1], n[2], n[3]).normalize()),
        translation: DVec3::new(n[4], n[5], n[6]),
    };
    numbers.chunks(7).map(of).collect()
}

fn rows(poses: &[Pose]) -> Vec<f64> {
    poses.iter().flat_map(row).collect()
}

/// [R | t], row by row.
fn row(pose: &Pose) -> [f64; 12] {
    let r = pose.rotation.to_cols_array_2d();
    std::array::from_fn(|at| if at % 4 == 3 { pose.translation[at / 4] } else { r[at % 4][at / 4] })
}

fn close(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-10)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 20))]

    /// As functions of any matrices, rotations or not.
    #[test]
    fn gradients(seed in 0u64..1_000_000, views in 1usize..4, h in 1usize..4, w in 1usize..4, context in 1usize..4) {
        let cameras = [Input::normal(seed, [views, 3, 4]), Input::uniform(seed + 1, 1.0, 3.0, [views, 4])];
        gradcheck(&cameras, |x| projections(&CameraVars { viewmats: x[0], intrinsics: x[1] }, [h, w]).to_vec());
        let inputs = [
            cameras[0].clone(),
            cameras[1].clone(),
            Input::uniform(seed + 2, 0.5, 2.0, [views, h * w, 1]),
            Input::uniform(seed + 3, 0.0, 1.0, [views, 3, h, w]),
        ];
        gradcheck(&inputs, |x| {
            let rays = Rays::new(&CameraVars { viewmats: x[0], intrinsics: x[1] }, [h, w]);
            vec![rays.map(x[3]), rays.points(x[2]), rays.depth(x[2])]
        });
        gradcheck(&[Input::normal(seed, [2, views, 3, 4])], |x| relative_poses(x[0]).to_vec());
        gradcheck(&[Input::normal(seed, [views, 3])], |x| vec![harmonics(x[0])]);
        // The scale is a constant: only the frame and the turned axes are functions of all numbers.
        gradcheck(&[Input::normal(seed, [2, views, 3, 4])], |x| {
            let middle = average_frame(x[0], context.min(views));
            vec![middle.frame, middle.cameras.slice(3, 0, 3)]
        });
    }

    /// P times its inverse is 1, and P is the camera of weaver-geometry.
    #[test]
    fn projections_project(seed in 0u64..1_000_000) {
        let (pose, [height, width]) = (poses(seed, 1)[0], [6_usize, 8]);
        let k = Intrinsics { fx: 7.0, fy: 9.0, cx: 3.5, cy: 2.0 };
        let tape = Tape::<f64>::new();
        let viewmats = tape.constant(&rows(&[pose]), [1, 3, 4]);
        let intrinsics = tape.constant(&[k.fx, k.fy, k.cx, k.cy], [1, 4]);
        let [p, inverse] = projections(&CameraVars { viewmats, intrinsics }, [height, width]);
        let identity: Vec<f64> = (0..16).map(|i| f64::from(u8::from(i % 5 == 0))).collect();
        prop_assert!(close(&p.matmul(inverse).to_vec(), &identity));
        let point = pose.inverse().apply(DVec3::new(0.3, -0.2, 2.0));
        let seen = p.matmul(tape.constant(&[point.x, point.y, point.z, 1.0], [1, 4, 1])).to_vec();
        let pixel = k.project(pose.apply(point));
        prop_assert!(close(&[seen[0] / seen[2] + 0.5, seen[1] / seen[2] + 0.5], &[pixel.x / 8.0, pixel.y / 6.0]));
    }

    /// Rays as weaver-geometry has them; moments are at right angles to them, and the same from anywhere on the ray.
    #[test]
    fn rays_of_pixels(seed in 0u64..1_000_000) {
        let (pose, [height, width]) = (poses(seed, 1)[0], [2_usize, 3]);
        let k = Intrinsics { fx: 4.0, fy: 5.0, cx: 1.3, cy: 0.9 };
        let tape = Tape::<f64>::new();
        let viewmats = tape.constant(&rows(&[pose]), [1, 3, 4]);
        let intrinsics = tape.constant(&[k.fx, k.fy, k.cx, k.cy], [1, 4]);
        let rays = Rays::new(&CameraVars { viewmats, intrinsics }, [height, width]);
        let map = rays.map(tape.constant(&[0.75; 18], [1, 3, height, width])).to_vec();
        let distance = tape.constant(&[3.0; 6], [1, 6, 1]);
        let (points, depth) = (rays.points(distance).to_vec(), rays.depth(distance).to_vec());
        for (i, row) in map.chunks(12).enumerate() {
            let [o, d, m] = [0, 3, 6].map(|at| DVec3::from_slice(&row[at..]));
            let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let point = pose.inverse().apply(k.unproject(pixel, depth[i]));
            prop_assert!(point.distance(DVec3::from_slice(&points[3 * i..])) < 1e-12);
            prop_assert!((d.length() - 1.0).abs() < 1e-12 && o.distance(pose.center()) < 1e-12);
            prop_assert!(d.dot(m).abs() < 1e-12 && (o + d * 1.7).cross(d).distance(m) < 1e-11);
            prop_assert_eq!(&row[9..], &[0.5; 3]);
        }
    }

    /// A rigid motion of the world changes no relative pose, and moves the frame in the middle along.
    #[test]
    fn the_world_may_be_anywhere(seed in 0u64..1_000_000) {
        let (cameras, world) = (poses(seed, 4), poses(seed + 1, 1)[0]);
        let tape = Tape::<f64>::new();
        let of = |poses: &[Pose]| tape.constant(&rows(poses), [1, 4, 3, 4]);
        let moved: Vec<Pose> = cameras.iter().map(|pose| pose.compose(&world)).collect();
        let [before, after] = [&cameras, &moved].map(|poses| relative_poses(of(poses)).map(|x| x.to_vec()));
        prop_assert!(close(&before[0], &after[0]) && close(&before[1], &after[1]));
        let first_pair = cameras[0].relative_to(&cameras[1]);
        prop_assert!(close(&before[1][..3], &first_pair.translation.to_array()));
        let of = |poses: &[Pose]| {
            let c2w: Vec<Pose> = poses.iter().map(Pose::inverse).collect();
            average_frame(of(&c2w), 3)
        };
        let [a, b] = [of(&cameras), of(&moved)];
        prop_assert!(close(&a.cameras.to_vec(), &b.cameras.to_vec()));
        let largest = a.cameras.to_vec()[..36].iter().skip(3).step_by(4).fold(0.0, |most: f64, x| most.max(x.abs()));
        prop_assert!((largest - 1.0).abs() < 1e-12);
    }

    /// In the order of weaver-geometry's harmonics.
    #[test]
    fn harmonics_are_those_of_colors(seed in 0u64..1_000_000) {
        let d = DVec3::from_slice(&Input::normal(seed, [3]).data).normalize();
        let tape = Tape::<f64>::new();
        let found = harmonics(tape.constant(&d.to_array(), [1, 3])).to_vec();
        prop_assert!(close(&found, &sh::basis(2, d.to_array(), |x| x)[..9]), "{:?}", found);
    }
}

/// Where all centers are the same there is no scale: it is 1.
#[test]
fn a_turn_on_the_spot_has_no_scale() {
    let tape = Tape::<f64>::new();
    let spot: Vec<Pose> = poses(3, 2).into_iter().map(|pose| Pose { translation: DVec3::ZERO, ..pose }).collect();
    let middle = average_frame(tape.constant(&rows(&spot), [1, 2, 3, 4]), 2);
    assert_eq!(middle.scale.to_vec(), [1.0]);
}
