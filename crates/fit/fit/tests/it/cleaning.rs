//! Scenes without what no photo needs.

use crate::scenes::{cloud, finish, photos, plain};
use weaver_fit::{Cleaned, CleaningRules, Fit, FitSettings, StrategyKind};
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

/// Promise (fits): a run removes what no photo needs before its last fifth; stopped before or after that, it goes on to
/// the same bits, and knows what it removed.
#[test]
fn a_run_cleans_its_scene() {
    let scene = cloud(40, 3);
    // Where no photo sees it, it does not move.
    let behind = [0.0, 0.0, -5.0];
    let planted = with(&scene, behind, -1.0, 3.0);
    let begun = |clean: bool| {
        let settings = FitSettings { clean, ..plain(StrategyKind::Keep, 10, planted.len()) };
        Fit::new(photos(4, &scene), &planted, settings).unwrap()
    };
    let mut unclean = begun(false);
    finish(&mut unclean);
    assert_eq!((unclean.gaussians().len(), unclean.cleaned()), (planted.len(), Cleaned::default()));
    let mut whole = begun(true);
    let mut states = Vec::new();
    while whole.steps_done() < 10 {
        states.push((whole.state(), whole.is_cleaning_due()));
        whole.step().unwrap();
    }
    let due = states.iter().filter(|(_, due)| *due).count();
    assert!(due == 1 && states[8].1, "due once, before the last fifth");
    assert!(!whole.gaussians().means.contains(&behind) && unclean.gaussians().means.contains(&behind));
    assert!(whole.cleaned().unseen == 1 && whole.gaussians().len() == planted.len() - whole.cleaned().count());
    for stopped in [7, 8, 9] {
        let mut resumed = begun(true);
        resumed.restore(&states[stopped].0).unwrap();
        finish(&mut resumed);
        assert_eq!(resumed.gaussians(), whole.gaussians(), "stopped after {stopped}");
        assert_eq!(resumed.cleaned(), whole.cleaned(), "stopped after {stopped}");
    }
}
