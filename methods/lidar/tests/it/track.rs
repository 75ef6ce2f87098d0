//! Odometry through a hall.

use crate::hall::{scan, sweep};
use weaver_geometry::Pose;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_lidar::{
    Error, LoopSettings, Lost, MapSettings, Odometry, Scan, SurfelCamera, TrackSettings, trajectory_errors,
};

fn at(t: f64) -> Pose {
    Pose::new(DMat3::from_rotation_z(0.04 * t), DVec3::new(0.15 * t, 0.04 * t, 0.0))
}

fn path(n: usize) -> Vec<Pose> {
    (0..n).map(|i| at(i as f64)).collect()
}

fn odometry(given: Option<Vec<Pose>>) -> Odometry {
    let camera = SurfelCamera::spherical([256, 32], [-0.51, 0.51]);
    let map = MapSettings { iterations: 30, density: 1.0, ..Default::default() };
    let track = TrackSettings { farthest: 0.5, ..Default::default() };
    Odometry::new(&camera, [0.3, 60.0], map, track, given).unwrap()
}

#[test]
fn a_path_is_found() {
    let path = path(8);
    let mut odometry = odometry(None);
    let mut keyframes = 0;
    for (i, pose) in path.iter().enumerate() {
        let tracked = odometry.add(&scan(pose, 64, 512), "hall").unwrap();
        assert_eq!((tracked.scan, tracked.lost, &tracked.without_ranges), (i, None, &None));
        keyframes += usize::from(tracked.map.is_some());
    }
    let errors = trajectory_errors(odometry.poses(), &path);
    assert!(errors.ate < 0.02, "{errors:?}");
    assert!((2..5).contains(&keyframes), "{keyframes}");
}

/// The sensor moves during its sweeps; a long run would reveal an error that feeds itself.
///
/// Promise (results): a lidar's motion during a sweep is undone, and a resumed run has the same frames.
#[test]
fn sweeps_of_a_moving_sensor_are_undone() {
    const SCANS: usize = 24;
    let sweeps: Vec<Scan> = (0..SCANS).map(|i| sweep(|t| at(i as f64 + t), 64, 512)).collect();
    let error = |deskew: bool| {
        let camera = SurfelCamera::spherical([256, 32], [-0.51, 0.51]);
        let map = MapSettings { iterations: 10, density: 1.0, ..Default::default() };
        let track = TrackSettings { farthest: 0.5, deskew, ..Default::default() };
        let mut odometry = Odometry::new(&camera, [0.3, 60.0], map, track, None).unwrap();
        sweeps.iter().for_each(|sweep| drop(odometry.add(sweep, "sweep").unwrap()));
        for keyframe in odometry.mapper().keyframes() {
            let again = odometry.frame(keyframe.scan, &sweeps[keyframe.scan], "sweep").unwrap().with_normals();
            assert_eq!(again, keyframe.frame, "a resumed run has other frames");
        }
        trajectory_errors(odometry.poses(), &path(SCANS)).ate
    };
    let (with, without) = (error(true), error(false));
    assert!(with < 0.5 * without, "{with} {without}");
}

#[test]
fn given_poses_are_kept() {
    let path = path(4);
    let mut odometry = odometry(Some(path.clone()));
    path.iter().for_each(|pose| drop(odometry.add(&scan(pose, 64, 512), "hall").unwrap()));
    assert_eq!(odometry.poses(), path);
}

#[test]
fn what_is_restored_goes_on_to_the_same_bits() {
    let path = path(6);
    let (mut whole, mut first) = (odometry(None), odometry(None));
    for (i, pose) in path.iter().enumerate() {
        whole.add(&scan(pose, 64, 512), "hall").unwrap();
        if i < 4 {
            first.add(&scan(pose, 64, 512), "hall").unwrap();
        }
    }
    let mut second = odometry(None);
    second.restore(first.state().clone(), &scan(&path[0], 64, 512), "hall");
    second.mapper_mut().restore(first.mapper().state().clone());
    second.refer().unwrap();
    path[4..].iter().for_each(|pose| drop(second.add(&scan(pose, 64, 512), "hall").unwrap()));
    assert_eq!(whole.poses(), second.poses());
    assert_eq!(whole.mapper().surfels(), second.mapper().surfels());
}

#[test]
fn scans_that_cannot_be_used_change_nothing() {
    let mut odometry = odometry(None);
    let error = odometry.add(&Scan::default(), "empty.bin").unwrap_err();
    assert!(matches!(error, Error::NoPoints { .. }), "{error}");
    assert!(odometry.poses().is_empty());
    odometry.add(&scan(&Pose::IDENTITY, 64, 512), "hall").unwrap();
    // Another place altogether: three lost scans end the tracking.
    let sphere = |r: f32| -> Scan {
        let points = scan(&Pose::IDENTITY, 64, 512).points;
        let on = |p: [f32; 3]| {
            let length = p.iter().map(|x| x * x).sum::<f32>().sqrt();
            p.map(|x| r * x / length)
        };
        Scan::new(points.into_iter().map(on).collect())
    };
    for i in 0..3 {
        let tracked = odometry.add(&sphere(40.0), "sphere").unwrap();
        assert!(tracked.lost.is_some() && odometry.ended() == (i == 2), "{tracked:?}");
    }
}

/// A scan of which too little fits is lost: it keeps the predicted pose and is no keyframe.
///
/// Promise (fits): a scan with few matching points is lost, and rightly tracked ones are not.
#[test]
fn a_scan_of_which_little_fits_is_lost() {
    let camera = SurfelCamera::spherical([256, 32], [-0.51, 0.51]);
    let map = MapSettings { iterations: 5, density: 1.0, ..Default::default() };
    let tracked = |lost_fitness| {
        let track = TrackSettings { farthest: 0.01, lost_fitness, ..Default::default() };
        let mut odometry = Odometry::new(&camera, [0.3, 60.0], map.clone(), track, None).unwrap();
        odometry.add(&scan(&at(0.0), 64, 512), "hall").unwrap();
        odometry.add(&scan(&at(1.0), 64, 512), "hall").unwrap()
    };
    let kept = tracked(TrackSettings::default().lost_fitness);
    assert!(kept.lost.is_none() && kept.map.is_some() && kept.fitness < 0.99, "{kept:?}");
    let lost = tracked(0.99);
    assert_eq!(lost.lost, Some(Lost::LittleFits((100.0 * kept.fitness) as u32)));
    assert_eq!((lost.pose, lost.fitness, lost.map), (Pose::IDENTITY, kept.fitness, None));
    assert!(lost.lost.unwrap().to_string().starts_with("only "));
}

/// Given poses need no tracking, which therefore never ends.
///
/// Promise of `bad_files_cost_a_scan_each`.
#[test]
fn scans_with_poses_are_taken_to_the_last() {
    let mut odometry = odometry(Some(path(6)));
    odometry.add(&scan(&at(0.0), 64, 512), "hall").unwrap();
    (1..5).for_each(|_| drop(odometry.skip()));
    assert!(!odometry.ended());
    odometry.add(&scan(&at(5.0), 64, 512), "hall").unwrap();
    assert_eq!(odometry.poses(), path(6));
}

/// A reference without motion has no length for errors in percent.
///
/// Promise of `what_is_undefined_is_not_given`.
#[test]
fn errors_of_a_still_reference_have_no_percent() {
    for count in [2, 5, 20] {
        let errors = trajectory_errors(&path(count), &vec![Pose::IDENTITY; count]);
        assert!(errors.rpe_percent.is_none() && errors.rpe > 0.1 && errors.length == 0.0, "{errors:?}");
        assert!(trajectory_errors(&path(count), &path(count)).rpe_percent.is_some_and(|percent| percent < 1e-9));
    }
}

#[test]
fn settings_are_checked() {
    let camera = SurfelCamera::spherical([256, 32], [-0.5, 0.5]);
    let odometry = |range, map| Odometry::new(&camera, range, map, TrackSettings::default(), None);
    let error = odometry([5.0, 3.0], MapSettings::default()).unwrap_err();
    assert_eq!(error.to_string(), "range: expected meters near < far, found 5, 3");
    let error = odometry([1.0, 3.0], MapSettings { density: 1.5, ..Default::default() }).unwrap_err();
    assert_eq!(error.to_string(), "density: expected a share above 0 up to 1, found 1.5");
}

#[test]
fn a_loop_that_closes_bends_the_trajectory() {
    // There and back, with a planted error: keyframes after the first are turned a little.
    let path: Vec<Pose> = (0..13)
        .map(|i| {
            let x = 0.4 * (6.0 - (f64::from(i) - 6.0).abs());
            Pose::new(DMat3::IDENTITY, DVec3::new(x, 0.0, 0.0))
        })
        .collect();
    let camera = SurfelCamera::spherical([256, 32], [-0.51, 0.51]);
    let run = |loops| {
        let map = MapSettings { iterations: 5, density: 0.5, ..Default::default() };
        let track = TrackSettings { farthest: 0.3, loops, ..Default::default() };
        let mut odometry = Odometry::new(&camera, [0.3, 60.0], map, track, None).unwrap();
        let closed: Vec<Option<usize>> =
            path.iter().map(|pose| odometry.add(&scan(pose, 64, 512), "hall").unwrap().closed).collect();
        (trajectory_errors(odometry.poses(), &path).ate, closed)
    };
    let settings = LoopSettings { gap: 8, reach: 1.0, ..Default::default() };
    let ((open, none), (closed, some)) = (run(None), run(Some(settings)));
    assert!(none.iter().all(Option::is_none) && some[12] == Some(0), "{some:?}");
    assert!(closed < open.max(0.01), "{closed} {open}");
}
