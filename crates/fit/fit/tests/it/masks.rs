//! Masked pixels have no influence.

use crate::scenes::{cloud, finish, photos, plain};
use weaver_fit::{Fit, FitSettings, Photo, StrategyKind, init};

fn half_masked() -> Vec<Photo> {
    let mut photos = photos(3, &cloud(60, 1));
    for photo in &mut photos {
        let width = photo.camera.width;
        let pixels = width * photo.camera.height;
        photo.mask = Some((0..pixels).map(|i| i % width > 12).collect());
    }
    photos
}

/// All masked pixels get another color.
fn painted(mut photos: Vec<Photo>, byte: u8) -> Vec<Photo> {
    for photo in &mut photos {
        let mask = photo.mask.as_ref().expect("a mask");
        let masked = photo.rgb.chunks_exact_mut(3).zip(mask).filter(|(_, m)| !**m);
        masked.for_each(|(pixel, _)| pixel.fill(byte));
    }
    photos
}

fn settings() -> FitSettings {
    let mut settings = FitSettings { coarse_until: 0.4, exposure: true, ..plain(StrategyKind::Split, 20, 50) };
    (settings.density.rounds, settings.density.from) = (8, 0.1);
    settings
}

#[test]
fn masked_pixels() {
    let run = |byte| {
        let photos = painted(half_masked(), byte);
        let initial = init::random(&photos, &settings()).expect("Gaussians");
        let mut fit = Fit::new(photos, &initial, settings()).expect("a fit");
        finish(&mut fit);
        fit.gaussians()
    };
    assert!(run(0) == run(255));
}

#[test]
fn masked_photos() {
    let run = |photos: Vec<Photo>| {
        let initial = init::random(&photos, &settings()).expect("Gaussians");
        let mut fit = Fit::new(photos, &initial, settings()).expect("a fit");
        finish(&mut fit);
        fit.gaussians()
    };
    let mut more = half_masked();
    more[1].mask.as_mut().expect("a mask").fill(false);
    let mut fewer = more.clone();
    fewer.remove(1);
    assert!(run(more) == run(fewer));
}
