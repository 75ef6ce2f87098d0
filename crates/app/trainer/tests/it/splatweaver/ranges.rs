//! The range of every number of the configuration, and conditions across keys.

use std::collections::BTreeSet;
use weaver_autograd::Params;
use weaver_data::Scene;
use weaver_inference::SplatWeaverPredictor;
use weaver_model::{ModelConfig, SplatWeaver};
use weaver_router::AllocationKind;
use weaver_trainer::evaluate::{Options, evaluate};
use weaver_trainer::splatweaver::SplatWeaverRecipe;
use weaver_trainer::{CameraMode, Config, Error, Session};

type Splat = Config<SplatWeaverRecipe>;

fn resolve(preset: &str, settings: &[&str]) -> Result<Splat, Error> {
    Config::resolve(Some(preset), None, &settings.iter().map(|s| (*s).to_string()).collect::<Vec<_>>())
}

fn message(settings: &[&str]) -> String {
    resolve("micro", settings).expect_err(&settings.join(" ")).to_string()
}

/// Every key of a configuration that holds a number or several, or may hold one, with its value where it has one.
fn numbers(config: &Splat) -> BTreeSet<(String, Option<String>)> {
    let mut found = BTreeSet::new();
    let (mut table, mut stage) = (String::new(), None);
    for line in config.to_annotated_toml().lines() {
        if line == "[[stages]]" {
            stage = Some(stage.map_or(0, |i| i + 1));
        }
        if let Some(name) = line.strip_prefix('[') {
            let name = name.trim_matches(['[', ']']);
            let number = stage.map_or(String::new(), |i| format!("stages.{i}"));
            table = name.replacen("stages", &number, 1) + ".";
        } else if let Some(key) = line.strip_prefix("# ").and_then(|line| line.strip_suffix(" =")) {
            found.insert((format!("{table}{key}"), None));
        } else if let Some((key, value)) = line.split_once(" = ").filter(|_| !line.starts_with('#'))
            && value.starts_with(['[', '-', '0', '1', '2', '3', '4', '5', '6', '7', '8', '9'])
            && value != "[]"
        {
            found.insert((format!("{table}{key}"), Some(value.to_string())));
        }
    }
    found
}

/// `number` in the place of every number of `value`.
fn all_of(value: &str, number: &str) -> String {
    let count = value.split(',').count();
    if value.starts_with('[') { format!("[{}]", vec![number; count].join(", ")) } else { number.into() }
}

/// Every number has a range that is named with its key.
///
/// Promise (results): every number of the configuration has a range, checked before anything is loaded or written;
/// the error names key, range and value.
#[test]
fn every_number_has_a_named_range() {
    for preset in ["micro", "tiny-published", "tiny-endless"] {
        let keys = numbers(&Config::preset(preset).unwrap());
        assert!(keys.len() > 60, "{keys:?}");
        for (key, value) in keys {
            let mut wrong = vec!["-1"];
            match &value {
                Some(value) if value.contains(['.', 'e']) => wrong.extend(["nan", "inf", "-inf"]),
                Some(_) if key != "seed" => wrong.push("9223372036854775807"),
                _ => {}
            }
            let value = value.unwrap_or_default();
            for number in wrong {
                let setting = format!("{key}={}", all_of(&value, number));
                let text = resolve(preset, &[&setting]).expect_err(&setting).to_string();
                let said = text.strip_prefix(&format!("{setting}: ")).unwrap_or_else(|| panic!("{setting}: {text}"));
                // TOML's own errors leave out which stage it is.
                let plain = key.replace(".0.", ".").replace(".1.", ".");
                assert!((said.contains(&key) || said.contains(&plain)) && said.contains("expected"), "{text}");
            }
        }
    }
}

/// The nearest value that is out of a range, and one that is in it.
const EDGES: [(&str, &str, &str); 36] = [
    ("optimizer.beta1", "1", "0"),
    ("optimizer.beta2", "1.5", "0"),
    ("optimizer.epsilon", "0", "1e-12"),
    ("optimizer.weight_decay", "1.5", "0"),
    ("optimizer.clip", "0", "1e9"),
    ("optimizer.ema", "1", "0.5"),
    ("optimizer.ema", "0", "none"),
    ("stages.0.rate", "0", "1e-9"),
    ("stages.0.floor", "1.1", "1"),
    ("stages.0.steps", "1000000001", "0"),
    ("stages.1.tuples", "10001", "2"),
    ("stages.1.model.pose_tuples", "10001", "0"),
    ("stages.1.model.budget", "1.5", "1"),
    ("stages.1.model.backbone_rate", "-0.1", "0"),
    ("stages.1.losses.image.mse", "-0.1", "0"),
    ("stages.1.losses.image.ssim", "-0.1", "0"),
    ("stages.1.losses.pose.l1", "-0.1", "0"),
    ("stages.1.losses.pose.huber", "-0.1", "0"),
    ("stages.1.losses.pose.absolute", "-0.1", "0"),
    ("stages.1.losses.depth.log_l1", "-0.1", "0"),
    ("stages.1.losses.depth.rendered", "-0.1", "0"),
    ("stages.1.losses.router.rank", "-0.1", "0"),
    ("stages.1.losses.router.rank_until", "1.1", "1"),
    ("stages.1.losses.router.label_smoothing", "1.1", "1"),
    ("stages.1.losses.router.rank_quantiles", "[0.5, 0.6, 1.1]", "[0, 0.5, 1]"),
    ("stages.1.losses.router.budget_shares", "[-0.1, 0, 0]", "[0, 0, 1]"),
    ("stages.1.losses.router.budget_limit", "-0.1", "0"),
    ("stages.1.model.budgets", "[0.5, 1.1]", "[0, 1]"),
    ("evaluation.budget", "1.1", "0"),
    ("data.context_views", "1", "3"),
    ("data.target_views", "0", "1"),
    ("data.scene_scale", "0", "1e-6"),
    ("data.endless", "0", "1"),
    ("output.log_every", "0", "1"),
    ("threads", "1025", "1024"),
    ("threads", "0", "none"),
];

#[test]
fn closed_choices_are_listed_beside_their_key() {
    let text = Config::<SplatWeaverRecipe>::preset("tiny").unwrap().to_annotated_toml();
    assert!(text.contains("One of: predicted: The network's own; given: The data's."), "{text}");
}

#[test]
fn ranges_end_where_they_should() {
    for (key, wrong, right) in EDGES {
        let said = message(&[&format!("{key}={wrong}")]);
        assert!(said.contains(&format!(": {key}")) && said.contains("expected"), "{said}");
        let setting = format!("{key}={right}");
        assert!(resolve("micro", &[&setting]).is_ok(), "{:?}", resolve("micro", &[&setting]));
    }
}

/// Promise (results): combinations that cannot work are refused before training begins.
#[test]
fn contradictions_are_refused_before_the_start() {
    for (settings, parts) in [
        (&["stages.1.model.allocation=fixed:9"][..], ["stages.1.model.allocation", "at most 3", "fixed:9"]),
        (&["evaluation.allocation=fixed:4"], ["evaluation.allocation", "at most 3", "fixed:4"]),
        (&["stages.1.model.budgets=[]"], ["stages.1.model.budgets", "at least one", "none"]),
        (&["stages.1.losses.router.budget=0.01"], ["stages.1.losses.router.budget", "mix", "found 0.01"]),
        (
            &["stages.1.model.allocation=dithered", "stages.1.losses.router.budget=0.01"],
            ["stages.1.losses.router.budget", "dithered", "found 0.01"],
        ),
        (&["stages.0.losses.image.mse=1"], ["stages.0.losses.image.mse", "without rendered tuples", "found 1"]),
        (&["stages.0.losses.pose.l1=0", "stages.0.losses.pose.absolute=0"], ["stages.0.losses", "above 0", "none"]),
        (&["stages.1.losses.image.lpips=1"], ["stages.1.losses.image.lpips_weights", "file", "nothing"]),
        (&["stages.1.losses.image.perceptual=1"], ["stages.1.losses.image.perceptual_weights", "file", "nothing"]),
        (&["data.pool=1"], ["data.pool", "2", "found 1"]),
        (&["data.endless=5", "data.folders=[\"fox\"]"], ["data.endless", "data.folders", "none"]),
        (
            &["model.patch=2", "model.width=10", "model.height=32"],
            ["expected images of at least 11 x 11", "SSIM", "10 x 32"],
        ),
        (
            &["stages.1.losses.router.rank_quantiles=[0.9, 0.5, 0.95]"],
            ["rank_quantiles", "do not fall", "[0.9, 0.5, 0.95]"],
        ),
        (&["stages.1.losses.router.budget_shares=[0.9, 0.5, 0]"], ["budget_shares", "at most 1", "[0.9, 0.5, 0.0]"]),
    ] {
        let said = message(settings);
        assert!(parts.iter().all(|part| said.contains(part)), "{said}");
    }
    let budget = ["stages.1.model.allocation=sampled", "stages.1.losses.router.budget=0.01"];
    assert!(resolve("micro", &budget).is_ok());
}

#[test]
fn a_ranking_loss_that_ends_leaves_another() {
    let off = ["image.mse", "image.ssim", "pose.l1", "pose.absolute", "depth.log_l1", "router.error_regression"];
    let mut settings: Vec<String> = off.iter().map(|name| format!("stages.1.losses.{name}=0")).collect();
    settings.push("stages.1.losses.router.rank=1".into());
    let said = Splat::resolve(Some("micro"), None, &settings).unwrap_err().to_string();
    assert!(said.contains("stages.1.losses: expected a loss with a weight above 0 at every step"), "{said}");
    settings.push("stages.1.losses.router.rank_until=1".into());
    assert!(Splat::resolve(Some("micro"), None, &settings).is_ok());
}

#[test]
fn stages_share_one_file_of_lpips_weights() {
    let mut config = Splat::preset("micro").unwrap();
    config.stages.push(config.stages[1].clone());
    for (stage, file) in [(1, "a"), (2, "b")] {
        let image = &mut config.stages[stage].losses.image;
        (image.lpips, image.lpips_weights) = (0.1, Some(file.into()));
    }
    let said = config.check().unwrap_err().to_string();
    assert!(said.contains("stages.2: lpips_weights") && said.contains("stages.1, a, found b"), "{said}");
    // A file of a stage that does not measure it is of no account.
    config.stages[2].losses.image.lpips = 0.0;
    config.check().unwrap();
}

/// A configuration that was made in code is checked, too.
#[test]
fn a_session_begins_with_checked_numbers_only() {
    let mut config = Splat::preset("micro").unwrap();
    config.optimizer.clip = -1.0;
    let said = Session::new(config).unwrap_err().to_string();
    assert!(said.contains("optimizer.clip: expected more than 0, found -1"), "{said}");
}

/// Promise (results): a preset is chosen by name or refused.
#[test]
fn a_preset_is_chosen_by_name_or_refused() {
    let said = message(&["preset=small"]);
    assert!(said.contains("preset=small: preset: expected") && said.contains("--preset"), "{said}");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.toml");
    std::fs::write(&path, "preset = 5\n").unwrap();
    for preset in [None, Some("micro")] {
        let said = Splat::resolve(preset, Some(&path), &[]).unwrap_err().to_string();
        assert!(said.contains("c.toml: preset: expected string, found integer `5`"), "{said}");
    }
}

/// Weights from a file come without a configuration that was checked.
#[test]
fn images_below_the_window_are_refused() {
    let mut config = ModelConfig::preset("micro").unwrap();
    (config.patch, config.width) = (2, 10);
    let mut params = Params::new();
    let model = SplatWeaver::new(config, &mut params, 0);
    let mut predictor = SplatWeaverPredictor::new(model, params, AllocationKind::Dithered, 0.5);
    let options = Options { context_views: 2, cameras: CameraMode::Predicted, ..Options::default() };
    let none: [Scene; 0] = [];
    let said = evaluate(&mut predictor, &none, &options, None, &mut |_, _| {}).unwrap_err().to_string();
    assert!(said.contains("at least 11 x 11") && said.contains("10 x 32"), "{said}");
}
