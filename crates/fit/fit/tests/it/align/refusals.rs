//! Photos that cannot be aligned, and the errors.

use super::cloud::{Cloud, camera, photo};
use weaver_fit::align::{AlignError, Aligned, Method, Options, Outcome, Photo, Scene, align, mean_square};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, trajectory::look_at};
use weaver_splat::CpuRasterizer;

fn run(scene: &Scene<'_, f64>, photos: &[Photo<'_, f64>]) -> Result<Vec<Aligned<f64>>, AlignError> {
    let options = Options { steps: 20, ..Options::of(Method::Own) };
    align(&CpuRasterizer, scene, photos, &options, mean_square)
}

#[test]
fn photos_that_do_not_fit_are_refused() {
    let cloud = Cloud::new(20, 0, 1);
    let pixels = cloud.draw(&camera());
    let refusal = |photo: Photo<'_, f64>| run(&cloud.scene(), &[photo]).unwrap_err().to_string();
    let short = refusal(photo(&pixels[3..], camera()));
    assert_eq!(short, "photo 0: expected 9216 numbers in its pixels of 64x48, found 9213");
    let mask = refusal(Photo { mask: Some(&[true; 7]), ..photo(&pixels, camera()) });
    assert_eq!(mask, "photo 0: expected 3072 numbers in its mask of 64x48, found 7");
    let masked = refusal(Photo { mask: Some(&[false; 64 * 48]), ..photo(&pixels, camera()) });
    assert_eq!(masked, "photo 0: expected a mask that leaves something, found none");
    let mut broken = pixels.clone();
    broken[3 * (5 * 64 + 9) + 1] = f64::NAN;
    assert_eq!(refusal(photo(&broken, camera())), "photo 0: expected finite colors, found NaN at row 5, column 9");
    let unit = run(&Scene { unit: 0.0, ..cloud.scene() }, &[]).unwrap_err();
    assert_eq!(unit.to_string(), "expected a positive length as the scene's unit, found 0");
}

#[test]
fn no_photos_are_no_cameras() {
    assert!(run(&Cloud::new(20, 0, 1).scene(), &[]).unwrap().is_empty());
}

#[test]
fn guesses_that_see_nothing_stand() {
    let cloud = Cloud::new(20, 0, 1);
    let pixels = cloud.draw(&camera());
    let away = Camera { pose: look_at(DVec3::Z * 9.0, DVec3::Z * 20.0, DVec3::NEG_Y), ..camera() };
    let aligned = run(&cloud.scene(), &[photo(&pixels, away)]).unwrap();
    assert_eq!(aligned[0].outcome, Outcome::Unseen(0.0));
    assert_eq!((aligned[0].camera, aligned[0].moved), (away, [0.0; 2]));
}

#[test]
fn where_nothing_tells_the_guess_stands() {
    // Colors of the background: every picture of the scene is the same.
    let mut cloud = Cloud::new(200, 0, 1);
    cloud.scales.fill(0.4);
    let color = super::cloud::BACKGROUND.map(|c| (c - 0.5) / weaver_geometry::sh::DC);
    cloud.sh.chunks_mut(3).for_each(|sh| sh.copy_from_slice(&color));
    let pixels = vec![0.7; 64 * 48 * 3];
    let aligned = run(&cloud.scene(), &[photo(&pixels, camera())]).unwrap();
    assert!(matches!(aligned[0].outcome, Outcome::Flat | Outcome::NotBetter), "{:?}", aligned[0].outcome);
    assert_eq!(aligned[0].camera, camera());
}
