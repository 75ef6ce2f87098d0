//! Metrics against scikit-image, and on images whose metric is known.

use crate::fixture::Fixture;
use weaver_autograd::Tape;
use weaver_losses::metrics::{energetic_mask, psnr, psnr_masked, ssim};
use weaver_losses::{Covariance, mse, ssim_with};

#[test]
fn equal_to_the_reference() {
    let fixture = Fixture::open("metrics.safetensors");
    for i in 0..3 {
        let (a, shape) = fixture.tensor(&format!("in.a{i}"));
        let b = fixture.data(&format!("in.b{i}"));
        fixture.assert_close(&format!("out.psnr{i}"), &[psnr(&a, &b) as f32]);
        let tape = Tape::<f32>::new();
        let loss = mse(tape.constant(&a, &shape[..]), tape.constant(&b, &shape[..]));
        fixture.assert_close(&format!("out.mse{i}"), &[loss.item()]);
        // The file's tolerance is that of a careless 32-bit implementation; this one is exact to the file's rounding.
        let similarity = ssim(&a, &b, shape.try_into().unwrap());
        let expected = f64::from(fixture.data(&format!("out.ssim{i}"))[0]);
        assert!((similarity - expected).abs() < 1e-7, "{similarity} against {expected}");
    }
}

#[test]
fn gradient_of_ssim() {
    let fixture = Fixture::open("metrics.safetensors");
    let (a, shape) = fixture.tensor("in.a0");
    let shape = [1, shape[0], shape[1], shape[2]];
    let tape = Tape::<f32>::new();
    let b = tape.leaf(&fixture.data("in.b0"), shape);
    let similarity = ssim_with(tape.constant(&a, shape), b, Covariance::Sample);
    fixture.assert_close("out.ssim0", &[similarity.item()]);
    similarity.backward();
    fixture.assert_close("grad.ssim0.b", &b.grad().unwrap());
}

#[test]
fn psnr_clamps_and_masks() {
    assert!((psnr(&[0.0, 2.0], &[0.1, 1.0]) - (10.0 * (2.0f64 / 0.01).log10())).abs() < 1e-9);
    assert_eq!(psnr(&[0.5], &[0.5]), f64::INFINITY);
    assert!(psnr(&[f64::NAN], &[0.5]).is_nan());
    // Two channels of two pixels; only the second pixel counts.
    let (a, b) = ([0.9, 0.1, 0.9, 0.3], [0.0, 0.0, 0.0, 0.3]);
    let masked = psnr_masked(&a, &b, &[false, true]).unwrap();
    assert!((masked - 10.0 * 200.0f64.log10()).abs() < 1e-9);
    assert_eq!(psnr_masked(&a, &b, &[true, true]), Some(psnr(&a, &b)));
    assert_eq!(psnr_masked(&a, &b, &[false, false]), None);
}

#[test]
fn a_quarter_of_the_pixels_is_energetic() {
    let energy: Vec<f64> = (0..48).map(|i| f64::from(i * 29 % 48)).collect();
    let mask = energetic_mask(&energy);
    assert_eq!(mask.iter().filter(|m| **m).count(), 12);
    assert!(energy.iter().zip(&mask).all(|(e, m)| *m == (*e >= 36.0)));
}
