//! The trainer with a foreign model, the example's, and with its own, SplatWeaver.

#[path = "../../examples/pixel_cnn.rs"]
#[allow(dead_code, reason = "the example's own main is not called here")]
mod pixel_cnn;

mod augmentation;
mod capture;
#[path = "../../../../scene/io/tests/it/mutations.rs"]
mod mutations;
mod photo;
mod ranks;
mod resuming;
mod same_bits;
mod scale;
mod splatweaver;

use pixel_cnn::PixelCnnRecipe;
use std::sync::atomic::AtomicBool;
use weaver_trainer::{
    Config, ConfigSource, DataConfig, Error, EvalOptions, Example, Observer, Registry, Session, Source, StepReport,
    claim_run, create_run,
};

/// A configuration of `steps` steps on photos of 16 x 16 pixels.
fn config(steps: usize) -> Config<PixelCnnRecipe> {
    let settings = ["model.size=[16, 16]", "model.channels=4"].map(String::from);
    let mut config = Config::resolve(None, None, &settings).unwrap();
    config.rescale(steps);
    config
}

#[test]
fn a_resumed_run_equals_an_uninterrupted_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.safetensors");
    let mut first = Session::new(config(6)).unwrap();
    (0..3).for_each(|_| _ = first.advance().unwrap().unwrap());
    first.save(&path).unwrap();
    let mut second = Session::resume(config(6), &path).unwrap();
    assert_eq!(second.steps(), (3, 6));
    for session in [&mut first, &mut second] {
        while session.advance().unwrap().is_some() {}
    }
    assert_eq!(first.checksum(), second.checksum());
}

/// The kept scenes at a step do not depend on the step at which the run was resumed.
#[test]
fn resumed_runs_on_endless_scenes_are_equal() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.safetensors");
    let endless = |every| Config { data: DataConfig { endless: Some(every), ..config(7).data }, ..config(7) };
    let mut first = Session::new(endless(2)).unwrap();
    (0..3).for_each(|_| _ = first.advance().unwrap().unwrap());
    first.save(&path).unwrap();
    let mut second = Session::resume(endless(2), &path).unwrap();
    let [mut faster, mut fixed] = [endless(1), config(7)].map(|config| Session::new(config).unwrap());
    for session in [&mut first, &mut second, &mut faster, &mut fixed] {
        while session.advance().unwrap().is_some() {}
    }
    assert_eq!(first.checksum(), second.checksum());
    assert_ne!(first.checksum(), faster.checksum());
    assert_ne!(first.checksum(), fixed.checksum());
    assert!(first.plan().contains("fresh scenes for training") && !fixed.plan().contains("fresh scenes"));
}

/// A decay is not 0 where there is no average: there is none, and the weights themselves are evaluated.
#[test]
fn without_an_average_weights_are_stored() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.safetensors");
    let stored = |ema| {
        let settings: [String; 2] = [format!("optimizer.ema={ema}"), "threads=none".into()];
        let config = Config::resolve(None, None, &settings).unwrap();
        let mut session = Session::<PixelCnnRecipe>::new(Config { model: self::config(1).model, ..config }).unwrap();
        (0..2).for_each(|_| _ = session.advance().unwrap().unwrap());
        session.save(&path).unwrap();
        let tensors = weaver_io::safetensors::Tensors::read(&path).unwrap().tensors;
        let values = |set: &str| tensors[&format!("{set}.layers.0.weight")].data.clone();
        values("ema") == values("param")
    };
    assert!(stored("none") && !stored("0.9"));
    let text = config(1).to_toml();
    assert!(!text.contains("threads"), "{text}");
    let message = Config::<PixelCnnRecipe>::resolve(None, None, &["optimizer.ema=0".into()]).unwrap_err().to_string();
    assert!(message.contains("optimizer.ema") && message.contains("found 0"), "{message}");
}

#[test]
fn the_parts_of_a_step_make_a_step() {
    let (mut whole, mut parts) = (Session::new(config(2)).unwrap(), Session::new(config(2)).unwrap());
    whole.advance().unwrap();
    let pending = parts.gradients().unwrap().unwrap();
    // Two processes with the same gradient: their mean is that gradient.
    let mut seen = 0;
    parts.reduce(|gradient| {
        seen += gradient.len();
        gradient.iter_mut().for_each(|g| *g = (*g + *g) / 2.0);
    });
    assert_eq!(seen, parts.params().count());
    parts.update(pending).unwrap();
    assert_eq!(whole.checksum(), parts.checksum());
    // Gradients changed by a reduction reach the update.
    let mut doubled = Session::new(config(2)).unwrap();
    let pending = doubled.gradients().unwrap().unwrap();
    doubled.reduce(|gradient| gradient.iter_mut().for_each(|g| *g = -*g));
    doubled.update(pending).unwrap();
    assert_ne!(whole.checksum(), doubled.checksum());
}

struct Silent;

impl Observer for Silent {
    fn step(&mut self, _: &StepReport) -> Result<(), Error> {
        Ok(())
    }
}

#[test]
fn a_name_finds_the_model_from_training_to_evaluation() {
    let parent = tempfile::tempdir().unwrap();
    let registry = Registry::empty().with::<PixelCnnRecipe>();
    let settings = ["model.size=[16, 16]", "model.channels=4"].map(String::from).to_vec();
    let recipe = registry.find(Some("pixel-cnn")).unwrap();
    let config = recipe.resolve(&ConfigSource { settings, steps: Some(3), ..ConfigSource::default() }).unwrap();
    let folder = create_run(&parent.path().join("run"), &config).unwrap();
    let written = weaver_inference::RunFolder::at(folder.path());
    let summary = recipe.start(&config).unwrap().train(&folder, &mut Silent, &AtomicBool::new(false)).unwrap();
    assert_eq!((summary.steps, summary.evaluation.unwrap().allocation), (3, None));
    assert!(written.path().join("report.html").is_file());

    let mut run = registry.of_run(&written).unwrap().open(&written).unwrap();
    let found = run.evaluate(&Source::Unseen, &EvalOptions::default(), &mut |_, _| {}).unwrap();
    let masks = EvalOptions { masks: true, ..EvalOptions::default() };
    for source in [Source::Unseen, Source::Run] {
        let message = run.evaluate(&source, &masks, &mut |_, _| {}).unwrap_err().to_string();
        assert!(message.contains("masks: expected captures"), "{message}");
    }
    assert_eq!((found.mean.gaussians_per_pixel, &found.mean.expert_share[..]), (1.0, &[0.0, 1.0][..]));
    let refused = claim_run(folder.path(), &config).unwrap_err();
    assert!(matches!(refused, Error::Run(weaver_run::Error::RunExists { .. })), "{refused}");
}

#[test]
fn an_unknown_model_is_named_beside_those_there_are() {
    let registry = Registry::empty().with::<PixelCnnRecipe>();
    let message = registry.find(Some("pixel-rnn")).unwrap_err().to_string();
    assert!(message.contains("pixel-rnn") && message.contains("pixel-cnn"), "{message}");
    // A run of another model.
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("config.toml"), "architecture = \"other\"\n").unwrap();
    let message = registry.of_run(&weaver_inference::RunFolder::at(folder.path())).unwrap_err().to_string();
    assert!(message.contains("config.toml") && message.contains("other"), "{message}");
}

#[test]
fn optional_keys_are_set_unset_and_documented() {
    let resolve = |settings: &[&str]| {
        let settings: Vec<String> = settings.iter().map(|s| (*s).into()).collect();
        Config::<PixelCnnRecipe>::resolve(None, None, &settings)
    };
    let set = resolve(&["data.endless=5", "data.scene_scale=2"]).unwrap();
    assert_eq!((set.data.endless, set.data.scene_scale), (Some(5), Some(2.0)));
    let unset = resolve(&["data.endless=5", "data.endless=none"]).unwrap();
    assert_eq!(unset.data.endless, None);
    for (setting, parts) in [
        ("data.endless=0", ["data.endless", "found 0"]),
        ("data.endles=5", ["data.endles", "did you mean `endless`"]),
        ("data.endless=often", ["data.endless=often", "usize"]),
        ("data.scene_scale=-1", ["data.scene_scale", "-1"]),
    ] {
        let message = resolve(&[setting]).unwrap_err().to_string();
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    }

    let text = set.to_annotated_toml();
    assert_eq!(Config::from_toml(&text, "text").unwrap(), set);
    let above = |key: &str| {
        let lines: Vec<&str> = text.lines().collect();
        let at = lines.iter().position(|line| line.starts_with(key)).unwrap();
        lines[at - 1].to_string()
    };
    assert_eq!(above("steps ="), "# Optimizer steps. Range: 0 to 1000000000.");
    assert!(above("# lpips_weights =").starts_with("# File with"), "{text}");
}

/// Times and numbers of a capture's photos reach the losses, context first, then targets.
#[test]
fn times_and_numbers_reach_the_examples() {
    let mut scene = weaver_procedural::default_unseen_set(16, 16).swap_remove(0);
    for (view, i) in scene.views.iter_mut().zip(0_u64..) {
        (view.time, view.number) = ((i % 2 == 1).then_some(i as f64 / 4.0), (i != 5).then_some(10 + i));
    }
    let tuple = weaver_data::Tuple { scene: 0, context: vec![4, 1], targets: vec![5, 3] };
    let layout = weaver_data::Layout::of(&scene);
    let training = Example::new(&scene, &layout, tuple.clone()).unwrap();
    let (evaluation, _) = Example::for_evaluation(&scene, tuple).unwrap();
    for example in [training, evaluation] {
        assert_eq!(example.times, [None, Some(0.25), Some(1.25), Some(0.75)]);
        assert_eq!(example.numbers, [Some(14), Some(11), None, Some(13)]);
        assert_eq!(example.photos().views(), 4);
    }
}

/// A predictor that needs cameras reports this, and its size of photos.
#[test]
fn pixel_predictors_say_what_they_need() {
    use weaver_inference::{CameraSource, Density, Photos, PixelAlignedPredictor, Predictor};
    let config = config(1);
    let mut params = weaver_autograd::Params::new();
    let network = <PixelCnnRecipe as weaver_trainer::Recipe>::build(&config.model, &mut params, 0);
    let mut predictor = PixelAlignedPredictor::new(std::sync::Arc::new(network), params);
    let mut refused = |planes: &[f32], width| {
        let (photos, stream) =
            (Photos { planes, inside: None, height: 16, width }, weaver_kernels::random::Stream::new(0, 0, ""));
        predictor.predict(photos, CameraSource::Predicted, Density::default(), stream).unwrap_err().to_string()
    };
    let planes = vec![0.5; 3 * 16 * 32];
    assert!(refused(&planes, 32).contains("expected photos of 16x16 pixels, found 1 of 32x16"));
    assert!(refused(&planes, 16).contains("expected given cameras"));
}
