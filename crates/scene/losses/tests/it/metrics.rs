//! Metrics against scikit-image, and on images whose metric is known.

use weaver_autograd::Tape;
use weaver_fixtures::Fixture;
use weaver_losses::metrics::{energetic_mask, psnr, psnr_aligned, psnr_masked, ssim, ssim_masked};
use weaver_losses::{Covariance, mse, ssim_with};

#[test]
fn equal_to_the_reference() {
    let fixture = Fixture::open("metrics.safetensors");
    for i in 0..3 {
        let (a, shape) = fixture.tensor(&format!("in.a{i}"));
        let b = fixture.f32(&format!("in.b{i}"));
        fixture.assert_close(&format!("out.psnr{i}"), &[psnr(&a, &b) as f32]);
        let tape = Tape::<f32>::new();
        let loss = mse(tape.constant(&a, &shape[..]), tape.constant(&b, &shape[..]));
        fixture.assert_close(&format!("out.mse{i}"), &[loss.item()]);
        // The file's tolerance allows for a careless 32-bit implementation; this one is exact to the file's rounding.
        let similarity = ssim(&a, &b, shape.try_into().unwrap());
        let expected = f64::from(fixture.f32(&format!("out.ssim{i}"))[0]);
        assert!((similarity - expected).abs() < 1e-7, "{similarity} against {expected}");
    }
}

#[test]
fn gradient_of_ssim() {
    let fixture = Fixture::open("metrics.safetensors");
    let (a, shape) = fixture.tensor("in.a0");
    let shape = [1, shape[0], shape[1], shape[2]];
    let tape = Tape::<f32>::new();
    let b = tape.leaf(&fixture.f32("in.b0"), shape);
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
fn an_affine_map_of_colors_is_taken_out() {
    let image: Vec<f64> = (0..3 * 64).map(|i| f64::from(i * 37 % 101) / 202.0 + 0.2).collect();
    let photo: Vec<f64> = (0..3 * 64)
        .map(|i| {
            let [r, g, b] = [0, 1, 2].map(|c| image[c * 64 + i % 64]);
            [0.9 * r + 0.05 * g + 0.01, 0.8 * g + 0.1 * b, 0.7 * b - 0.02][i / 64]
        })
        .collect();
    assert!(psnr(&image, &photo) < 30.0);
    assert!(psnr_aligned(&image, &photo, None).unwrap() > 80.0);
    // Pixels outside the mask do not count, in the map nor in the figure.
    let (mask, mut other): (Vec<bool>, _) = ((0..64).map(|i| i % 3 > 0).collect(), photo.clone());
    (0..64).filter(|i| i % 3 == 0).for_each(|i| other[i] = 0.0);
    assert!(psnr_aligned(&image, &other, Some(&mask)).unwrap() > 80.0);
    assert_eq!(psnr_aligned(&image, &other, Some(&[false; 64])), None);
    // Never worse than as it is, where nothing is clamped; and a broken render is no number.
    let noisy: Vec<f64> = photo.iter().enumerate().map(|(i, x)| x + f64::from((i * 7 % 5) as u8) / 50.0).collect();
    assert!(psnr_aligned(&image, &noisy, None).unwrap() >= psnr(&image, &noisy));
    let broken = [&[f64::NAN][..], &image[1..]].concat();
    assert!(psnr_aligned(&broken, &photo, None).unwrap().is_nan());
    // One color: nothing to solve for, and still a number.
    assert!(psnr_aligned(&[0.5; 48], &[0.25; 48], None).unwrap() > 60.0);
}

#[test]
fn a_quarter_of_the_pixels_is_energetic() {
    let energy: Vec<f64> = (0..48).map(|i| f64::from(i * 29 % 48)).collect();
    let mask = energetic_mask(&energy, None);
    assert_eq!(mask.iter().filter(|m| **m).count(), 12);
    assert!(energy.iter().zip(&mask).all(|(e, m)| *m == (*e >= 36.0)));
    assert_eq!(energetic_mask(&[0.3; 5], None), [true; 5], "a view without contrast");
}

#[test]
fn what_a_mask_leaves_out_is_not_compared() {
    let size = [3, 16, 20];
    let image = |seed: usize, outside: f32| -> Vec<f32> {
        let value = |i: usize| ((i * 31 + seed * 17) % 97) as f32 / 97.0;
        (0..960).map(|i| if i % 20 < 5 { value(i) } else { outside }).collect()
    };
    let inside: Vec<bool> = (0..320).map(|i| i % 20 < 5).collect();
    let of = |a: f32, b: f32| ssim_masked(&image(1, a), &image(2, b), size, &inside).unwrap();
    assert_eq!([of(0.0, 0.4), of(0.7, 0.4)], [of(0.7, 0.1); 2]);
    assert_eq!(ssim_masked(&image(1, 0.2), &image(1, 1.0), size, &inside), Some(1.0));
    assert_eq!(ssim_masked(&image(1, 0.2), &image(1, 1.0), size, &[false; 320]), None);
    // Where every window holds pixels inside, it is the whole.
    let all = vec![true; 320];
    let (a, b) = (image(1, 0.5), image(2, 0.5));
    assert!((ssim_masked(&a, &b, size, &all).unwrap() - ssim(&a, &b, size)).abs() < 1e-12);
    // Elsewhere, windows that hold nothing of the mask, in which both are white, do not count.
    let corner: Vec<bool> = (0..320).map(|i| i % 20 > 16 && i / 20 > 13).collect();
    let windows = (0..6 * 10).map(|w| (w / 10, w % 10));
    let counted = windows.filter(|(y, x)| (0..121).any(|i| corner[(y + i / 11) * 20 + x + i % 11])).count();
    let white = |image: &[f32]| (0..960).map(|i| if corner[i % 320] { image[i] } else { 1.0 }).collect::<Vec<_>>();
    let expected = 1.0 - (1.0 - ssim(&white(&a), &white(&b), size)) * 60.0 / counted as f64;
    assert!((ssim_masked(&a, &b, size, &corner).unwrap() - expected).abs() < 1e-12 && (1..60).contains(&counted));
    let energy: Vec<f32> = (0..320).map(|i| if i % 20 < 5 { i as f32 } else { 1e6 }).collect();
    let mask = energetic_mask(&energy, Some(&inside));
    assert_eq!((mask.iter().filter(|m| **m).count(), mask[304], mask[319]), (20, true, false));
}
