//! Scenes without what no photo needs.

use crate::scenes::{camera, cloud, photos, plain};
use weaver_fit::{Cleaned, CleaningRules, Fit, StrategyKind};
use weaver_scene::{Gaussians, Photo};

fn clean(photos: Vec<Photo>, scene: &Gaussians) -> (Gaussians, Cleaned) {
    let mut fit = Fit::new(photos, scene, plain(StrategyKind::Keep, 10, scene.len())).unwrap();
    let cleaned = fit.clean(&CleaningRules::default()).unwrap();
    (fit.gaussians(), cleaned)
}

/// Gaussians of a scene, then one at a place, as large and as opaque as said.
fn with(scene: &Gaussians, mean: [f32; 3], log_scale: f32, logit: f32) -> Gaussians {
    let mut planted = scene.clone();
    planted.means.push(mean);
    planted.log_scales.push([log_scale; 3]);
    planted.quats.push([1.0, 0.0, 0.0, 0.0]);
    planted.opacity_logits.push(logit);
    planted.sh.extend([1.5, -1.0, 0.5]);
    planted
}

/// Promise (fits): junk that is planted into a scene goes, and the scene stays.
#[test]
fn planted_junk_goes() {
    let scene = cloud(40, 3);
    let photos = photos(4, &scene);
    // A scene that is its photos' has nothing to lose: whatever goes is planted, or hidden.
    let (_, alone) = clean(photos.clone(), &scene);
    let junk = [
        ("before a camera", [0.1, 0.0, 0.7], -2.0, 0.0),
        ("dust", [0.5, 0.3, 2.0], -3.5, -0.5),
        ("a halo", [3.0, 0.0, 5.0], 0.3, -2.0),
        ("behind all cameras", [0.0, 0.0, -5.0], -1.0, 3.0),
    ];
    for (name, mean, log_scale, logit) in junk {
        let planted = with(&scene, mean, log_scale, logit);
        let (left, cleaned) = clean(photos.clone(), &planted);
        assert!(!left.means.contains(&mean), "{name} is left");
        assert_eq!(left.len(), planted.len() - cleaned.count(), "{name}");
        assert!(cleaned.count() <= 1 + alone.count() + 1, "{name}: {cleaned:?}, {alone:?} without it");
    }
}

/// A scene that is its photos' loses next to nothing of them.
///
/// Promise of `planted_junk_goes`.
#[test]
fn photos_are_met_as_well() {
    let scene = cloud(40, 3);
    let all = photos(4, &scene);
    let (left, cleaned) = clean(all.clone(), &scene);
    let (error, after) = (off(&all, &scene), off(&all, &left));
    assert!(after <= 1.003 * error + 1e-9, "{error} to {after}: {cleaned:?}");
}

/// A scene that no photo shows is left as it is.
///
/// Promise of `planted_junk_goes`.
#[test]
fn a_scene_outside_of_all_photos_stays() {
    let scene = cloud(40, 3);
    let mut behind = scene.clone();
    behind.means.iter_mut().for_each(|mean| mean[2] -= 20.0);
    let (left, cleaned) = clean(photos(4, &scene), &behind);
    assert_eq!((left.len(), cleaned), (40, Cleaned::default()));
}

/// Mean squared error of photos.
fn off(photos: &[Photo], scene: &Gaussians) -> f64 {
    let cameras: Vec<_> = photos.iter().map(|photo| photo.camera).collect();
    let images = crate::scenes::render(scene, &cameras);
    let squares = images.iter().zip(photos).flat_map(|(image, photo)| {
        image.iter().zip(&photo.rgb).map(|(x, byte)| (f64::from(*x) - f64::from(*byte) / 255.0).powi(2))
    });
    squares.clone().sum::<f64>() / squares.count() as f64
}

/// Of a scene that is not its photos' any more, all junk goes at once, and what stays is as it was.
///
/// Promise of `planted_junk_goes`.
#[test]
fn junk_before_junk_fades() {
    let scene = cloud(40, 3);
    let photos = photos(4, &scene);
    let rules = CleaningRules { rise: 0.0, ..CleaningRules::ANY_SCENE };
    let cleaned = |scene: &Gaussians| {
        let mut fit = Fit::new(photos.clone(), scene, plain(StrategyKind::Keep, 10, scene.len())).unwrap();
        let before = fit.settings().clone();
        let cleaned = fit.clean(&rules).unwrap();
        assert_eq!((fit.settings(), fit.steps_done()), (&before, 0));
        (fit.gaussians(), cleaned)
    };
    let (clean, _) = cleaned(&scene);
    let junk: Vec<[f32; 3]> = (0..6_u8).map(|i| [0.02 * f32::from(i), 0.0, 0.7 + 0.2 * f32::from(i)]).collect();
    let planted = junk.iter().fold(clean.clone(), |scene, mean| with(&scene, *mean, -2.0, 1.0));
    let (left, removed) = cleaned(&planted);
    assert!(junk.iter().all(|mean| !left.means.contains(mean)), "{removed}");
    assert!(left.len() + 2 >= clean.len(), "{removed}");
    let rows: Vec<usize> = (0..clean.len()).filter(|i| left.means.contains(&clean.means[*i])).collect();
    assert_eq!(left, clean.select(&rows));
}

/// Promise (fits): a Gaussian that one of many photos shows alone goes, and stays where photos are few.
#[test]
fn what_one_photo_shows_goes_where_there_are_many() {
    let scene = cloud(40, 3);
    let cleaned = |count: usize| {
        // One more photo looks the other way, at a single Gaussian.
        let mean = [0.0, 0.0, -3.0];
        let planted = with(&scene, mean, -2.0, 0.0);
        let mut all = photos(count, &planted);
        let away = camera(0.0, std::f64::consts::PI);
        let image = &crate::scenes::render(&planted, &[away])[0];
        let rgb: Vec<u8> = image.iter().map(|x| (255.0 * x).round().clamp(0.0, 255.0) as u8).collect();
        all.push(Photo { camera: away, rgb: rgb.into(), ..all[0].clone() });
        let mut fit = Fit::new(all, &planted, plain(StrategyKind::Keep, 10, planted.len())).unwrap();
        let cleaned = fit.clean(&CleaningRules { bound: f64::INFINITY, ..CleaningRules::default() }).unwrap();
        (fit.gaussians().means.contains(&mean), cleaned.lone)
    };
    assert_eq!(cleaned(6), (true, 0));
    let (stays, lone) = cleaned(14);
    assert!(!stays && lone >= 1, "{stays} {lone}");
}
