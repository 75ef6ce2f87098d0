//! The network with weights, on photos good and bad.

use crate::Drawn;
use weaver_data::SparsePoints;
use weaver_inference::{CameraSource, Density, Photos, Prediction, Predictor};
use weaver_kernels::random::Stream;
use weaver_photo::{Comparison, PhotoConfig, PhotoPredictor};
use weaver_router::AllocationKind;

fn predictor() -> PhotoPredictor {
    PhotoPredictor::untrained(PhotoConfig::preset("micro").unwrap(), AllocationKind::Quadtree, 0.5)
}

fn points(drawn: &Drawn) -> SparsePoints {
    drawn.scene.points_seen(&(0..drawn.cameras.len()).collect::<Vec<_>>(), 1.0)
}

fn predict(drawn: &Drawn, photos: Photos<'_>, points: &SparsePoints) -> Result<Prediction, String> {
    let source = CameraSource::GivenWithPoints { cameras: &drawn.cameras, points };
    predictor().predict(photos, source, Density::default(), Stream::new(0, 0, "")).map_err(|e| e.to_string())
}

/// Photos of a drawn scene come back from their own cameras, and the same bits at any number of threads.
///
/// Promise (results): the untrained photo network shows its photos again, at any number of threads with the same bits.
#[test]
fn photos_come_back() {
    let drawn = Drawn::new(1, [48, 64], 4);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| predict(&drawn, drawn.photos(), &points(&drawn)).unwrap())
    };
    let (one, two) = (run(1), run(2));
    assert_eq!((&one.gaussians, &one.depth), (&two.gaussians, &two.depth));
    let renders = predictor().render(&one, &drawn.cameras).unwrap();
    for (render, view) in renders.iter().zip(&drawn.scene.views) {
        let squares = render.pixels.iter().zip(&view.image.pixels).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        let psnr = -10.0 * (squares / render.pixels.len() as f64).log10();
        assert!(psnr > 15.0, "{psnr:.2} dB");
    }
}

#[test]
fn a_budget_bounds_the_gaussians() {
    let drawn = Drawn::new(1, [48, 64], 3);
    let all = points(&drawn);
    let source = CameraSource::GivenWithPoints { cameras: &drawn.cameras, points: &all };
    let mut counts = Vec::new();
    for budget in [0.1, 0.4] {
        let density = Density { budget: Some(budget), ..Density::default() };
        let made = predictor().predict(drawn.photos(), source, density, Stream::new(0, 0, "")).unwrap();
        assert!(made.gaussians.opacities.len() as f64 <= budget * made.depth.len() as f64 * 1.2);
        counts.push(made.gaussians.opacities.len());
    }
    // Ragged borders of what is kept need cells of their own, so that a small budget may be exceeded.
    assert!(counts[0] * 3 < counts[1] * 2, "{counts:?}");
    let density = Density { budget: Some(9.0), ..Density::default() };
    assert!(predictor().predict(drawn.photos(), source, density, Stream::new(0, 0, "")).is_err());
}

/// Bad photos and cameras end in a message that says what was expected and found.
///
/// Promise (results): one photo, photos of one place, photos without common points and cameras without points are
/// refused with the reason.
#[test]
fn bad_photos_are_refused() {
    let drawn = Drawn::new(1, [48, 64], 3);
    let all = points(&drawn);
    let refused = |photos: Photos<'_>, source: CameraSource<'_>| {
        predictor().predict(photos, source, Density::default(), Stream::new(0, 0, "")).unwrap_err().to_string()
    };
    let given = CameraSource::GivenWithPoints { cameras: &drawn.cameras, points: &all };
    let message = refused(drawn.photos().first(1), given);
    assert!(message.contains("expected 2 to 16 photos") && message.contains("found 1"), "{message}");
    let message = refused(drawn.photos(), CameraSource::Predicted);
    assert!(message.contains("expected cameras with the points"), "{message}");
    let message = refused(drawn.photos(), CameraSource::Given(&drawn.cameras));
    assert!(message.contains("found cameras without points"), "{message}");
    let mut apart = all.clone();
    apart.visible[1].clear();
    let message = refused(drawn.photos(), CameraSource::GivenWithPoints { cameras: &drawn.cameras, points: &apart });
    assert!(message.contains("photo 2 of 3"), "{message}");
    // Equal photos from one place.
    let (cameras, planes) = (vec![drawn.cameras[0]; 3], drawn.planes[..3 * drawn.pixels()].repeat(3));
    let visible = vec![all.visible[0].clone(); 3];
    let equal = SparsePoints { visible, ..all.clone() };
    let photos = Photos { planes: &planes, ..drawn.photos() };
    let message = refused(photos, CameraSource::GivenWithPoints { cameras: &cameras, points: &equal });
    assert!(message.contains("from one place"), "{message}");
}

/// Two equal photos among others, and photos that are even in color, still give a scene.
#[test]
fn equal_and_even_photos_give_a_scene() {
    let mut drawn = Drawn::new(1, [48, 64], 3);
    let pixels = drawn.pixels();
    drawn.cameras[1] = drawn.cameras[0];
    let first = drawn.planes[..3 * pixels].to_vec();
    drawn.planes[3 * pixels..6 * pixels].copy_from_slice(&first);
    let mut all = points(&drawn);
    all.visible[1] = all.visible[0].clone();
    let made = predict(&drawn, drawn.photos(), &all).unwrap();
    assert!(made.gaussians.means.iter().all(|x| x.is_finite()) && !made.gaussians.opacities.is_empty());
    let gray = vec![0.5; drawn.planes.len()];
    let made = predict(&drawn, Photos { planes: &gray, ..drawn.photos() }, &all).unwrap();
    assert!(made.gaussians.means.iter().all(|x| x.is_finite()) && !made.gaussians.opacities.is_empty());
}

/// A prediction says when photos agree about nothing, and says nothing when they agree.
#[test]
fn unsure_depth_is_announced() {
    let drawn = Drawn::new(1, [48, 64], 3);
    let remarks = |depth: Vec<f32>| {
        let (density, stream) = (Density::default(), Stream::new(0, 0, ""));
        let made = predictor().predict_compared(drawn.photos(), &drawn.cameras, &Comparison { depth }, density, stream);
        made.unwrap().remarks
    };
    assert!(remarks(vec![0.0; drawn.depth.len()])[0].contains("agree about little"));
    assert_eq!(remarks(drawn.depth.clone()), Vec::<String>::new());
}

/// Masked pixels get no Gaussians.
#[test]
fn masked_pixels_get_no_gaussians() {
    let drawn = Drawn::new(1, [48, 64], 3);
    let inside: Vec<bool> = (0..3 * drawn.pixels()).map(|at| at % 64 < 40).collect();
    let made = predict(&drawn, Photos { inside: Some(&inside), ..drawn.photos() }, &points(&drawn)).unwrap();
    assert!(made.counts.iter().zip(&inside).all(|(count, inside)| *inside || *count == 0));
    assert!(made.counts.iter().any(|count| *count > 0));
}
