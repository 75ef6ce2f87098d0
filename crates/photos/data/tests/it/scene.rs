//! Separation, order, and the training frame, on cameras placed by hand.

use weaver_data::{Scene, Tuple, View};
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_io::Image;

/// A camera at `center`, turned about the vertical.
pub fn view(name: &str, center: DVec3, turn: f64, held_out: bool) -> View {
    let rotation = DMat3::from_rotation_y(turn);
    View {
        name: name.into(),
        image: Image { width: 4, height: 3, pixels: vec![0.5; 36] },
        camera: Camera {
            pose: Pose::new(rotation, -(rotation * center)),
            intrinsics: Intrinsics { fx: 4.0, fy: 4.0, cx: 2.0, cy: 1.5 },
            width: 4,
            height: 3,
        },
        inside: None,
        instances: None,
        depth: None,
        time: None,
        number: None,
        extras: Default::default(),
        held_out,
    }
}

/// Cameras along a line at x = 0, 1, 2, ...; every fourth held out, from the first.
pub fn line(n: usize) -> Scene {
    let views = (0..n).map(|i| view(&i.to_string(), DVec3::X * i as f64, 0.0, i.is_multiple_of(4))).collect();
    Scene {
        name: "line".into(),
        views,
        points: Vec::new(),
        visible: vec![Vec::new(); n],
        scale: None,
        remarks: Vec::new(),
    }
}

#[test]
fn separation_is_distance_over_the_median_plus_angle() {
    let mut scene = line(3);
    scene.views[2] = view("2", DVec3::X * 5.0, 0.3, false);
    // Pairwise distances 1, 5, 4: the median is 4.
    assert!((scene.separation(0, 1) - 0.25).abs() < 1e-12);
    assert!((scene.separation(0, 2) - (1.25 + 0.3)).abs() < 1e-12);
    assert_eq!(scene.separation(1, 2), scene.separation(2, 1));
    // An even number of pairs takes the middle of two: distances 1 1 1 2 2 3.
    assert!((line(4).separation(0, 3) - 2.0).abs() < 1e-12);
}

#[test]
fn cameras_that_only_turn_differ_by_their_angle() {
    let mut scene = line(2);
    scene.views[1] = view("1", DVec3::ZERO, 0.4, false);
    assert!((scene.separation(0, 1) - 0.4).abs() < 1e-12);
}

#[test]
fn the_nearest_come_in_order_with_ties_by_index() {
    let scene = line(9);
    let all: Vec<usize> = (0..9).rev().collect();
    assert_eq!(scene.nearest(4, &all, 5), [3, 5, 2, 6, 1]);
    assert_eq!(scene.nearest(4, &[4], 5), [0_usize; 0]);
    assert_eq!(scene.training_views(), [1, 2, 3, 5, 6, 7]);
    assert_eq!(scene.held_out_views(), [0, 4, 8]);
}

/// The central view is nearest to the other training views.
#[test]
fn the_central_view_is_nearest_to_others() {
    // Training views 1, 2, 3, 5: 2 and 3 tie, the held-out ones do not count.
    assert_eq!(line(6).central_view(), 2);
}

/// The training frame starts at camera 0 with seen points at mean distance 1.
#[test]
fn the_training_frame_is_normalized() {
    let mut scene = line(6);
    scene.views[2] = view("2", DVec3::new(0.3, -0.2, 0.5), 0.7, false);
    scene.points = vec![DVec3::new(0.3, -0.2, 2.5), DVec3::new(0.3, -0.2, 8.5), DVec3::new(9.0, 9.0, 9.0)];
    scene.visible[2] = vec![0];
    scene.visible[1] = vec![0, 1];
    scene.visible[5] = vec![2];
    let tuple = Tuple { scene: 0, context: vec![2, 1, 3], targets: vec![5] };
    let posed = scene.normalized(&tuple).unwrap();
    // Points at distance 2 and 8; the one that only the target sees does not count.
    assert!((posed.scale - 1.0 / 5.0).abs() < 1e-12);
    let seen = scene.points_seen(&tuple.context, posed.scale);
    assert_eq!(seen.visible, [vec![0], vec![0, 1], vec![]]);
    assert_eq!(seen.positions.len(), 2);
    assert!((seen.mean_distance(DVec3::ZERO).unwrap() - 1.0).abs() < 1e-12);
    assert_eq!(posed.poses.len(), 4);
    assert_eq!(posed.poses[0], Pose::IDENTITY);
    for (pose, view) in posed.poses.iter().zip([2, 1, 3, 5]) {
        let camera = &scene.views[view].camera.pose;
        let reference = scene.views[2].camera.pose;
        for &point in &scene.points {
            let expected = camera.apply(point) * posed.scale;
            let found = pose.apply(reference.apply(point) * posed.scale);
            assert!(expected.distance(found) < 1e-12);
        }
    }
}

#[test]
fn without_points_the_scale_must_be_given() {
    let mut scene = line(6);
    let tuple = Tuple { scene: 0, context: vec![1, 2], targets: vec![3] };
    let message = scene.normalized(&tuple).unwrap_err().to_string();
    assert!(message.contains("scene line") && message.contains("scene_scale"), "{message}");
    scene.scale = Some(4.0);
    assert_eq!(scene.normalized(&tuple).unwrap().scale, 0.25);
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        scene.scale = Some(bad);
        assert!(scene.normalized(&tuple).is_err());
    }
}

#[test]
fn too_few_views_are_named() {
    assert!(line(7).check_training(4).is_ok());
    let message = line(6).check_training(4).unwrap_err().to_string();
    assert_eq!(message, "scene line: training views: expected at least 5, found 4");
    assert!(line(6).check_evaluation(4).is_ok());
    for n in [0, 1] {
        assert!(line(n).check_training(4).is_err());
        assert!(line(n).check_evaluation(4).is_err());
    }
}
