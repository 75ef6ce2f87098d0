//! Inputs that cannot be fitted are refused, not panicked at.

use crate::scenes::{cloud, photos, plain};
use weaver_fit::{Fit, FitError, FitSettings, Photo, StrategyKind, init};
use weaver_scene::PointCloud;

fn refusal(photos: Vec<Photo>, settings: FitSettings) -> String {
    match Fit::new(photos, &cloud(10, 1), settings) {
        Ok(_) => panic!("nothing was refused"),
        Err(e) => e.to_string(),
    }
}

fn good() -> FitSettings {
    plain(StrategyKind::Split, 10, 20)
}

fn two() -> Vec<Photo> {
    photos(2, &cloud(30, 2))
}

#[test]
fn poses_that_are_no_numbers() {
    let mut photos = two();
    photos[1].camera.pose.translation.x = f64::NAN;
    let message = refusal(photos, good());
    assert!(message.contains("photo 1") && message.contains("finite pose"), "{message}");
}

#[test]
fn photos_that_show_nothing() {
    assert!(refusal(Vec::new(), good()).contains("found none"));
    let mut masked = two();
    masked.iter_mut().for_each(|p| p.mask = Some(vec![false; p.camera.width * p.camera.height]));
    assert!(refusal(masked.clone(), good()).contains("masked altogether"));
    assert!(matches!(init::random(&masked, &good()), Err(FitError::Setting { .. })));
    assert!(matches!(init::random(&[], &good()), Err(FitError::Setting { .. })));
    let mut short = two();
    short[0].rgb = short[0].rgb[1..].to_vec().into();
    assert!(refusal(short, good()).contains("photo 0"));
}

#[test]
fn budgets_that_are_too_small() {
    assert!(refusal(two(), FitSettings { gaussians: 0, ..good() }).contains("gaussians: expected at least 1"));
    assert!(refusal(two(), FitSettings { gaussians: 9, ..good() }).contains("1 to 9 initial ones"));
}

#[test]
fn nothing_to_begin_with() {
    assert!(init::from_points(&PointCloud::default(), &good()).is_err());
    assert!(init::from_gaussians(&cloud(0, 1), &good()).is_err());
    let none = Fit::new(two(), &cloud(0, 1), good());
    assert!(matches!(none, Err(FitError::Setting { key: "gaussians", .. })));
}

#[test]
fn settings_out_of_range() {
    let mut settings = good();
    settings.density.until = 1.5;
    assert!(refusal(two(), settings).contains("density.until: expected 0 to 1"));
    assert!(
        refusal(two(), FitSettings { views_per_step: 0, ..good() }).contains("views_per_step: expected at least 1")
    );
    let three = FitSettings { views_per_step: 3, ..good() };
    assert!(refusal(two(), three).contains("views_per_step: expected at most the 2 photos that there are, found 3"));
    let mut settings = good();
    settings.rates.means = f64::INFINITY;
    assert!(refusal(two(), settings).contains("rates.means"));
}
