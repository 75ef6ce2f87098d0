//! Lays one camera path over another: `cargo run --release -p weaver-geometry --example align`.
//!
//! Reconstructions of one place differ by a similarity: where the origin is, which way is up, how long a meter is. An
//! orbit is turned, shrunk, moved and shaken by 1 %; the similarity is found again from the camera centers. Prints the
//! errors.

use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Pose, Similarity, trajectory::orbit};

fn main() {
    let truth = orbit(DVec3::new(4.0, -1.5, 0.0), DVec3::ZERO, DVec3::NEG_Y, 40);
    let moved = Similarity {
        scale: 0.3,
        rotation: DMat3::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 2.0),
        translation: DVec3::new(10.0, -3.0, 7.0),
    };
    // Incommensurable frequencies shake as well as chance does, and the same everywhere.
    let shake = |i: usize| 0.01 * DVec3::new((7.3 * i as f64).sin(), (3.1 * i as f64).cos(), (5.7 * i as f64).sin());
    let shaken = |(i, pose): (usize, &Pose)| {
        let pose = moved.apply_to_pose(pose);
        Pose::new(pose.rotation, pose.translation + shake(i))
    };
    let reconstruction: Vec<Pose> = truth.iter().enumerate().map(shaken).collect();

    let root_mean_square = |poses: &[Pose]| {
        let squares = poses.iter().zip(&truth).map(|(a, b)| a.center().distance_squared(b.center()));
        (squares.sum::<f64>() / truth.len() as f64).sqrt()
    };
    let found = Similarity::fit_poses(&reconstruction, &truth).expect("cameras at several places");
    let aligned: Vec<Pose> = reconstruction.iter().map(|pose| found.apply_to_pose(pose)).collect();
    let turn = aligned.iter().zip(&truth).map(|(a, b)| a.angle_to(b).to_degrees()).fold(0.0, f64::max);
    println!("40 cameras, 4.3 from the middle");
    println!("before: centers {:.4} off", root_mean_square(&reconstruction));
    println!("after:  centers {:.4} off, axes at most {turn:.3} degrees", root_mean_square(&aligned));
    println!("scale {:.5}, expected {:.5}", found.scale, 1.0 / moved.scale);
}
