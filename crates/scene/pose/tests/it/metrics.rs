use weaver_geometry::Pose;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_pose::{PoseErrors, auc};

fn pose(axis: DVec3, degrees: f64, center: DVec3) -> Pose {
    let rotation = DMat3::from_axis_angle(axis.normalize(), degrees.to_radians());
    Pose::new(rotation, -(rotation * center))
}

#[test]
fn errors_do_not_depend_on_frame_or_scale() {
    let truth = [
        pose(DVec3::X, 10.0, DVec3::ZERO),
        pose(DVec3::Y, 30.0, DVec3::new(1.0, 0.0, 0.0)),
        pose(DVec3::Z, 50.0, DVec3::new(0.0, 2.0, 1.0)),
    ];
    let frame = pose(DVec3::new(1.0, 2.0, 3.0), 77.0, DVec3::new(4.0, -5.0, 6.0));
    let moved = truth.map(|t| t.compose(&frame).scaled(3.0));
    let errors = PoseErrors::between(&moved, &truth);
    assert_eq!(errors.rotation.len(), 2);
    assert!(errors.mean_rotation().unwrap() < 1e-5 && errors.mean_translation().unwrap() < 1e-5, "{errors:?}");
}

#[test]
fn angles_are_those_put_in() {
    let truth = [Pose::IDENTITY, pose(DVec3::Y, 20.0, DVec3::X), pose(DVec3::Y, 0.0, DVec3::X)];
    let predicted = [Pose::IDENTITY, pose(DVec3::Y, 25.0, DVec3::new(1.0, 1.0, 0.0)), pose(DVec3::Y, 9.0, DVec3::Y)];
    let errors = PoseErrors::between(&predicted, &truth);
    assert!((errors.rotation[0] - 5.0).abs() < 1e-9 && (errors.rotation[1] - 9.0).abs() < 1e-9, "{errors:?}");
    let translation: Vec<f64> = errors.translation.iter().map(|t| t.unwrap()).collect();
    assert!((translation[0] - 45.0).abs() < 1e-9 && (translation[1] - 90.0).abs() < 1e-9, "{errors:?}");
    assert!((errors.mean_rotation().unwrap() - 7.0).abs() < 1e-9);
    assert_eq!(errors.largest().map(|e| e.round()).collect::<Vec<_>>(), [45.0, 90.0]);
}

#[test]
fn short_baselines_have_no_direction() {
    let truth = [Pose::IDENTITY, pose(DVec3::Y, 5.0, DVec3::X * 9e-4), pose(DVec3::Y, 5.0, DVec3::X)];
    let errors = PoseErrors::between(&[Pose::IDENTITY; 3], &truth);
    assert_eq!(errors.translation, [None, Some(180.0)]);
    assert_eq!(PoseErrors::between(&truth[..1], &truth[..1]).mean_rotation(), None);
}

/// The closed form against the integral of the recall curve it stands for.
#[test]
fn auc_is_the_integral_of_recall() {
    let errors = [0.5, 3.0, 7.0, 12.0, 80.0];
    let steps = 100_000;
    let threshold = 30.0;
    let recall = |x: f64| errors.iter().filter(|e| **e <= x).count() as f64 / errors.len() as f64;
    let integral: f64 =
        (0..steps).map(|i| recall((i as f64 + 0.5) / steps as f64 * threshold)).sum::<f64>() / steps as f64;
    assert!((auc(errors, threshold).unwrap() - integral).abs() < 1e-4);
    assert_eq!(auc([], threshold), None);
}
