//! Training with rounding in place.

use crate::scenes::{cloud, photos, plain};
use std::error::Error;
use weaver_fit::{Fit, FitError, Rates, Rounding, StrategyKind};
use weaver_scene::Gaussians;

const STEP: f32 = 1.0;

/// Logits in steps; with steps of zero, nothing.
#[derive(Debug)]
struct Steps(f32);

impl Rounding for Steps {
    fn rounded(&mut self, gaussians: &Gaussians) -> Result<Gaussians, Box<dyn Error + Send + Sync>> {
        let round = |values: &[f32]| -> Vec<f32> {
            values.iter().map(|x| if self.0 > 0.0 { (x / self.0).round() * self.0 } else { *x }).collect()
        };
        Ok(Gaussians { opacity_logits: round(&gaussians.opacity_logits), ..gaussians.clone() })
    }
}

#[derive(Debug)]
struct Refusing;

impl Rounding for Refusing {
    fn rounded(&mut self, _: &Gaussians) -> Result<Gaussians, Box<dyn Error + Send + Sync>> {
        Err("no numbers".into())
    }
}

/// A fit that begins at the scene of its photos.
fn trained(rounding: Option<(f64, Box<dyn Rounding>)>) -> Gaussians {
    let scene = cloud(40, 3);
    let mut settings = plain(StrategyKind::Keep, 120, 40);
    // Opacities stay, so that none goes back and forth over a border of the rounding; the rest makes up for it.
    settings.rates = Rates { opacities: 0.0, ..settings.rates };
    let mut fit = Fit::new(photos(4, &scene), &scene, settings).expect("a fit");
    if let Some((from, rounding)) = rounding {
        fit.set_rounding(from, rounding);
    }
    for _ in 0..120 {
        fit.step().expect("a step");
    }
    fit.gaussians()
}

/// Mean squared error of rounded Gaussians.
fn error_when_rounded(gaussians: &Gaussians) -> f64 {
    let rounded = Steps(STEP).rounded(gaussians).expect("Gaussians");
    let photos = photos(4, &cloud(40, 3));
    let cameras: Vec<_> = photos.iter().map(|photo| photo.camera).collect();
    let images = crate::scenes::render(&rounded, &cameras);
    let squares = images.iter().zip(&photos).flat_map(|(image, photo)| {
        image.iter().zip(&photo.rgb).map(|(x, byte)| (f64::from(*x) - f64::from(*byte) / 255.0).powi(2))
    });
    squares.clone().sum::<f64>() / squares.count() as f64
}

#[test]
fn what_changes_nothing_gives_the_same_bits() {
    let plain = trained(None);
    assert_eq!(trained(Some((0.0, Box::new(Steps(0.0))))), plain);
    assert_eq!(trained(Some((1.0, Box::new(Steps(STEP))))), plain, "not before its time");
}

#[test]
fn training_makes_up_for_rounding() {
    let plain = trained(None);
    let aware = trained(Some((0.0, Box::new(Steps(STEP)))));
    let (before, after) = (error_when_rounded(&plain), error_when_rounded(&aware));
    assert!(after < 0.8 * before, "{before} to {after}");
}

#[test]
fn settling_makes_the_scene_what_was_drawn() {
    let mut fit = Fit::new(photos(2, &cloud(9, 3)), &cloud(9, 4), plain(StrategyKind::Keep, 2, 9)).expect("a fit");
    fit.set_rounding(0.5, Box::new(Steps(STEP)));
    let begun = fit.gaussians();
    fit.settle().expect("not yet");
    assert_eq!(fit.gaussians(), begun);
    fit.step().and_then(|_| fit.step()).expect("two steps");
    let drawn = Steps(STEP).rounded(&fit.gaussians()).expect("Gaussians");
    fit.settle().expect("Gaussians");
    assert_eq!(fit.gaussians(), drawn);
}

/// Steps of logits, and Gaussians that are removed where less is lost than this.
#[derive(Debug)]
struct Worth(f64);

impl Rounding for Worth {
    fn rounded(&mut self, gaussians: &Gaussians) -> Result<Gaussians, Box<dyn Error + Send + Sync>> {
        Steps(STEP).rounded(gaussians)
    }

    fn worth(&self) -> f64 {
        self.0
    }
}

/// Promise (kept): a Gaussian's removal cost is the change of the pictures; a fit for a compressed file removes
/// invisible Gaussians, also stopped and gone on with.
#[test]
fn removal_costs_are_changes_of_pictures() {
    let (scene, photos) = (cloud(12, 3), photos(3, &cloud(12, 5)));
    let fit = Fit::new(photos.clone(), &scene, plain(StrategyKind::Keep, 2, 12)).expect("a fit");
    let cameras: Vec<_> = photos.iter().map(|photo| photo.camera).collect();
    let drawn = |scene: &Gaussians| crate::scenes::render(scene, &cameras).concat();
    let (all, costs) = (drawn(&scene), fit.removal_costs().expect("costs"));
    assert!(costs.iter().filter(|cost| **cost > 0.01).count() > 6, "{costs:?}");
    for (i, cost) in costs.iter().enumerate() {
        let others: Vec<usize> = (0..12).filter(|j| *j != i).collect();
        let without = drawn(&scene.select(&others));
        let expected: f64 = all.iter().zip(&without).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        // A Gaussian far below a pixel's last bit is not drawn.
        assert!((cost - expected).abs() < 0.02 * expected + 1e-4, "{i}: {cost} of {expected}");
    }
}

/// A fit of a scene and of others that nothing shows, at its end, or stopped and gone on with.
fn with_invisible(worth: f64, stop: Option<usize>) -> Gaussians {
    let (mut scene, hidden) = (cloud(40, 3), 10);
    scene.opacity_logits[..hidden].fill(-9.0);
    let begin = || {
        let mut settings = plain(StrategyKind::Keep, 120, 40);
        settings.rates = Rates { opacities: 0.0, end: 0.1, ..settings.rates };
        let mut fit = Fit::new(photos(4, &scene), &scene, settings).expect("a fit");
        fit.set_rounding(0.5, Box::new(Worth(worth)));
        fit
    };
    let mut fit = begin();
    if let Some(stop) = stop {
        (0..stop).for_each(|_| _ = fit.step().expect("a step"));
        let state = fit.state();
        fit = begin();
        fit.restore(&state).expect("the state");
    }
    crate::scenes::finish(&mut fit);
    fit.gaussians()
}

/// Promise of `removal_costs_are_changes_of_pictures`.
#[test]
fn what_no_picture_shows_is_removed() {
    assert_eq!(with_invisible(0.0, None).len(), 40);
    let left = with_invisible(1e-3, None);
    assert!(left.opacity_logits.iter().all(|logit| *logit > -8.0) && left.len() > 25, "{} are left", left.len());
    // In the middle of the rounds, too.
    assert_eq!(with_invisible(1e-3, Some(67)), left);
}

#[test]
fn refusals_are_named() {
    let mut fit = Fit::new(photos(2, &cloud(9, 3)), &cloud(9, 4), plain(StrategyKind::Keep, 2, 9)).expect("a fit");
    fit.set_rounding(0.0, Box::new(Refusing));
    let error = fit.step().expect_err("no step");
    assert!(matches!(error, FitError::Rounding { step: 0, .. }) && error.to_string().contains("no numbers"), "{error}");
}
