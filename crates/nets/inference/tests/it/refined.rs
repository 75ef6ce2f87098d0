//! Refinement of predictions on their own photos: its gain there, and the parts that it leaves.

use weaver_fit::FitSettings;
use weaver_geometry::Camera;
use weaver_inference::{
    CameraSource, Density, Effort, Photos, Prediction, Predictor, Refined, SplatWeaverPredictor, planar,
};
use weaver_kernels::random::Stream;
use weaver_losses::metrics;
use weaver_procedural::{ProceduralOptions, scene};

/// Photos are met better with no more gaussians moved or in place.
///
/// Promise (results): refinement meets the photos better with no more Gaussians than were predicted, and with these
/// alone where that is asked for; its flags need one.
#[test]
fn refinement_meets_photos_better() {
    let mut plain = SplatWeaverPredictor::built_in().unwrap();
    let [height, width] = plain.image_size();
    let scene = scene(8, &ProceduralOptions { width, height, views: 4 });
    let planes = planar(scene.views.iter().map(|view| &view.image));
    let photos = Photos { planes: &planes, inside: None, height, width };
    let density = Density { budget: Some(0.1), ..Density::default() };
    let predict = |predictor: &mut dyn Predictor| -> (Prediction, f64) {
        let made = predictor.predict(photos, CameraSource::Predicted, density, Stream::new(0, 0, "test")).unwrap();
        let renders = predictor.render(&made, &made.cameras).unwrap();
        let psnr =
            renders.iter().zip(&scene.views).map(|(render, view)| metrics::psnr(&render.pixels, &view.image.pixels));
        let mean = psnr.sum::<f64>() / renders.len() as f64;
        (made, mean)
    };
    let (made, before) = predict(&mut plain);
    let refined =
        || Refined::new(Box::new(SplatWeaverPredictor::built_in().unwrap()), [height, width], Effort::Steps(60));
    let (moved, with_moves) = predict(&mut refined());
    let (adjusted, in_place) = predict(&mut refined().in_place());
    assert!(with_moves > before + 1.0 && in_place > before + 1.0, "{before} {with_moves} {in_place}");
    assert_eq!(adjusted.gaussians.len(), made.gaussians.len());
    assert!(moved.gaussians.len() <= made.gaussians.len());
    assert_ne!(moved.gaussians.means, adjusted.gaussians.means);
}

/// Settings reach the optimization: without rates no number changes however long it goes, and with the usual ones all
/// kinds do.
#[test]
fn settings_that_are_said() {
    let scene = scene(9, &ProceduralOptions { width: 64, height: 48, views: 2 });
    let planes = planar(scene.views.iter().map(|view| &view.image));
    let photos = Photos { planes: &planes, inside: None, height: 48, width: 64 };
    let density = Density { budget: Some(0.05), ..Density::default() };
    let first = scene.views[0].camera.pose;
    let relative = |camera: &Camera| Camera { pose: camera.pose.relative_to(&first), ..*camera };
    let cameras: Vec<_> = scene.views.iter().map(|view| relative(&view.camera)).collect();
    let made = |steps, settings: FitSettings| {
        let plain = Box::new(SplatWeaverPredictor::built_in().unwrap());
        let mut refined = Refined::new(plain, [48, 64], Effort::Steps(steps)).with_settings(settings).in_place();
        let source = CameraSource::GivenUnscaled(&cameras);
        refined.predict(photos, source, density, Stream::new(0, 0, "test")).unwrap().gaussians
    };
    let usual = Refined::usual_settings();
    let mut still = usual.clone();
    let rates = &mut still.rates;
    for rate in [&mut rates.means, &mut rates.scales, &mut rates.quats, &mut rates.opacities, &mut rates.sh] {
        *rate = 0.0;
    }
    let (kept, moved) = (made(1, still.clone()), made(5, usual));
    assert_eq!(kept, made(5, still));
    assert_eq!(kept.len(), moved.len());
    assert!(kept.means != moved.means && kept.scales != moved.scales && kept.quats != moved.quats);
    assert!(kept.opacities != moved.opacities && kept.sh != moved.sh);
}
