//! Metrics.

use crate::random::{noise, picture};
use weaver_image::metrics::ms_ssim;

#[test]
fn similarity_of_scales_falls_with_noise() {
    let size = [180, 190];
    let clean = picture(1, size[1], size[0]);
    let clean = clean.colors();
    assert!((ms_ssim(clean, clean, size).unwrap() - 1.0).abs() < 1e-12);
    let noise = noise::<f32>(2, clean.len());
    let with = |amount: f32| {
        let noisy: Vec<f32> = clean.iter().zip(&noise).map(|(x, n)| (x + amount * n).clamp(0.0, 1.0)).collect();
        ms_ssim(&noisy, clean, size).unwrap()
    };
    let (little, much) = (with(0.02), with(0.2));
    assert!(little > 0.9 && much < little && much > 0.0, "{little} {much}");
}

#[test]
fn small_pictures_have_no_scales() {
    let plane = vec![0.5; 175 * 200 * 3];
    assert_eq!(ms_ssim(&plane, &plane, [175, 200]), None);
}

#[test]
fn constants_differ_by_their_luminance_alone() {
    let (a, b) = (vec![0.25; 176 * 176 * 3], vec![0.5; 176 * 176 * 3]);
    // Contrast and structure are 1; the coarsest scale has (2ab + C1) / (a^2 + b^2 + C1) to its exponent.
    let luminance: f64 = (2.0 * 0.125 + 1e-4) / (0.0625 + 0.25 + 1e-4);
    assert!((ms_ssim(&a, &b, [176, 176]).unwrap() - luminance.powf(0.1333)).abs() < 1e-9);
}
