//! Rendered photos, without any other information.

use rayon::ThreadPoolBuilder;
use weaver_data::Scene;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::{Distortion, Intrinsics, Pose, Similarity, so3};
use weaver_procedural::{ProceduralOptions, scene};
use weaver_sfm::{Estimate, EstimateOptions, Find, LeftOut, Photo, estimate};

fn built_in(seed: u64, views: usize) -> Scene {
    scene(seed, &ProceduralOptions { width: 256, height: 192, views })
}

/// Photos of every second view, with or without their focal length.
fn photos(scene: &Scene, known: bool) -> Vec<Photo<'static>> {
    let photo = |view: &weaver_data::View| {
        let photo = Photo::new(view.image.to_bytes(), [view.camera.height, view.camera.width]);
        Photo { focal: known.then_some(view.camera.intrinsics.fx), ..photo }
    };
    scene.views.iter().step_by(2).map(photo).collect()
}

/// The mean difference of rotations after the best common one, degrees.
fn off(found: &Estimate, scene: &Scene) -> f64 {
    let found: Vec<Pose> = found.cameras.iter().map(|c| c.as_ref().expect("a camera").pose).collect();
    let truth: Vec<Pose> = scene.views.iter().step_by(2).map(|v| v.camera.pose).collect();
    // Axes with their opposites, so that the best similarity is a rotation alone.
    let axes = |poses: &[Pose]| -> Vec<DVec3> {
        let of = |pose: &Pose| [0, 1, 2].map(|k| pose.rotation.row(k));
        poses.iter().flat_map(of).flat_map(|axis| [axis, -axis]).collect()
    };
    let onto = Similarity::fit(&axes(&found), &axes(&truth)).expect("axes").rotation;
    let angle = |(found, truth): (&Pose, &Pose)| {
        Pose::new(found.rotation * onto.transpose(), DVec3::ZERO).angle_to(truth).to_degrees()
    };
    found.iter().zip(&truth).map(angle).sum::<f64>() / found.len() as f64
}

/// Errors of camera centers after the best similarity: root mean square, over the root mean square of their distances
/// from their middle.
fn centers(found: &Estimate, scene: &Scene) -> f64 {
    let from: Vec<DVec3> = found.cameras.iter().map(|c| c.as_ref().expect("a camera").pose.center()).collect();
    let to: Vec<DVec3> = scene.views.iter().step_by(2).map(|v| v.camera.pose.center()).collect();
    let onto = Similarity::fit(&from, &to).expect("centers that are not on a line");
    let middle = to.iter().sum::<DVec3>() / to.len() as f64;
    let sum = |of: &dyn Fn(usize) -> DVec3| (0..to.len()).map(|i| (of(i) - to[i]).length_squared()).sum::<f64>();
    (sum(&|i| onto.apply(from[i])) / sum(&|_| middle)).sqrt()
}

fn exact() -> EstimateOptions {
    EstimateOptions { focal_deviation: 0.0, ..EstimateOptions::default() }
}

#[test]
fn cameras_of_a_few_photos() {
    for seed in [3, 4] {
        let scene = built_in(seed, 8);
        let found = estimate(&photos(&scene, true), &exact());
        assert!(off(&found, &scene) < 1.0, "seed {seed}: {} degrees off", off(&found, &scene));
        assert!(found.seen.iter().all(|n| *n > 50) && found.error < 0.5, "{:?}, {} px", found.seen, found.error);
        // The first camera is the origin, and the points that it sees are a unit away.
        let first = found.cameras[0].as_ref().expect("a camera");
        assert!(first.pose.angle_to(&Pose::IDENTITY) < 1e-6 && first.pose.center().length() < 1e-9);
        let mut distances: Vec<f64> = found.points.iter().map(|p| p.length()).collect();
        distances.sort_by(f64::total_cmp);
        distances.truncate(distances.len() - distances.len() / 50);
        let mean = distances.iter().sum::<f64>() / distances.len() as f64;
        assert!((mean - 1.0).abs() < 1e-3, "points are {mean} away");
    }
}

#[test]
fn a_focal_length_that_nobody_knows() {
    let scene = built_in(3, 8);
    let found = estimate(&photos(&scene, false), &EstimateOptions::default());
    let focal = found.cameras[0].as_ref().expect("a camera").intrinsics.fx / scene.views[0].camera.intrinsics.fx;
    assert!(off(&found, &scene) < 1.0, "{} degrees off", off(&found, &scene));
    // Four photos from a narrow arc hardly determine it.
    assert!((focal - 1.0).abs() < 0.2, "focal length off by a factor of {focal}");
}

#[test]
fn a_wrong_focal_length_comes_back() {
    let scene = built_in(3, 24);
    let mut photos = photos(&scene, true);
    photos.iter_mut().for_each(|p| p.focal = p.focal.map(|f| 1.06 * f));
    let found = estimate(&photos, &EstimateOptions::default());
    let focal = found.cameras[0].as_ref().expect("a camera").intrinsics.fx / scene.views[0].camera.intrinsics.fx;
    // Between the given focal length and the photos' own.
    assert!((focal - 1.0).abs() < 0.03, "focal length off by a factor of {focal}");
}

/// Photos without a focal length take the others'.
#[test]
fn unknown_focal_lengths_follow_the_others() {
    let scene = built_in(3, 8);
    let mut photos = photos(&scene, true);
    photos.iter_mut().step_by(2).for_each(|p| p.focal = None);
    let found = estimate(&photos, &exact());
    assert!(off(&found, &scene) < 1.0, "{} degrees off", off(&found, &scene));
    let focal = |i: usize| found.cameras[i].expect("a camera").intrinsics.fx;
    assert_eq!(focal(0), focal(1));
    assert_eq!((found.focal_factor, found.focal_guessed), (1.0, false));
}

/// A pixel in gray, from 0 to 1.
fn gray(photo: &Photo<'_>, pixel: usize) -> f32 {
    photo.rgb[3 * pixel..][..3].iter().map(|color| f32::from(*color)).sum::<f32>() / 765.0
}

/// Gray values as a photo.
fn rgb(gray: impl Iterator<Item = f32>) -> Vec<u8> {
    gray.flat_map(|gray| [(255.0 * gray).round() as u8; 3]).collect()
}

/// Photos seen through a place in other ones: `from` says where each pixel of `size` (height, width) comes from.
fn warped(photos: &mut [Photo<'_>], size: [usize; 2], from: impl Fn(DVec2) -> DVec2) {
    for photo in photos {
        let [height, width] = photo.size;
        let pixel = |x: usize, y: usize| f64::from(gray(photo, y.min(height - 1) * width + x.min(width - 1)));
        let gray = (0..size[0] * size[1]).map(|i| {
            let at = from(DVec2::new((i % size[1]) as f64 + 0.5, (i / size[1]) as f64 + 0.5));
            let at = (at - 0.5).clamp(DVec2::ZERO, DVec2::new((width - 1) as f64, (height - 1) as f64));
            let (corner, t) = (at.floor(), at.fract());
            let (x, y) = (corner.x as usize, corner.y as usize);
            let row = |y: usize| pixel(x, y) * (1.0 - t.x) + pixel(x + 1, y) * t.x;
            (row(y) * (1.0 - t.y) + row(y + 1) * t.y) as f32
        });
        (photo.rgb, photo.size) = (rgb(gray).into(), size);
    }
}

/// Crops every third photo, from the second one on, about its middle: it is then of another lens.
fn cropped(photos: &mut [Photo<'_>], size: [usize; 2]) {
    for photo in photos.iter_mut().skip(1).step_by(3) {
        let [height, width] = photo.size;
        let corner = DVec2::new((width - size[1]) as f64, (height - size[0]) as f64) / 2.0;
        warped(std::slice::from_mut(photo), size, |pixel| pixel + corner);
        photo.lens = 7;
    }
}

#[test]
fn a_distortion_that_photos_tell() {
    let k1 = -0.15;
    let scene = built_in(3, 24);
    let mut photos = photos(&scene, true);
    let k = scene.views[0].camera.intrinsics;
    warped(&mut photos, [192, 256], |pixel| {
        let bent = k.unproject(pixel, 1.0).truncate();
        let straight = (0..20).fold(bent, |at, _| bent / (1.0 + k1 * at.length_squared()));
        k.project(straight.extend(1.0))
    });
    let found = estimate(&photos, &exact());
    let Some(Distortion::Radial { k: [first, ..], .. }) = found.distortion[0] else { panic!("no distortion") };
    assert!((first - k1).abs() < 0.03, "k1 {first} instead of {k1}");
    let ignored = estimate(&photos, &EstimateOptions { distortion: Find::Off, ..exact() });
    assert!(ignored.distortion[0].is_none() && found.error < ignored.error, "{} and {}", found.error, ignored.error);
    assert!(off(&found, &scene) < 0.8 * off(&ignored, &scene), "{} degrees off", off(&found, &scene));
}

#[test]
fn photos_of_another_place_are_left_out_in_any_order() {
    let scene = built_in(3, 24);
    let mut mixed = photos(&scene, true);
    mixed.insert(2, photos(&built_in(40, 4), true)[0].clone());
    let found = estimate(&mixed, &exact());
    assert!(matches!(found.cameras[2], Err(LeftOut::Unmatched | LeftOut::Unplaced)), "{:?}", found.cameras[2]);
    assert_eq!((found.cameras.iter().flatten().count(), found.seen[2]), (12, 0));
    let mut forward = found.clone();
    _ = forward.cameras.remove(2);
    assert!(off(&forward, &scene) < 1.5, "{} degrees off", off(&forward, &scene));
    mixed.reverse();
    let mut reversed = estimate(&mixed, &exact());
    reversed.cameras.reverse();
    _ = reversed.cameras.remove(2);
    let first = reversed.cameras[0].expect("a camera").pose;
    for camera in reversed.cameras.iter_mut().flatten() {
        camera.pose = camera.pose.relative_to(&first);
    }
    assert!(off(&reversed, &scene) < 1.5, "reversed: {} degrees off", off(&reversed, &scene));
}

/// Settings that find cameras fast.
fn quick() -> EstimateOptions {
    EstimateOptions { keypoints: 300, ..EstimateOptions::default() }
}

/// Promise of `cropped_photos_have_their_own_focal_length`.
#[test]
fn a_focal_length_that_nobody_knows_of_ten_photos() {
    let scene = built_in(2, 20);
    let found = estimate(&photos(&scene, false), &quick());
    let focal = found.cameras[0].expect("a camera").intrinsics.fx / scene.views[0].camera.intrinsics.fx;
    assert!((focal - 1.0).abs() < 0.035, "focal length off by a factor of {focal}");
    assert!(off(&found, &scene) < 1.0, "{} degrees off", off(&found, &scene));
    assert!(centers(&found, &scene) < 0.025, "centers off by {}", centers(&found, &scene));
    assert!(!found.focal_guessed && found.focal_factor == 1.0, "nothing was told");
}

/// Promise of `cropped_photos_have_their_own_focal_length`.
#[test]
fn crops_have_focal_lengths_of_their_own() {
    let scene = built_in(2, 26);
    let mut photos = photos(&scene, false);
    cropped(&mut photos, [192, 192]);
    let found = estimate(&photos, &quick());
    let focal = |i: usize| found.cameras[i].expect("a camera").intrinsics.fx / scene.views[0].camera.intrinsics.fx;
    for i in 0..photos.len() {
        assert!((focal(i) - 1.0).abs() < 0.04, "photo {i}: focal length off by a factor of {}", focal(i));
        // Of one lens, that is over the longer side.
        assert_eq!(focal(i), focal(i % 3 % 2));
    }
    assert!(off(&found, &scene) < 1.0, "{} degrees off", off(&found, &scene));
    assert!(centers(&found, &scene) < 0.035, "centers off by {}", centers(&found, &scene));
}

/// A lens without a focal length begins as others and is found.
#[test]
fn an_unknown_lens_is_found() {
    let scene = built_in(3, 16);
    let mut photos = photos(&scene, true);
    // Much less than the largest crop.
    cropped(&mut photos, [160, 160]);
    photos.iter_mut().filter(|p| p.lens > 0).for_each(|p| p.focal = None);
    let found = estimate(&photos, &exact());
    for (photo, camera) in photos.iter().zip(&found.cameras) {
        let focal = camera.expect("a camera").intrinsics.fx / scene.views[0].camera.intrinsics.fx;
        let most = if photo.focal.is_some() { 0.0 } else { 0.02 };
        assert!((focal - 1.0).abs() <= most, "lens {}: off by a factor of {focal}", photo.lens);
    }
    assert_eq!(found.focal_factor, 1.0);
}

/// Promise (figures): a located photo changes nothing of the others.
#[test]
fn what_is_located_finds_no_points() {
    let scene = built_in(2, 26);
    let mut photos = photos(&scene, false);
    photos[2].located = true;
    let found = estimate(&photos, &quick());
    assert!(found.cameras[2].is_ok());
    let seen_by_two = |e: &Estimate| e.observations.chunk_by(|a, b| a.point == b.point).all(|of| of.len() > 1);
    // Another view of the same scene, then one of another scene.
    let [again, elsewhere] = [photos[6].clone(), self::photos(&built_in(40, 2), false).remove(0)];
    for other in [again, elsewhere] {
        photos[2].rgb = other.rgb;
        let disturbed = estimate(&photos, &quick());
        assert!(disturbed.cameras[2] != found.cameras[2]);
        let others = |e: &Estimate| [&e.cameras[..2], &e.cameras[3..]].concat();
        assert_eq!(others(&disturbed), others(&found));
        assert!(disturbed.points == found.points && disturbed.observations == found.observations);
        assert_eq!((disturbed.error, disturbed.rival), (found.error, found.rival));
        assert!(seen_by_two(&disturbed) && disturbed.observations.iter().all(|o| o.camera != 2));
    }
}

#[test]
fn what_is_located_has_the_lens_of_the_others() {
    let scene = built_in(3, 12);
    let mut photos = photos(&scene, true);
    photos[2].located = true;
    // The given focal lengths are a little off, and the photos correct them.
    photos.iter_mut().for_each(|p| p.focal = p.focal.map(|f| 1.06 * f));
    let found = estimate(&photos, &EstimateOptions::default());
    assert!(off(&found, &scene) < 1.0, "{} degrees off", off(&found, &scene));
    let focal = |i: usize| found.cameras[i].expect("a camera").intrinsics.fx;
    assert_eq!(focal(2), focal(0));
    assert!(found.focal_factor < 1.0 && !found.focal_guessed, "{}", found.focal_factor);
}

/// Two photos beside located ones only guess their focal length.
#[test]
fn two_photos_only_guess_their_focal_length() {
    let scene = built_in(3, 8);
    let mut photos = photos(&scene, false);
    photos.iter_mut().skip(2).for_each(|p| p.located = true);
    let found = estimate(&photos, &EstimateOptions::default());
    assert!(found.cameras.iter().flatten().count() > 2 && found.focal_guessed, "{:?}", found.cameras);
}

#[test]
fn nothing_is_made_up() {
    let scene = built_in(3, 2);
    let photo = photos(&scene, true).remove(0);
    let reasons = |photos: &[Photo<'_>]| -> Vec<LeftOut> {
        let found = estimate(photos, &exact());
        assert!(found.points.is_empty() && found.observations.is_empty() && found.error.is_nan());
        found.cameras.into_iter().map(|c| c.expect_err("no camera")).collect()
    };
    assert_eq!(reasons(&[]), []);
    assert_eq!(reasons(std::slice::from_ref(&photo)), [LeftOut::Unmatched]);
    assert_eq!(reasons(&[photo.clone(), photo.clone(), photo.clone()]), [LeftOut::OnePlace; 3]);
    let blank = Photo { rgb: vec![128; photo.rgb.len()].into(), ..photo.clone() };
    assert_eq!(reasons(&[blank.clone(), blank]), [LeftOut::Textureless; 2]);
    let masked = vec![false; photo.rgb.len() / 3];
    let masked = Photo { mask: Some(&masked), ..photo.clone() };
    assert_eq!(reasons(&[masked.clone(), masked]), [LeftOut::Textureless; 2]);
    let turned: Vec<Photo<'_>> = [0.0, 0.1, 0.2].map(|angle| seen_after_turning(&photo, angle)).to_vec();
    assert_eq!(reasons(&turned), [LeftOut::OnePlace; 3]);
}

/// The view of a photo's camera after turning on the spot; black where it looks beyond.
fn seen_after_turning(photo: &Photo<'_>, angle: f64) -> Photo<'static> {
    let [height, width] = photo.size;
    let focal = photo.focal.expect("a focal length");
    let intrinsics = Intrinsics { fx: focal, fy: focal, cx: width as f64 / 2.0, cy: height as f64 / 2.0 };
    let turn = so3::exp(DVec3::Y * angle);
    let gray = (0..width * height).map(|i| {
        let at = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let from = intrinsics.project(turn * intrinsics.unproject(at, 1.0)) - 0.5;
        let (x, y) = (from.x.floor(), from.y.floor());
        if x < 0.0 || y < 0.0 || x + 1.0 >= width as f64 || y + 1.0 >= height as f64 {
            return 0.0;
        }
        let (u, v) = ((from.x - x) as f32, (from.y - y) as f32);
        let gray = |dx: usize, dy: usize| self::gray(photo, (y as usize + dy) * width + x as usize + dx);
        (gray(0, 0) * (1.0 - u) + gray(1, 0) * u) * (1.0 - v) + (gray(0, 1) * (1.0 - u) + gray(1, 1) * u) * v
    });
    Photo { rgb: rgb(gray).into(), mask: None, ..photo.clone() }
}

#[test]
fn the_same_bits_at_any_number_of_threads() {
    let scene = built_in(5, 8);
    let photos = photos(&scene, false);
    let with = |threads: usize| -> Estimate {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| estimate(&photos, &EstimateOptions::default()))
    };
    let (one, three) = (with(1), with(3));
    assert_eq!((one.cameras, one.points), (three.cameras, three.points));
}
