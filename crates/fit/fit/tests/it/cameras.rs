//! Refinement of cameras: derivatives, location of photos, recovery of disturbed cameras.

use crate::scenes;
use weaver_fit::{Fit, FitSettings, Photo, StrategyKind, init, motion};
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::lens::{Lens, LensCamera};
use weaver_geometry::{Camera, Intrinsics, Pose, se3, so3};
use weaver_kernels::order::median_high;
use weaver_kernels::random::Stream;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::PointCloud;

const SIZE: [usize; 2] = [96, 72];
const VIEWS: usize = 10;
const STEPS: usize = 240;

/// The motion of pixels is the derivative of their projection.
#[test]
fn motion_of_pixels_is_a_derivative() {
    let intrinsics = Intrinsics { fx: 90.0, fy: 80.0, cx: 47.0, cy: 33.0 };
    let camera = Camera { pose: Pose::IDENTITY, intrinsics, width: SIZE[0], height: SIZE[1] };
    let (pixel, depth, step) = (DVec2::new(12.5, 60.5), 3.7, 1e-5);
    for lens in [None, Some(Lens::EQUIDISTANT), Some(Lens::Equirectangular)] {
        let camera = LensCamera::new(camera, lens);
        let point = camera.point(pixel, depth).unwrap();
        let rows = motion(&camera, pixel, depth).unwrap();
        for i in 0..6 {
            let seen = |by: f64| {
                let twist: [f64; 6] = std::array::from_fn(|j| if i == j { by } else { 0.0 });
                let [a, b, c, d, e, f] = twist;
                camera.see(se3::exp(DVec3::new(a, b, c), DVec3::new(d, e, f)).apply(point)).unwrap().0
            };
            let difference = (seen(step) - seen(-step)) / (2.0 * step);
            let close = |a: f64, b: f64| (a - b).abs() < 1e-5 * a.abs().max(1.0);
            assert!(close(difference.x, rows[0][i]), "{lens:?} {i}: {difference} {rows:?}");
            assert!(close(difference.y, rows[1][i]), "{lens:?} {i}: {difference} {rows:?}");
        }
    }
}

/// Photos of a procedural scene, and points of its depth maps.
fn world() -> (Vec<Photo>, PointCloud) {
    let scene = scene(3, &ProceduralOptions { width: SIZE[0], height: SIZE[1], views: VIEWS });
    let mut points = PointCloud::default();
    let photos = (scene.views.iter())
        .map(|view| {
            let rgb = view.image.to_bytes();
            for (at, depth) in view.depth.iter().flatten().enumerate().filter(|(at, z)| at % 17 == 0 && **z > 0.0) {
                let pixel = DVec2::new((at % SIZE[0]) as f64 + 0.5, (at / SIZE[0]) as f64 + 0.5);
                points.positions.push(view.camera.unproject(pixel, f64::from(*depth)).as_vec3().to_array());
                points.colors.push([rgb[3 * at], rgb[3 * at + 1], rgb[3 * at + 2]]);
            }
            Photo { name: view.name.clone(), camera: view.camera, rgb: rgb.into(), mask: None, lens: None }
        })
        .collect();
    (photos, points)
}

/// The pose turned by some degrees about a random axis, and moved by as many percent of this distance in a random
/// direction.
fn disturbed(pose: &Pose, degrees: f64, distance: f64, stream: Stream) -> Pose {
    let direction = |s: Stream| DVec3::new(s.normal(0), s.normal(1), s.normal(2)).normalize();
    let rotation = so3::exp(direction(stream.fork(0)) * degrees.to_radians()) * pose.rotation;
    let center = pose.center() + direction(stream.fork(1)) * 0.01 * degrees * distance;
    Pose::new(rotation, -(rotation * center))
}

fn settings(refine: bool) -> FitSettings {
    let mut settings = FitSettings { steps: STEPS, gaussians: 4000, sh_degree: 0, ..FitSettings::default() };
    settings.density.strategy = StrategyKind::Keep;
    settings.density.initial_part = 1.0;
    settings.poses.refine = refine;
    settings
}

fn fitted(photos: &[Photo], points: &PointCloud, settings: FitSettings, steps: usize) -> Fit {
    let initial = init::from_points(points, &settings).expect("there are points");
    let mut fit = Fit::new(photos.to_vec(), &initial, settings).expect("photos and settings are sound");
    (0..steps).for_each(|_| {
        fit.step().expect("a step");
    });
    fit
}

/// Median over pairs of cameras of the angle that the turn from one to the other is wrong by, degrees. (Centers along
/// an arc of a few cameras leave the rotation of a similarity too free to compare poses after it.)
fn median_error(found: &[Pose], photos: &[Photo]) -> f64 {
    let truth: Vec<Pose> = photos.iter().map(|photo| photo.camera.pose).collect();
    let angle = |i: usize, j: usize| found[i].relative_to(&found[j]).angle_to(&truth[i].relative_to(&truth[j]));
    let pairs = (0..truth.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    let mut angles: Vec<f64> = pairs.map(|(i, j)| angle(i, j).to_degrees()).collect();
    median_high(&mut angles).expect("pairs")
}

fn cameras(fit: &Fit) -> Vec<Pose> {
    (0..fit.photos()).map(|i| fit.camera(i).pose).collect()
}

/// The error after matching is tenths of a degree.
#[test]
fn slightly_disturbed_cameras_come_back() {
    let (truth, points) = world();
    let mut photos = truth.clone();
    let stream = Stream::new(1, 0, "test.disturbed");
    for (i, photo) in photos.iter_mut().enumerate() {
        photo.camera.pose = disturbed(&photo.camera.pose, 0.3, 6.0, stream.fork(i as u64));
    }
    let before: Vec<Pose> = photos.iter().map(|photo| photo.camera.pose).collect();
    let fit = fitted(&photos, &points, settings(true), STEPS);
    let (before, after) = (median_error(&before, &truth), median_error(&cameras(&fit), &truth));
    assert!(before > 0.3 && after < 0.6 * before, "from {before} to {after} degrees");
}

/// True cameras stay and photos are located in the scene.
#[test]
fn true_cameras_stay() {
    let (photos, points) = world();
    let mut fit = fitted(&photos, &points, settings(true), STEPS);
    let error = median_error(&cameras(&fit), &photos);
    assert!(error < 0.3, "true cameras drifted by {error} degrees");
    let (photo, camera) = (fit.photo(4).clone(), fit.camera(4));
    let start = Camera { pose: disturbed(&camera.pose, 1.0, 6.0, Stream::new(2, 0, "test.locate")), ..camera };
    let found = fit.locate(&photo, start, 30).expect("located");
    let angle = found.pose.angle_to(&camera.pose).to_degrees();
    assert!(angle < 0.1, "located {angle} degrees from the camera");
}

/// Refinement goes on from a state and at any number of threads to the same bits.
#[test]
fn refinement_resumes_to_the_same_bits() {
    let (photos, points) = world();
    let short = FitSettings { steps: 40, ..settings(true) };
    let whole = fitted(&photos, &points, short.clone(), 40);
    let half = fitted(&photos, &points, short.clone(), 20);
    let mut other = fitted(&photos, &points, short.clone(), 0);
    other.restore(&half.state()).expect("a state of the same photos");
    let single = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    single.install(|| {
        (0..20).for_each(|_| {
            other.step().expect("a step");
        })
    });
    assert_eq!(cameras(&whole), cameras(&other));
    assert_eq!(whole.gaussians(), other.gaussians());
    assert_ne!(cameras(&whole), photos.iter().map(|p| p.camera.pose).collect::<Vec<_>>(), "cameras did move");
}

/// One camera that was placed far from all others does not enlarge the scene, which rates of means are parts of.
///
/// Promise (fits): a camera that was placed far from all others does not change the rates of a fit.
#[test]
fn a_camera_astray_is_no_measure_of_the_scene() {
    let cloud = scenes::cloud(20, 3);
    let mut photos = scenes::photos(19, &cloud);
    let extent = |photos: &[Photo]| {
        Fit::new(photos.to_vec(), &cloud, scenes::plain(StrategyKind::Keep, 1, 20)).unwrap().extent()
    };
    let before = extent(&photos);
    let mut astray = photos[4].clone();
    astray.camera = scenes::camera(30.0, 0.0);
    photos.push(astray);
    let after = extent(&photos);
    assert!(after < 2.5 * before, "{before}, {after}");
    // Of few photos, or where several are out there, the far ones are part of the capture.
    assert!(extent(&photos[10..]) > 3.0 * before);
    photos.push(photos[19].clone());
    assert!(extent(&photos) > 3.0 * before);
    // Cameras at one place have no extent of their own: a part of the distance is taken.
    photos.iter_mut().for_each(|photo| photo.camera = scenes::camera(0.0, 0.0));
    assert!(extent(&photos) > 0.0);
}
