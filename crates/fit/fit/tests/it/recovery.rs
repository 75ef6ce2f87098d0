//! Parameters that a fit recovers.

use crate::scenes::{SIZE, camera, cloud, finish, photos, plain};
use weaver_fit::{Exposure, Fit, FitSettings, Judge, Photo, StrategyKind, init};
use weaver_geometry::{Camera, Pose};

#[test]
fn a_picture() {
    let [width, height] = SIZE;
    let tile = |i: usize| (i / 3 % width / 8 + i / 3 / width / 8).is_multiple_of(2);
    let rgb: Vec<u8> = (0..3 * width * height).map(|i| if tile(i) { 200 - 60 * (i % 3) as u8 } else { 30 }).collect();
    let photo =
        Photo { name: "tiles".into(), camera: camera(0.0, 0.0), rgb: rgb.clone().into(), mask: None, lens: None };
    let settings = plain(StrategyKind::Split, 300, 150);
    let initial = init::random(std::slice::from_ref(&photo), &settings).expect("Gaussians");
    let mut fit = Fit::new(vec![photo], &initial, settings).expect("a fit");
    let before = fit.render(&camera(0.0, 0.0)).expect("an image");
    finish(&mut fit);
    let after = fit.render(&camera(0.0, 0.0)).expect("an image");
    let psnr = |image: &[f32]| Judge::default().compare(image, &rgb, [height, width]).psnr;
    assert!(psnr(&after) > 25.0, "{} to {}", psnr(&before), psnr(&after));
}

/// Photo 1 is darker by a factor and lighter by a constant: corrections say so, up to a change common to all photos.
#[test]
fn exposures() {
    let scene = cloud(60, 1);
    let mut photos = photos(3, &scene);
    let changed = |x: u8| (0.8 * f32::from(x) + 15.0).round() as u8;
    photos[1].rgb.iter_mut().for_each(|x| *x = changed(*x));
    let settings = FitSettings { exposure: true, ..plain(StrategyKind::Keep, 400, 60) };
    let mut fit = Fit::new(photos, &scene, settings).expect("a fit");
    finish(&mut fit);
    let apply = |photo: usize, x: f32| {
        let mut corrected = [0.0; 3];
        fit.exposure(photo).expect("an exposure").apply(&[x; 3], &mut corrected);
        corrected.iter().sum::<f32>() / 3.0
    };
    // Corrections of the others undone: `apply(0, x)` has been 0.3, 0.6, 0.9.
    for gray in [0.3_f32, 0.6, 0.9] {
        let (from, to) = (apply(0, 0.0), apply(0, 1.0));
        let x = (gray - from) / (to - from);
        let (found, expected) = (apply(1, x), 0.8 * gray + 15.0 / 255.0);
        assert!((found - expected).abs() < 0.02, "{gray}: {found}, not {expected}");
    }
}

/// Photos along a path, the later ones darker: a camera is in the light of the photos beside it.
#[test]
fn exposures_of_neighbors() {
    let scene = cloud(60, 1);
    let gains = [1.0, 0.92, 0.84, 0.76, 0.68, 0.6];
    let mut photos = photos(6, &scene);
    for (photo, gain) in photos.iter_mut().zip(gains) {
        photo.rgb.iter_mut().for_each(|x| *x = (gain * f32::from(*x)).round() as u8);
    }
    let settings = FitSettings { exposure: true, ..plain(StrategyKind::Keep, 120, 60) };
    let mut fit = Fit::new(photos, &scene, settings).expect("a fit");
    fit.begin_exposures(gains.into_iter().map(|gain| Exposure::of_gains([gain / 0.8; 3])));
    finish(&mut fit);
    let gain = |exposure: &Exposure| (0..3).map(|c| exposure.matrix[5 * c]).sum::<f32>() / 3.0;
    let own: [f32; 6] = std::array::from_fn(|i| gain(fit.exposure(i).expect("an exposure")));
    let at = |camera: &Camera| gain(&fit.exposure_at(camera).expect("an exposure"));
    assert!(own[0] > own[5] + 0.2, "{own:?}");
    for i in 0..6 {
        assert!((at(&fit.camera(i)) - own[i]).abs() < 1e-3, "{own:?}, at {i} {}", at(&fit.camera(i)));
    }
    // Halfway between two.
    let [first, second] = [2, 3].map(|photo| fit.camera(photo));
    let middle = first.pose.center().lerp(second.pose.center(), 0.5);
    let rotation = first.pose.rotation;
    let between = at(&Camera { pose: Pose::new(rotation, -(rotation * middle)), ..first });
    assert!(between < own[2] && between > own[3], "{own:?}, between the middle ones {between}");
}
