//! Turns the cameras of a built-in scene by a degree each, refines them, and prints how far they come back.

use weaver_geometry::glam::DVec3;
use weaver_geometry::{Pose, Similarity, so3};
use weaver_kernels::order::median_high;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_sfm::{RefineSettings, View, refine};

fn main() {
    let scene = scene(3, &ProceduralOptions { width: 192, height: 144, views: 12 });
    let views: Vec<View<'_>> = (scene.views.iter().enumerate())
        .map(|(i, view)| {
            let mut camera = view.camera;
            let axis = DVec3::new((3.0 * i as f64).sin(), (5.0 * i as f64).cos(), (7.0 * i as f64).sin()).normalize();
            let rotation = so3::exp(axis * 1.0_f64.to_radians()) * camera.pose.rotation;
            camera.pose = Pose::new(rotation, -(rotation * camera.pose.center()));
            View::new(camera, &view.image.to_bytes(), None)
        })
        .collect();
    let found = refine(&views, &RefineSettings::default());
    println!("{} points, seen {} times, {:.2} pixels off", found.points.len(), found.observations.len(), found.error);

    let truth: Vec<Pose> = scene.views.iter().map(|view| view.camera.pose).collect();
    let median = |poses: &[Pose]| {
        let onto = Similarity::fit_poses(poses, &truth).expect("cameras at several places");
        let angle = |(pose, truth): (&Pose, &Pose)| onto.apply_to_pose(pose).angle_to(truth).to_degrees();
        let mut angles: Vec<f64> = poses.iter().zip(&truth).map(angle).collect();
        median_high(&mut angles).expect("cameras")
    };
    let given: Vec<Pose> = views.iter().map(|view| view.camera.pose).collect();
    let refined: Vec<Pose> = found.cameras.iter().map(|camera| camera.pose).collect();
    println!("median error {:.3} degrees before, {:.3} after", median(&given), median(&refined));
}
