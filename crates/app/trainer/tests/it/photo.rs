//! The photo network through the trainer, on its micro preset: bits, losses, evaluation and refusals.

use crate::Silent;
use crate::same_bits::same_bits;
use std::sync::atomic::AtomicBool;
use weaver_trainer::photo::PhotoRecipe;
use weaver_trainer::{Config, ConfigSource, EvalOptions, Registry, Session, Source, create_run};

fn config(steps: usize) -> Config<PhotoRecipe> {
    let mut config = Config::resolve(Some("micro"), None, &[]).unwrap();
    config.rescale(steps);
    config
}

/// A resumed run of the photo network equals an uninterrupted one, at any number of threads.
///
/// Promise (results): the photo network trains to the same bits at any number of threads and after an interruption.
#[test]
fn the_photo_network_trains_to_the_same_bits() {
    let report = Session::new(config(1)).unwrap().advance().unwrap().unwrap();
    let names: Vec<&str> = report.group("loss").map(|(name, _)| name).collect();
    assert_eq!(names, ["depth", "ssim", "l1", "error_regression"]);
    same_bits(|| config(5), [1, 2, 4]);
}

/// A preset's name finds its model; a name that several models have is the first one's.
#[test]
fn a_preset_finds_its_model() {
    let registry = Registry::default();
    let found = |name, preset| registry.find_for(name, preset).map(|entry| entry.name()).unwrap();
    assert_eq!(found(None, Some("photo-64")), "photo");
    assert_eq!(found(None, Some("micro")), "splatweaver");
    assert_eq!(found(Some("photo"), Some("micro")), "photo");
    assert_eq!((found(None, None), found(None, Some("nonsense"))), ("splatweaver", "splatweaver"));
}

/// From training to evaluation and use: given cameras come with their points, without a flag.
#[test]
fn a_run_is_evaluated_with_points() {
    let parent = tempfile::tempdir().unwrap();
    let registry = Registry::default();
    let recipe = registry.find(Some("photo")).unwrap();
    let source = ConfigSource { preset: Some("micro".into()), steps: Some(2), ..ConfigSource::default() };
    let config = recipe.resolve(&source).unwrap();
    let folder = create_run(&parent.path().join("run"), &config).unwrap();
    let summary = recipe.start(&config).unwrap().train(&folder, &mut Silent, &AtomicBool::new(false)).unwrap();
    let evaluation = summary.evaluation.unwrap();
    assert!(evaluation.points && evaluation.mean.psnr > evaluation.mean.psnr_mean_color, "{:?}", evaluation.mean);
    let path = folder.path().join("checkpoint.safetensors");
    let mut run = registry.open_weights(&path).unwrap();
    assert!(run.predictor.needs_points() && run.predictor.resizable().is_some());
    let options = EvalOptions { cameras: Some(weaver_trainer::CameraMode::Given), ..EvalOptions::default() };
    let unseen = run.evaluate(&Source::Unseen, &options, &mut |_, _| {}).unwrap();
    assert!(unseen.points && unseen.mean.gaussians_per_pixel > 0.05);
}

#[test]
fn wrong_settings_of_the_photo_network_are_named() {
    for (settings, said) in [
        (vec!["data.folders=[\"fox\"]", "data.endless=none"], "data.folders: expected none"),
        (vec!["stages.0.tuples=0"], "stages.0.tuples: expected a step to have tuples"),
        (vec!["stages.0.losses.router.budget=1"], "losses.router.budget: expected 0"),
        (vec!["evaluation.allocation=square"], "evaluation.allocation"),
        (
            vec!["stages.0.losses.l1=0", "stages.0.losses.depth=0", "stages.0.losses.image.ssim=0"],
            "expected a loss on pictures or depth",
        ),
    ] {
        let settings: Vec<String> = settings.into_iter().map(String::from).collect();
        let resolved = Config::<PhotoRecipe>::resolve(Some("micro"), None, &settings);
        let message = resolved.and_then(|config| config.check()).unwrap_err().to_string();
        assert!(message.contains(said), "{message}");
    }
}
