//! Cameras that are known, found again.

use super::cloud::{Cloud, apart, camera, disturbed, photo};
use weaver_fit::align::{Method, Options, Outcome, align, mean_square};
use weaver_splat::CpuRasterizer;

#[test]
fn small_errors_are_undone() {
    let cloud = Cloud::new(150, 1, 1);
    let pixels = cloud.draw(&camera());
    for seed in 0..2 {
        let guess = disturbed(&camera(), 2.0, seed);
        let options = Options::of(Method::Own);
        let aligned = align(&CpuRasterizer, &cloud.scene(), &[photo(&pixels, guess)], &options, mean_square).unwrap();
        let [degrees, distance] = apart(&aligned[0].camera, &camera());
        assert!(degrees < 0.3 && distance < 0.005, "seed {seed}: {degrees} {distance}");
        assert_eq!(aligned[0].outcome, Outcome::Found);
        let moved = apart(&guess, &aligned[0].camera);
        assert!((moved[0] - aligned[0].moved[0]).abs() < 1e-6);
    }
}

#[test]
fn focal_lengths_too() {
    let cloud = Cloud::new(150, 0, 2);
    let pixels = cloud.draw(&camera());
    let mut guess = disturbed(&camera(), 0.5, 4);
    guess.intrinsics.fx *= 1.02;
    guess.intrinsics.fy *= 1.02;
    let error = |intrinsics| {
        let options = Options { intrinsics, ..Options::of(Method::Own) };
        let aligned = align(&CpuRasterizer, &cloud.scene(), &[photo(&pixels, guess)], &options, mean_square).unwrap();
        (aligned[0].camera.intrinsics.fx / camera().intrinsics.fx - 1.0).abs()
    };
    // A longer lens from farther away shows nearly the same, which a descent sees slowly.
    assert!(error(true) < 0.01, "{}", error(true));
    assert!((error(false) - 0.02).abs() < 1e-12);
}

#[test]
fn any_loss_will_do() {
    let cloud = Cloud::new(150, 0, 2);
    let pixels = cloud.draw(&camera());
    let guess = disturbed(&camera(), 1.0, 4);
    // The mean of absolute differences.
    let absolute = |image: &[f64], photo: &[f64], _: [usize; 2], gradient: &mut [f64]| {
        let n = image.len() as f64;
        gradient.iter_mut().zip(image.iter().zip(photo)).for_each(|(g, (a, b))| *g = (a - b).signum() / n);
        image.iter().zip(photo).map(|(a, b)| (a - b).abs()).sum::<f64>() / n
    };
    let aligned =
        align(&CpuRasterizer, &cloud.scene(), &[photo(&pixels, guess)], &Options::of(Method::Own), absolute).unwrap();
    let [degrees, distance] = apart(&aligned[0].camera, &camera());
    assert!(degrees < 0.05 && distance < 1e-3, "{degrees} {distance}");
}
