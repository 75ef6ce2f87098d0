//! WildSplatter through the trainer, on its micro preset: trained parameters of each stage, looks and masks, bits,
//! evaluation and refusals.

use crate::capture;
use crate::same_bits::same_bits;
use std::sync::Arc;
use weaver_autograd::Params;
use weaver_data::{Layout, Scene, Tuple};
use weaver_inference::{CameraSource, Density, Lights, Look, Photos, Predictor};
use weaver_kernels::random::Stream;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_trainer::evaluate::{Options, evaluate};
use weaver_trainer::{
    CameraMode, Evaluation, Example, LookOf, LooksConfig, Recipe, Registry, Session, StageConfig, Targets,
};
use weaver_wild::WildPredictor;
use weaver_wild::WildRecipe;

type Config = weaver_trainer::Config<WildRecipe>;

fn config(steps: usize, settings: &[&str]) -> Config {
    let settings: Vec<String> = settings.iter().map(|s| s.to_string()).collect();
    let mut config = Config::resolve(Some("micro"), None, &settings).unwrap();
    config.data.folders = capture::folders();
    config.rescale(steps);
    config
}

fn trained(config: Config) -> Session<WildRecipe> {
    let mut session = Session::new(config).unwrap();
    while session.advance().unwrap().is_some() {}
    session
}

fn message(settings: &[&str]) -> String {
    let settings: Vec<String> = settings.iter().map(|s| s.to_string()).collect();
    Config::resolve(Some("micro"), None, &settings).unwrap_err().to_string()
}

/// A predictor with weights of some steps, and a scene for it.
fn predictor(steps: usize) -> (WildPredictor, Scene) {
    let session = trained(config(steps, &[]));
    let config = session.config();
    let [height, width] = WildRecipe::image_size(&config.model);
    let mut params = Params::new();
    let network = Arc::new(WildRecipe::build(&config.model, &mut params, 0));
    for (id, trained) in session.params().iter() {
        params.value_mut(id).copy_from_slice(trained.value());
    }
    (WildPredictor::new(network, params), scene(4, &ProceduralOptions { width, height, views: 12 }))
}

/// Promise (results): WildSplatter: each stage trains the parts that it names, same bits at any number of threads and
/// after an interruption; looks, rectangles and masks each change a run.
#[test]
fn stages_train_what_they_name() {
    let mut session = Session::new(config(15, &[])).unwrap();
    let mut moved = Vec::new();
    while session.steps().0 < 15 {
        let before = session.params().clone();
        let report = session.advance().unwrap().unwrap();
        let parts = ["aggregator", "camera_head", "depth_head", "gaussian_param_head", "appearance", "looks"];
        let changed: Vec<&str> = parts
            .into_iter()
            .filter(|part| {
                let mut pairs = before.iter().zip(session.params().iter());
                pairs.any(|((_, a), (_, b))| a.name().split('.').next() == Some(part) && a.value() != b.value())
            })
            .collect();
        let names: Vec<String> = report.group("loss").map(|(name, _)| name.to_string()).collect();
        moved.push((report.stage, changed.join(" "), names.join(" ")));
    }
    moved.dedup();
    let of = |stage: &str, parts: &str, terms: &str| (stage.to_string(), parts.to_string(), terms.to_string());
    // With columns of zeros, the first step of a decoder gives its encoder no gradient.
    let expected = [
        of("poses", "aggregator camera_head", "pose pose_absolute"),
        of("depth", "aggregator camera_head depth_head", "pose pose_absolute depth"),
        of("looks", "gaussian_param_head appearance looks", "mse ssim"),
    ];
    let without_decay: Vec<_> = moved.into_iter().filter(|row| expected.contains(row)).collect();
    assert_eq!(without_decay, expected);
}

#[test]
fn without_embedding_the_encoder_stays() {
    let mut session = Session::new(config(15, &["stages.2.model.embed=false"])).unwrap();
    let encoder = |session: &Session<WildRecipe>| -> Vec<Vec<f32>> {
        let all = session.params().iter().filter(|(_, p)| p.name().starts_with("appearance."));
        all.map(|(_, p)| p.value().to_vec()).collect()
    };
    let before = encoder(&session);
    while session.advance().unwrap().is_some() {}
    assert_eq!(before, encoder(&session));
}

/// Promise of `stages_train_what_they_name`.
#[test]
fn bits_do_not_depend_on_threads_or_interruptions() {
    same_bits(|| config(15, &[]), [2, 5, 12]);
}

/// Light, rectangles and masks each change the trained parameters; without looks, photos keep their own light.
///
/// Promise of `stages_train_what_they_name`.
#[test]
fn looks_masks_and_occluders_each_change_the_run() {
    let all = [&["data.looks=none"][..], &[], &["data.looks.occluders=0"], &["data.looks.masks=false"]];
    let mut found: Vec<String> = all.iter().map(|settings| trained(config(6, settings)).checksum()).collect();
    found.sort();
    found.dedup();
    assert_eq!(found.len(), all.len());
    // The sun of captures is fixed; the built-in scenes can be drawn with another.
    let built_in = [&[][..], &["data.looks.moving_sun=true"]].map(|settings| {
        let mut config = config(6, settings);
        config.data.folders.clear();
        trained(config).checksum()
    });
    assert_ne!(built_in[0], built_in[1]);
}

/// Published Gaussians, and predicted cameras with Gaussians laid over the data's points: other runs, each with the
/// same bits at any number of threads.
///
/// Promise of `published_gaussians_lie_behind_the_depth`.
#[test]
fn published_choices_each_change_the_run() {
    let predicted = "stages.2.model.cameras=predicted";
    let all: [&[&str]; 4] = [
        &[],
        &["model.gaussians.parametrization=published"],
        &[predicted],
        &[predicted, "stages.2.model.aligned=true", "model.gaussians.parametrization=published"],
    ];
    let on = |threads: usize, settings: &[&str]| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| trained(config(8, settings)).checksum())
    };
    let mut found: Vec<String> = all.iter().map(|settings| on(2, settings)).collect();
    assert_eq!(found[3], on(1, all[3]));
    found.sort();
    found.dedup();
    assert_eq!(found.len(), all.len());
}

/// One geometry for all looks: predictions under two photos, between them, and under the unknown look.
///
/// Promise (results): geometry is the same under every look, to the bit, and no gradient leads from it to a look.
#[test]
fn geometry_is_the_same_under_every_look() {
    let (mut predictor, scene) = predictor(20);
    let tuple = Tuple { scene: 0, context: vec![0, 3], targets: vec![1, 6] };
    let example = Example::new(&scene, &Layout::of(&scene), tuple).unwrap();
    let Photos { height, width, .. } = example.photos();
    let pixels = 3 * height * width;
    let dark: Vec<f32> = example.images[..pixels].iter().map(|x| 0.4 * x).collect();
    let of = |planes| Photos { planes, inside: None, height, width };
    let [a, b] = [of(&example.images[2 * pixels..3 * pixels]), of(&dark[..])];
    let looks = [
        Look::Of(a),
        Look::Of(b),
        Look::Between(a, b, 0.0),
        Look::Between(a, b, 0.5),
        Look::Between(a, b, 1.0),
        Look::Unknown,
    ];
    let (stream, given) = (Stream::new(0, 0, "test"), CameraSource::Given(example.context()));
    let all = predictor.predict_looks(example.context_photos(), given, &looks, stream).unwrap();
    assert_eq!(all.colors.len(), looks.len());
    // The ends equal the looks of the photos, and everything between differs.
    assert!(all.colors[0] == all.colors[2] && all.colors[1] == all.colors[4]);
    for (i, j) in [(0, 1), (0, 3), (1, 3), (0, 5)] {
        assert_ne!(all.colors[i], all.colors[j], "{i} {j}");
    }
    for (look, colors) in looks.iter().zip(&all.colors) {
        let alone = predictor.predict_looks(example.context_photos(), given, &[*look], stream).unwrap();
        let (one, first) = (&alone.prediction.gaussians, &all.prediction.gaussians);
        assert_eq!((&one.means, &one.scales, &one.quats), (&first.means, &first.scales, &first.quats));
        assert_eq!((&one.opacities, &alone.prediction.depth), (&first.opacities, &all.prediction.depth));
        assert_eq!((&one.sh, &alone.colors[0]), (colors, colors));
    }
    // The default look is the first photo's.
    let plain = predictor.predict(example.context_photos(), given, Density::default(), stream).unwrap();
    let own = [Look::Of(of(&example.images[..pixels]))];
    let own = predictor.predict_looks(example.context_photos(), given, &own, stream).unwrap();
    assert_eq!(plain.gaussians.sh, own.prediction.gaussians.sh);

    let refused = |looks: &[Look<'_>], predictor: &mut WildPredictor| {
        predictor.predict_looks(example.context_photos(), given, looks, stream).unwrap_err().to_string()
    };
    assert!(refused(&[], &mut predictor).contains("looks: expected at least one, found none"));
    let narrow = Photos { planes: &dark[..3 * 5 * 7], inside: None, height: 5, width: 7 };
    let found = refused(&[Look::Of(narrow)], &mut predictor);
    assert!(found.contains("expected a photo of the look whose sides are multiples of"), "{found}");
}

fn options(look: Option<LookOf>, planted: Option<LooksConfig>) -> Options {
    Options { context_views: 2, planted, look, ..Options::default() }
}

#[test]
fn evaluation_says_how_light_is_met() {
    let (mut predictor, scene) = predictor(20);
    let scenes = [scene];
    let mut run = |look, planted| -> Evaluation {
        evaluate(&mut predictor, &scenes, &options(look, planted), None, &mut |_, _| {}).unwrap()
    };
    let planted = Some(LooksConfig::default());
    let all = [LookOf::Half, LookOf::Own, LookOf::Unknown, LookOf::Wrong].map(|look| run(Some(look), planted.clone()));
    for (i, one) in all.iter().enumerate() {
        let look = one.mean.look.unwrap();
        // The fit of gain and offset cannot lower the PSNR.
        assert!(look.psnr_fitted >= one.mean.psnr - 1e-9 && look.color_error > 0.0);
        assert!(look.slope.is_some() && look.correlation.unwrap().iter().all(|c| c.abs() <= 1.0 + 1e-9));
        for other in &all[..i] {
            assert_ne!(one.mean.psnr, other.mean.psnr);
            // The mask, and the nearest photo's PSNR under it, do not depend on the look.
            assert_eq!(one.mean.psnr_nearest, other.mean.psnr_nearest);
        }
        assert!(one.table().contains("gain and offset"));
    }
    // The same looks each time, others without, and no looks at all without planting.
    assert_eq!(run(Some(LookOf::Half), planted.clone()), all[0]);
    assert_ne!(run(None, planted.clone()).mean.psnr_nearest, run(None, None).mean.psnr_nearest);
    let real = run(Some(LookOf::Half), None);
    assert!(real.mean.look.unwrap().slope.is_none());
    // A run without masks is judged by the same pixels.
    let blind = run(Some(LookOf::Half), Some(LooksConfig { masks: false, ..LooksConfig::default() }));
    assert!(blind.mean.psnr_nearest == all[0].mean.psnr_nearest && blind.mean.psnr != all[0].mean.psnr);
    assert!(blind.mean.gaussians_per_pixel == 1.0 && all[0].mean.gaussians_per_pixel < 1.0);
}

#[test]
fn models_without_looks_say_so() {
    let mut other = weaver_inference::SplatWeaverPredictor::built_in().unwrap();
    let [height, width] = other.image_size();
    let scenes = [scene(4, &ProceduralOptions { width, height, views: 8 })];
    let found = evaluate(&mut other, &scenes, &options(Some(LookOf::Half), None), None, &mut |_, _| {}).unwrap_err();
    assert!(found.to_string().contains("does not know about light"), "{found}");
    let joint =
        Options { targets: Targets::Joint, cameras: CameraMode::Predicted, ..options(Some(LookOf::Half), None) };
    let found = evaluate(&mut other, &scenes, &joint, None, &mut |_, _| {}).unwrap_err();
    assert!(found.to_string().contains("look: expected"), "{found}");
}

#[test]
fn what_does_not_fit_is_named() {
    let cases = [
        (&["data.looks.occluders=101"][..], "data.looks.occluders"),
        (&["stages.0.losses.pose.l1=0", "stages.0.losses.pose.absolute=0"], "stages.0.losses: expected a loss"),
        (&["model.looks.embedding=0"], "model.looks.embedding: expected 1 to 1000000, found 0"),
        (&["data.looks.masked=true"], "masked"),
        (
            &["stages.2.model.aligned=true"],
            "stages.2.model.aligned: expected model.cameras = \"predicted\" with it, found \"given\"",
        ),
    ];
    for (settings, expected) in cases {
        let found = message(settings);
        assert!(found.contains(expected), "{found}");
    }
}

/// Weights of another width of embedding are refused, with both.
#[test]
fn weights_of_another_width_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.safetensors");
    let mut session = Session::new(config(5, &[])).unwrap();
    while session.advance().unwrap().is_some() {}
    session.save(&path).unwrap();
    let wider = Session::resume(config(5, &["model.looks.embedding=6"]), &path).unwrap_err().to_string();
    let expected = "metadata model.looks.embedding: expected 6, as the run's configuration says, found 4";
    assert!(wider.ends_with(expected), "{wider}");
    let opened = Registry::default().with::<WildRecipe>().open_weights(&path).unwrap();
    assert_eq!((opened.step, opened.predictor.max_per_pixel()), (5, 1));
}

/// The preset is the published one at a small scale.
#[test]
fn the_preset_is_the_one_of_the_tiny_version() {
    let config = Config::preset("tiny").unwrap();
    let of = |stage: &StageConfig<WildRecipe>| (stage.name.clone(), stage.steps);
    let stages: Vec<_> = config.stages.iter().map(of).collect();
    assert_eq!(stages, [("poses".into(), 1300), ("depth".into(), 1200), ("looks".into(), 3000)]);
    let mut params = Params::<f32>::new();
    WildRecipe::build(&config.model, &mut params, 0);
    let of_looks: usize = params
        .iter()
        .filter(|(_, p)| p.name().starts_with("appearance.") || p.name().starts_with("looks."))
        .map(|(_, p)| p.value().len())
        .sum();
    assert!((100_000..250_000).contains(&of_looks), "{of_looks}");
    assert_eq!(config.data.looks, Some(LooksConfig { occluders: 3, masks: true, moving_sun: false }));
}
