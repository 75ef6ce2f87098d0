//! Estimated cameras in meters, east, north and up.

use crate::claimed;
use std::path::{Path, PathBuf};
use weaver_data::{CamerasSummary, EstimatePhotosOptions, EstimatedPhotos, Placing, capture, estimate_photos, posed};
use weaver_geometry::geodesy::{Geographic, Origin};
use weaver_geometry::glam::{DMat3, DVec2, DVec3};
use weaver_geometry::{Camera, Pose};
use weaver_io::Transforms;
use weaver_procedural::{ProceduralOptions, scene};

/// Meters for a unit of the drawn scene.
const SCALE: f64 = 25.0;
const VIEWS: usize = 8;

/// Drawn photos in a folder, and their cameras.
fn photos(folder: &Path) -> (Vec<PathBuf>, Vec<Camera>) {
    let truth = scene(3, &ProceduralOptions { width: 96, height: 72, views: VIEWS });
    let write = |i: usize| {
        let path = folder.join(format!("{i}.png"));
        truth.views[i].image.write_png(&path).unwrap();
        path
    };
    ((0..VIEWS).map(write).collect(), truth.views.iter().map(|view| view.camera).collect())
}

/// The drawn world's place in meters, east, north and up: its z is up, too.
fn meters(point: DVec3) -> DVec3 {
    DMat3::from_rotation_z(0.7) * point * SCALE
}

fn estimated(paths: &[PathBuf], focal: f64) -> EstimatedPhotos {
    let options = EstimatePhotosOptions { focal: Some(focal), ..EstimatePhotosOptions::default() };
    estimate_photos(paths, &vec![false; paths.len()], &options).unwrap()
}

fn with(file: &Path) -> Placing {
    Placing { positions: Some(file.into()), ..Placing::default() }
}

/// Largest distance of cameras from where they are, in meters, and angle of their axes, degrees.
fn off(found: &EstimatedPhotos, truth: &[Camera], shift: DVec3) -> [f64; 2] {
    let mut worst = [0.0_f64; 2];
    let origin = meters(DVec3::ZERO);
    let turn = DMat3::from_cols(meters(DVec3::X) - origin, meters(DVec3::Y) - origin, meters(DVec3::Z) - origin)
        * (1.0 / SCALE);
    for (camera, truth) in found.estimate.cameras.iter().zip(truth) {
        let Ok(camera) = camera else { continue };
        let away = camera.pose.center().distance(meters(truth.pose.center()) - shift);
        let turned = Pose::new(truth.pose.rotation * turn.transpose(), DVec3::ZERO).angle_to(&camera.pose);
        worst = [worst[0].max(away), worst[1].max(turned.to_degrees())];
    }
    worst
}

/// Promise (photos): positions bring estimated cameras and points to meters, east, north and up; the origin is kept in
/// transforms.json and by a capture that is read, and residuals are in cameras.json.
#[test]
fn positions_bring_meters_and_north() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let (paths, truth) = photos(folder);
    let before = estimated(&paths, truth[0].intrinsics.fx / 96.0);
    let offset = DVec3::new(500_000.0, 5_200_000.0, 300.0);
    let rows: String = (0..VIEWS)
        .map(|i| {
            let mut at = meters(truth[i].pose.center()) + offset;
            // One is wrong by far.
            at.x += if i == 4 { 500.0 } else { 0.0 };
            format!("{i}.png;{};{};{}\n", at.x, at.y, at.z)
        })
        .collect();
    let file = folder.join("positions.csv");
    std::fs::write(&file, format!("Name;X;Y;Z\n{rows}")).unwrap();
    let mut found = before.clone();
    let placement = found.place(&paths, &with(&file)).unwrap();
    let fit = placement.positions.clone().unwrap();
    assert!(fit.followed && placement.meters && placement.east_north_up, "{placement:?}");
    assert_eq!((fit.cameras, fit.used), (VIEWS, VIEWS - 1));
    let Some(Origin::Local { offset: [x, y, z] }) = placement.origin else { panic!("{placement:?}") };
    let [away, turned] = off(&found, &truth, DVec3::new(x, y, z) - offset);
    // Photos of 96 pixels: the scene is some 75 m wide.
    assert!(away < 1.0 && turned < 1.5, "{away} m, {turned} degrees");
    // The ground sample distance is the depth over the focal length.
    let sample = placement.ground_sample.unwrap();
    assert!((0.2..3.0).contains(&(sample * truth[0].intrinsics.fx / (3.0 * SCALE))), "{sample}");
    // Relative poses are what they were.
    let pair = |e: &EstimatedPhotos| {
        let pose = |i: usize| e.estimate.cameras[i].unwrap().pose;
        pose(1).relative_to(&pose(0))
    };
    assert!(pair(&before).rotation.abs_diff_eq(pair(&found).rotation, 1e-12));
    assert_eq!(before.confidence(), found.confidence());
    let out = folder.join("found");
    found.write(&claimed(&out)).unwrap();
    assert_eq!(Transforms::read(out.join("transforms.json")).unwrap().origin, placement.origin);
    assert_eq!(posed::load(&out, &posed::PosedOptions::default()).unwrap().origin, placement.origin);
    let survey = capture::survey(&out, capture::HoldOut::Nothing, false).unwrap();
    assert_eq!(survey.origin, placement.origin);
    assert_eq!(CamerasSummary::of_capture(&out).unwrap().placement, placement);

    // The same by latitude and longitude.
    let origin = Geographic { latitude: 46.8, longitude: -91.9, altitude: 200.0 };
    let rows: String = (0..VIEWS)
        .map(|i| {
            let at = origin.east_north_up().inverse().apply(meters(truth[i].pose.center()));
            let Geographic { latitude, longitude, altitude } = Geographic::from_geocentric(at);
            format!("{altitude},{longitude:.9},{latitude:.9},{i}\n")
        })
        .collect();
    std::fs::write(&file, format!("alt,lon,lat,name\n{rows}")).unwrap();
    let mut found = before.clone();
    let placement = found.place(&paths, &with(&file)).unwrap();
    let Some(Origin::Geographic(at)) = placement.origin else { panic!("{placement:?}") };
    let [away, turned] = off(&found, &truth, origin.to_local(&at));
    assert!(away < 1.0 && turned < 1.5, "{away} m, {turned} degrees");
}

/// Promise (photos): a bar of known length in two photos sets the scale.
#[test]
fn a_bar_sets_the_scale() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let (paths, truth) = photos(folder);
    let mut found = estimated(&paths, truth[0].intrinsics.fx / 96.0);
    let ends = [DVec3::new(-0.3, 0.1, 0.0), DVec3::new(0.4, 0.0, 0.2)];
    let length = 0.25;
    let pixel = |camera: &Camera, end: DVec3| -> DVec2 { camera.intrinsics.project(camera.pose.apply(end)) };
    let row = |i: usize| {
        let [a, b] = ends.map(|end| pixel(&truth[i], end));
        format!("{i}.png,{},{},{},{},{length}\n", a.x, a.y, b.x, b.y)
    };
    let file = folder.join("bar.csv");
    std::fs::write(&file, format!("name,ax,ay,bx,by,length\n{}{}{}", row(0), row(3), row(5))).unwrap();
    let placing = Placing { scale_bar: Some(file), ..Placing::default() };
    let placement = found.place(&paths, &placing).unwrap();
    let bar = placement.scale_bar.unwrap();
    assert!(placement.meters && !placement.east_north_up && bar.photos == 3 && bar.error_pixels < 2.0, "{bar:?}");
    assert!((bar.found - length).abs() < 1e-9);
    let distance = |poses: [Pose; 2]| poses[0].center().distance(poses[1].center());
    let scale = length / ends[0].distance(ends[1]);
    let wanted = distance([truth[0].pose, truth[5].pose]) * scale;
    let got = distance([0, 5].map(|i: usize| found.estimate.cameras[i].unwrap().pose));
    assert!((got / wanted - 1.0).abs() < 0.03, "{got} {wanted}");
}

/// Promise (photos): without positions a scene stands upright, y down, with the ground at 0; `--up keep` leaves it.
#[test]
fn scenes_stand_upright() {
    let temporary = tempfile::tempdir().unwrap();
    let (paths, truth) = photos(temporary.path());
    let before = estimated(&paths, truth[0].intrinsics.fx / 96.0);
    let mut kept = before.clone();
    kept.place(&paths, &Placing::KEEP).unwrap();
    assert_eq!(kept.estimate.cameras, before.estimate.cameras);
    let mut found = before.clone();
    let placement = found.place(&paths, &Placing::default()).unwrap();
    assert!(!placement.meters && placement.vertical.is_some() && placement.origin.is_none(), "{placement:?}");
    // The mean up of the photos is as far from the vertical as in the drawn world, whose z is up.
    let up = |cameras: &[Camera]| -> DVec3 { -cameras.iter().map(|c| c.pose.rotation.row(1)).sum::<DVec3>() };
    let cameras: Vec<Camera> = found.estimate.cameras.iter().flatten().copied().collect();
    let tilt = up(&cameras).angle_between(DVec3::NEG_Y) - up(&truth).angle_between(DVec3::Z);
    assert!(tilt.abs().to_degrees() < 12.0, "{} degrees", tilt.to_degrees());
    // Of the points that three photos see, a twentieth is below the ground.
    let mut seen = vec![0; found.estimate.points.len()];
    found.estimate.observations.iter().for_each(|observation| seen[observation.point] += 1);
    let firm: Vec<DVec3> =
        found.estimate.points.iter().zip(seen).filter(|(_, seen)| *seen >= 3).map(|(p, _)| *p).collect();
    let below = firm.iter().filter(|p| p.y > 0.0).count();
    assert!(firm.len() > 50 && (below as f64 / firm.len() as f64 - 0.05).abs() < 0.02, "{below} of {}", firm.len());
}

#[test]
fn coarse_positions_are_not_followed() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let (paths, truth) = photos(folder);
    let mut found = estimated(&paths, truth[0].intrinsics.fx / 96.0);
    // As in one room: positions differ by their errors alone.
    let rows: String =
        (0..VIEWS).map(|i| format!("{i}.png,{},{},{}\n", (i * 7) % 5, (i * 3) % 4, (i * 5) % 3)).collect();
    let file = folder.join("positions.csv");
    std::fs::write(&file, format!("name,x,y,z\n{rows}")).unwrap();
    let placement = found.place(&paths, &with(&file)).unwrap();
    assert!(!placement.positions.unwrap().followed && !placement.meters);
    for (text, said) in [
        ("name,x,y,z\nother.png,1,2,3\n", "expected names of photos that have a camera, found other.png"),
        ("name,x,y,z\n0.png,1,2,3\n0.png,1,2,3\n", "expected each photo once, found 0.png in lines 2 and 3"),
        ("name,x,y,z\n0.png,1,2\n", "line 2, z: expected a finite number"),
        ("name,lat,lon,alt\n0.png,91,2,3\n", "line 2, lat: expected a number of at most 90"),
        ("a,b\n", "names of columns, as in name,x,y,z or name,latitude,longitude,altitude"),
    ] {
        std::fs::write(&file, text).unwrap();
        let message = found.place(&paths, &with(&file)).unwrap_err().to_string();
        assert!(message.contains("positions.csv") && message.contains(said), "{said}: {message}");
    }
}
