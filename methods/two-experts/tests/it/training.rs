//! 2Xplat through the trainer, on its micro preset: trained parameters of each stage, flow of gradients, bits and
//! refusals.

use crate::capture;
use crate::same_bits::same_bits;
use std::sync::Arc;
use weaver_data::{Layout, Scene};
use weaver_fit::align::AlignLoss;
use weaver_inference::{
    CameraSource, Density, OutputFolder, PredictOptions, Predictor, SplatWeaverPredictor, predict_to_folder,
};
use weaver_kernels::random::Stream;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_trainer::evaluate::{Options, evaluate};
use weaver_trainer::losses::{camera_constants, photo_constant};
use weaver_trainer::splatweaver::SplatWeaverRecipe;
use weaver_trainer::{Alignment, CameraMode, Example, Recipe, Registry, Session, StepReport, Targets};
use weaver_two_experts::TwoExpertsPredictor;
use weaver_two_experts::TwoExpertsRecipe;

type Config = weaver_trainer::Config<TwoExpertsRecipe>;

fn config(steps: usize, settings: &[&str]) -> Config {
    let settings: Vec<String> = settings.iter().map(|s| s.to_string()).collect();
    let mut config = Config::resolve(Some("micro"), None, &settings).unwrap();
    config.data.folders = capture::folders();
    config.rescale(steps);
    config
}

fn reports(config: Config) -> (Vec<StepReport>, String) {
    let mut session = Session::new(config).unwrap();
    let mut found = Vec::new();
    while let Some(report) = session.advance().unwrap() {
        found.push(report);
    }
    (found, session.checksum())
}

fn message(settings: &[&str]) -> String {
    let settings: Vec<String> = settings.iter().map(|s| s.to_string()).collect();
    Config::resolve(Some("micro"), None, &settings).unwrap_err().to_string()
}

/// The trained expert and the losses of each stage.
///
/// Promise (results): 2Xplat: each stage trains the expert that it names, pictures teach cameras, same bits at any
/// number of threads and after an interruption.
#[test]
fn stages_train_what_they_name() {
    let mut session = Session::new(config(15, &[])).unwrap();
    let mut moved = Vec::new();
    while session.steps().0 < 15 {
        let before = session.params().clone();
        let report = session.advance().unwrap().unwrap();
        let changed = |appearance: bool| {
            let mut pairs = before.iter().zip(session.params().iter());
            pairs.any(|((_, a), (_, b))| a.name().starts_with("appearance.") == appearance && a.value() != b.value())
        };
        let names: Vec<&str> = report.group("loss").map(|(name, _)| name).collect();
        let expected: &[&str] = match report.stage.as_str() {
            "poses" => &["pose", "pose_rotation", "pose_translation", "pose_focal", "pose_absolute"],
            "appearance" => &["mse", "ssim", "opacity"],
            _ => &["pose", "pose_rotation", "pose_translation", "pose_focal", "mse", "ssim", "opacity"],
        };
        assert_eq!(names, expected, "{}", report.stage);
        moved.push((report.stage.clone(), changed(false), changed(true)));
    }
    moved.dedup();
    let of = |stage: &str, geometry, appearance| (stage.to_string(), geometry, appearance);
    assert_eq!(moved, [of("poses", true, false), of("appearance", false, true), of("joint", true, true)]);
}

/// Without a loss on cameras, pictures alone move the geometry expert: their gradient comes through the cameras.
///
/// Promise of `stages_train_what_they_name`.
#[test]
fn pictures_teach_cameras() {
    let only_pictures = [
        "stages.2.losses.pose.l1=0",
        "stages.2.losses.pose.rotation=0",
        "stages.2.losses.pose.translation=0",
        "stages.2.losses.pose.focal=0",
        "stages.2.losses.opacity=0",
    ];
    let mut session = Session::new(config(5, &only_pictures)).unwrap();
    while session.steps().0 < 4 {
        session.advance().unwrap();
    }
    let before = session.params().clone();
    session.advance().unwrap();
    let last = |params: &weaver_autograd::Params<f32>| {
        let all: Vec<Vec<f32>> = params
            .iter()
            .filter(|(_, p)| p.name().starts_with("camera_head.") || p.name().starts_with("aggregator."))
            .map(|(_, p)| p.value().to_vec())
            .collect();
        all
    };
    let moved = last(&before).iter().zip(&last(session.params())).filter(|(a, b)| a != b).count();
    assert!(moved > 20, "{moved}");
}

/// Promise of `stages_train_what_they_name`.
#[test]
fn bits_do_not_depend_on_threads_or_interruptions() {
    same_bits(|| config(15, &[]), [2, 7, 12]);
}

/// Predicts with the context alone and with a further photo: Gaussians and cameras of the context stay as many, and the
/// further photo has a camera.
#[test]
fn cameras_of_further_photos_are_predicted_along() {
    let config = config(1, &[]);
    let [height, width] = TwoExpertsRecipe::image_size(&config.model);
    let scene = scene(3, &ProceduralOptions { width, height, views: 6 });
    let tuple = weaver_data::Tuple { scene: 0, context: vec![0, 2], targets: vec![1] };
    let example = Example::new(&scene, &Layout::of(&scene), tuple).unwrap();
    let mut params = weaver_autograd::Params::new();
    let network = Arc::new(TwoExpertsRecipe::build(&config.model, &mut params, 1));
    let mut two = TwoExpertsPredictor::new(network, params);
    let mut params = weaver_autograd::Params::new();
    let model = weaver_model::ModelConfig::preset("micro").unwrap();
    let network = Arc::new(SplatWeaverRecipe::build(&model, &mut params, 1));
    let mut one = SplatWeaverPredictor::new(network, params, "fixed:1".parse().unwrap(), 1.0);
    let stream = Stream::new(0, 0, "test");
    for predictor in [&mut two as &mut dyn Predictor, &mut one] {
        let joint =
            predictor.as_joint().unwrap().predict_jointly(example.photos(), 2, Density::default(), stream).unwrap();
        assert_eq!((joint.prediction.cameras.len(), joint.targets.len()), (2, 1));
        assert_eq!(joint.prediction.counts.len(), 2 * height * width);
        assert_eq!(joint.prediction.gaussians.opacities.len(), 2 * height * width);
        // Camera 0 is the frame.
        assert_eq!(joint.prediction.cameras[0].pose.center().length(), 0.0);
        let alone =
            predictor.predict(example.context_photos(), CameraSource::Predicted, Density::default(), stream).unwrap();
        assert_ne!(alone.predicted[1].pose, joint.prediction.predicted[1].pose, "the further photo was not seen");
        // With given cameras, the geometry expert has no influence.
        let given = CameraSource::Given(example.context());
        let made = predictor.predict(example.context_photos(), given, Density::default(), stream).unwrap();
        assert_eq!(made.cameras[1].pose, example.context()[1].pose);
    }
    let three = Example::new(
        &scene,
        &Layout::of(&scene),
        weaver_data::Tuple { scene: 0, context: vec![0, 2, 3], targets: vec![1] },
    );
    let three = three.unwrap();
    let refused = two.predict(three.context_photos(), CameraSource::Predicted, Density::default(), stream);
    let refused = refused.unwrap_err().to_string();
    assert!(refused.contains("expected photos in multiples of 2, or one alone, found 3"), "{refused}");
}

/// A predictor with random weights, and a scene for it.
fn untrained() -> (TwoExpertsPredictor, [Scene; 1]) {
    let config = config(1, &[]);
    let [height, width] = TwoExpertsRecipe::image_size(&config.model);
    let scenes = [scene(4, &ProceduralOptions { width, height, views: 8 })];
    let mut params = weaver_autograd::Params::new();
    let network = Arc::new(TwoExpertsRecipe::build(&config.model, &mut params, 1));
    let predictor = TwoExpertsPredictor::new(network, params);
    (predictor, scenes)
}

#[test]
fn held_out_photos_are_drawn_from_either_camera() {
    let (mut predictor, scenes) = untrained();
    let options =
        |targets: Targets, cameras: CameraMode| Options { context_views: 2, cameras, targets, ..Options::default() };
    let mut of_four = |targets: Targets| {
        let options = Options { context_views: 4, ..options(targets, CameraMode::Predicted) };
        let found = evaluate(&mut predictor, &scenes, &options, None, &mut |_, _| {}).unwrap();
        (found.mean.psnr, found.remarks)
    };
    let ((data, _), (centers, remarks)) = (of_four(Targets::Data), of_four(Targets::Centers));
    assert!(centers.is_finite() && centers != data && remarks.is_empty(), "{data} {centers} {remarks:?}");
    let mut psnr = |targets: Targets| {
        let found = evaluate(&mut predictor, &scenes, &options(targets, CameraMode::Predicted), None, &mut |_, _| {});
        let found = found.unwrap();
        (found.cameras, found.mean.psnr)
    };
    let ((data, a), (joint, b)) = (psnr(Targets::Data), psnr(Targets::Joint));
    assert!(data == "predicted" && joint.contains("held-out photos as well"), "{data} {joint}");
    assert!(a.is_finite() && b.is_finite() && a != b);
    // Two views are on one line: nothing but camera 0's frame is left.
    let (centers, d) = psnr(Targets::Centers);
    assert!(centers.contains("by the context's centers") && d == a, "{centers} {d}");
    let (context, c) = psnr(Targets::Context);
    assert!(context.contains("judged by the context photos") && c.is_finite() && c != a, "{context}");
    let wrong = evaluate(&mut predictor, &scenes, &options(Targets::Joint, CameraMode::Given), None, &mut |_, _| {});
    assert!(wrong.unwrap_err().to_string().contains("expected predicted cameras"));
}

/// Given cameras are exact, so that an alignment can only harm them, and its figures report the harm.
///
/// Promise (results): alignment reports the errors of cameras before and after; photos may be compared by their
/// structure.
#[test]
fn aligned_cameras_are_judged_by_the_datas() {
    let (mut predictor, scenes) = untrained();
    let mut aligned = |loss: AlignLoss| {
        let steps = weaver_fit::align::Options {
            steps: 4,
            ..weaver_fit::align::Options::of(weaver_fit::align::Method::NoPoSplat)
        };
        let align = Some(Alignment { options: steps, loss });
        let options = Options { context_views: 2, cameras: CameraMode::Given, align, ..Options::default() };
        let found = evaluate(&mut predictor, &scenes, &options, None, &mut |_, _| {}).unwrap();
        assert!(found.table().contains("held-out cameras, area under the curve"));
        let figures = found.mean.aligned.unwrap();
        let [before, after] = figures.cameras;
        assert!(before.rotation_deg < 1e-5 && before.translation_deg.unwrap() < 1e-4, "{before:?}");
        assert!(before.auc.iter().all(|area| *area > 0.999), "{before:?}");
        assert!(figures.steps == 4.0 && (after.rotation_deg - figures.degrees).abs() < 1e-4, "{figures:?}");
        assert!((figures.psnr - found.mean.psnr - figures.gain_given).abs() < 1e-9);
        figures
    };
    let losses = [AlignLoss::MeanSquare, AlignLoss::Photometric, AlignLoss::Similarity];
    let [squares, both, similarity] = losses.map(&mut aligned).map(|figures| figures.degrees);
    assert!(squares != both && squares != similarity && both != similarity);
}

/// View-dependent opacities: other bits than constant ones, the same at any number of threads; each camera draws its
/// own, and a scene on disk keeps all coefficients.
///
/// Promise (results): 2Xplat's opacities may depend on the view: each camera sees its own, on the tape as in
/// predictions; files keep all numbers; slopes by camera and means go through them.
#[test]
fn opacities_may_depend_on_the_view() {
    let config = || config(8, &["model.appearance.opacity_degree=2"]);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| reports(config()).1)
    };
    let bits = on(1);
    assert_eq!(bits, on(3));
    assert_ne!(bits, reports(self::config(8, &[])).1);

    let config = config();
    let [height, width] = TwoExpertsRecipe::image_size(&config.model);
    let scene = scene(5, &ProceduralOptions { width, height, views: 6 });
    let tuple = weaver_data::Tuple { scene: 0, context: vec![0, 2], targets: vec![1] };
    let example = Example::new(&scene, &Layout::of(&scene), tuple).unwrap();
    let mut params = weaver_autograd::Params::new();
    let network = Arc::new(TwoExpertsRecipe::build(&config.model, &mut params, 1));
    let mut predictor = TwoExpertsPredictor::new(network.clone(), params.clone());
    let (stream, given) = (Stream::new(0, 0, "test"), CameraSource::Given(example.context()));
    let made = predictor.predict(example.context_photos(), given, Density::default(), stream).unwrap();
    let [first, target] =
        [example.context()[0], example.targets()[0]].map(|camera| made.seen_by(&camera).opacities.clone());
    assert!(first != target && first != made.gaussians.opacities);

    let tape = weaver_autograd::Tape::new();
    let cx = weaver_nn::Context::new(&tape, &params);
    let photos = photo_constant(cx, example.context_photos());
    let on_tape = network.gaussians(cx, photos, &camera_constants(cx, example.context()));
    let center = camera_constants(cx, example.targets()).centers();
    let expected = on_tape.seen_from(center).opacities.to_vec();
    assert!(expected.iter().zip(&target).all(|(a, b)| (a - b).abs() < 1e-5));

    let folder = tempfile::tempdir().unwrap();
    let names = [0, 2].map(|view| folder.path().join(format!("{view}.png")));
    for (name, view) in names.iter().zip([0, 2]) {
        scene.views[view].image.write_png(name).unwrap();
    }
    let out = OutputFolder::claim(folder.path().join("out"), "test", &names).unwrap();
    let report = predict_to_folder(&mut predictor, &names, &PredictOptions::default(), &out).unwrap();
    assert!(
        report.remarks.iter().any(|remark| remark.starts_with("opacities depend on the view")),
        "{:?}",
        report.remarks
    );
    let described = weaver_io::info(out.path().join("scene.safetensors")).unwrap();
    assert!(described.contains("opacity_harmonics"), "{described}");
}

#[test]
fn what_does_not_fit_is_named_with_both_numbers() {
    let cases = [
        (
            &["data.context_views=3"][..],
            "data.context_views: expected a multiple of model.appearance.group, 2, found 3",
        ),
        (&["model.width=40"], "model.width: expected a positive multiple of 16, four times appearance.patch, found 40"),
        (&["model.appearance.head=12"], "model.appearance.head: expected a positive multiple of 8, found 12"),
        (&["model.appearance.opacity_degree=1"], "model.appearance.opacity_degree: expected 0 or 2, found 1"),
        (&["stages.0.losses.opacity=1"], "stages.0.losses.opacity: expected 0 in a stage without rendered tuples"),
        (
            &["stages.1.losses.image.mse=0", "stages.1.losses.image.ssim=0", "stages.1.losses.opacity=0"],
            "stages.1.losses: expected a loss with a weight above 0, found none",
        ),
    ];
    for (settings, expected) in cases {
        let found = message(settings);
        assert!(found.contains(expected), "{found}");
    }
}

/// A checkpoint alone determines its model, which opens it.
#[test]
fn weights_are_opened_by_their_model() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.safetensors");
    let mut session = Session::new(config(5, &[])).unwrap();
    while session.advance().unwrap().is_some() {}
    session.save(&path).unwrap();
    let mut opened = Registry::default().with::<TwoExpertsRecipe>().open_weights(&path).unwrap();
    assert_eq!((opened.step, opened.predictor.max_per_pixel()), (5, 1));
    let [height, width] = opened.predictor.image_size();
    let planes = vec![0.5; 2 * 3 * height * width];
    let photos = weaver_inference::Photos { planes: &planes, inside: None, height, width };
    let stream = Stream::new(0, 0, "test");
    let made = opened.predictor.predict(photos, CameraSource::Predicted, Density::default(), stream).unwrap();
    assert_eq!(made.gaussians.opacities.len(), 2 * height * width);
}
