//! Panoramas as rigs of six faces with one center.

use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose, Similarity};
use weaver_procedural::{ProceduralOptions, Walk};
use weaver_sfm::{Estimate, EstimateOptions, LeftOut, Mounted, Photo, estimate};

/// Pixels of a face, and its focal length: the field of view is 95 degrees.
const SIDE: usize = 160;
const FOCAL: f64 = 73.306;
const FACES: usize = 6;

/// Rotations from the front face's axes to those of each face: front, right, back, left, up, down.
fn turns() -> [DMat3; FACES] {
    let turn = |right: DVec3, down: DVec3| DMat3::from_cols(right, down, right.cross(down)).transpose();
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    [turn(x, y), turn(-z, y), turn(-x, y), turn(z, y), turn(x, z), turn(x, -z)]
}

/// The faces of panoramas along a street, which are turned about the vertical and a little tilted; and their cameras.
fn panoramas(count: usize, apart: usize) -> (Vec<Photo<'static>>, Vec<Camera>) {
    let walk = Walk::street(3, &ProceduralOptions { width: 64, height: 48, views: 60 });
    let intrinsics = Intrinsics { fx: FOCAL, fy: FOCAL, cx: SIDE as f64 / 2.0, cy: SIDE as f64 / 2.0 };
    let (mut photos, mut cameras) = (Vec::new(), Vec::new());
    for number in 0..count {
        let first = walk.cameras()[3 + apart * number].pose;
        let tilt = DMat3::from_rotation_z(0.05 * (number as f64).sin()) * DMat3::from_rotation_y(0.9 * number as f64);
        let first = Pose::new(tilt, DVec3::ZERO).compose(&first);
        for (face, rotation) in turns().into_iter().enumerate() {
            let pose = Pose::new(rotation, DVec3::ZERO).compose(&first);
            let camera = Camera { pose, intrinsics, width: SIDE, height: SIDE };
            let view = walk.seen_by(&camera, FACES * number + face);
            let mounted = Some(Mounted { on: FACES * number, rotation });
            let photo = Photo::new(view.image.to_bytes(), [SIDE, SIDE]);
            photos.push(Photo { focal: Some(FOCAL), mounted, ..photo });
            cameras.push(camera);
        }
    }
    (photos, cameras)
}

/// The largest errors of rotations, degrees, and of centers, over the largest distance of two, of photos with a camera.
fn errors(found: &Estimate, truth: &[Camera]) -> [f64; 2] {
    let both = found.cameras.iter().zip(truth).filter_map(|(found, truth)| Some((found.ok()?.pose, truth.pose)));
    let (from, to): (Vec<Pose>, Vec<Pose>) = both.unzip();
    let onto = Similarity::fit_poses(&from, &to).expect("poses");
    let centers: Vec<DVec3> = to.iter().map(Pose::center).collect();
    let extent = centers.iter().flat_map(|a| centers.iter().map(move |b| a.distance(*b))).fold(0.0, f64::max);
    from.iter().zip(&to).fold([0.0; 2], |[turned, moved]: [f64; 2], (from, to)| {
        let from = onto.apply_to_pose(from);
        [turned.max(from.angle_to(to).to_degrees()), moved.max(from.center().distance(to.center()) / extent)]
    })
}

/// Promise (photos): the six faces of a panorama stand in one place and are turned by right angles, exactly.
#[test]
fn panoramas_are_placed_as_rigs() {
    let (photos, truth) = panoramas(5, 2);
    let found = estimate(&photos, &EstimateOptions::default());
    assert!(found.cameras.iter().all(Result::is_ok), "{:?}", found.cameras);
    let [turned, moved] = errors(&found, &truth);
    assert!(turned < 0.2 && moved < 0.01, "{turned} degrees, {moved} of the extent");
    let poses: Vec<Pose> = found.cameras.iter().map(|camera| camera.unwrap().pose).collect();
    for (rig, turns) in poses.chunks(FACES).map(|rig| (rig, turns())) {
        for (pose, turn) in rig.iter().zip(turns) {
            let expected = Pose::new(turn, DVec3::ZERO).compose(&rig[0]);
            assert!(pose.angle_to(&expected) < 1e-7 && pose.center().distance(rig[0].center()) < 1e-9);
        }
    }
    assert!(found.cameras.iter().flatten().all(|camera| camera.intrinsics.fx == FOCAL));
    assert!(found.distortion.iter().all(Option::is_none));
    // The pixels of one place alone tell no depth.
    let seen_by_two = found.observations.chunk_by(|a, b| a.point == b.point);
    assert!(seen_by_two.into_iter().all(|seen| seen.iter().any(|o| o.camera / FACES != seen[0].camera / FACES)));
    assert_eq!(found.uncertainty.unwrap().rotations.len(), photos.len());
}

/// A panorama that is only located changes nothing of the others, and has one place, too.
#[test]
fn a_rig_is_located_as_one() {
    let (mut photos, truth) = panoramas(5, 2);
    photos[2 * FACES..3 * FACES].iter_mut().for_each(|photo| photo.located = true);
    let found = estimate(&photos, &EstimateOptions::default());
    let [turned, moved] = errors(&found, &truth);
    assert!(turned < 0.3 && moved < 0.02, "{turned} degrees, {moved} of the extent");
    let located = &found.cameras[2 * FACES..3 * FACES];
    let center = located[0].unwrap().pose.center();
    assert!(located.iter().all(|camera| camera.unwrap().pose.center().distance(center) < 1e-9));
    let without: Vec<Photo<'_>> = photos
        .iter()
        .enumerate()
        .filter(|(i, _)| i / FACES != 2)
        .map(|(i, photo)| {
            let on = if i / FACES > 2 { photo.mounted.unwrap().on - FACES } else { photo.mounted.unwrap().on };
            Photo { mounted: photo.mounted.map(|mounted| Mounted { on, ..mounted }), ..photo.clone() }
        })
        .collect();
    let others = estimate(&without, &EstimateOptions::default());
    assert_eq!(&found.cameras[..2 * FACES], &others.cameras[..2 * FACES]);
    assert_eq!(&found.cameras[3 * FACES..], &others.cameras[2 * FACES..]);
}

/// Nothing tells a depth from one place.
#[test]
fn one_rig_alone_has_no_cameras() {
    let (photos, _) = panoramas(1, 1);
    let found = estimate(&photos, &EstimateOptions::default());
    assert!(found.cameras.iter().all(|camera| matches!(camera, Err(LeftOut::Unmatched | LeftOut::Textureless))));
}

/// Usual photos of an unknown lens among panoramas: their focal length is their own.
#[test]
fn photos_and_panoramas_make_one_scene() {
    let (mut photos, mut truth) = panoramas(4, 2);
    let walk = Walk::street(3, &ProceduralOptions { width: 192, height: 144, views: 60 });
    for number in [4, 5, 6, 7, 8] {
        let view = walk.view(number);
        let photo = Photo::new(view.image.to_bytes(), [view.camera.height, view.camera.width]);
        photos.push(Photo { lens: 1, ..photo });
        truth.push(view.camera);
    }
    let found = estimate(&photos, &EstimateOptions::default());
    assert!(found.cameras.iter().all(Result::is_ok), "{:?}", found.cameras);
    let [turned, moved] = errors(&found, &truth);
    assert!(turned < 0.5 && moved < 0.02, "{turned} degrees, {moved} of the extent");
    let focal = found.cameras[4 * FACES].unwrap().intrinsics.fx / truth[4 * FACES].intrinsics.fx;
    assert!((focal - 1.0).abs() < 0.02, "{focal}");
    assert!(found.cameras[..4 * FACES].iter().flatten().all(|camera| camera.intrinsics.fx == FOCAL));
}
