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

#[test]
fn refusals_are_named() {
    let mut fit = Fit::new(photos(2, &cloud(9, 3)), &cloud(9, 4), plain(StrategyKind::Keep, 2, 9)).expect("a fit");
    fit.set_rounding(0.0, Box::new(Refusing));
    let error = fit.step().expect_err("no step");
    assert!(matches!(error, FitError::Rounding { step: 0, .. }) && error.to_string().contains("no numbers"), "{error}");
}
