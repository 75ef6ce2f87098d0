//! Configurations: presets, files, settings, and their documentation.

use weaver_model::ParametrizationConfig;
use weaver_trainer::splatweaver::SplatWeaverRecipe;
use weaver_trainer::{CameraMode, Config, Recipe};

fn message(settings: &[&str]) -> String {
    let settings: Vec<String> = settings.iter().map(|s| (*s).to_string()).collect();
    Config::<SplatWeaverRecipe>::resolve(Some("micro"), None, &settings).unwrap_err().to_string()
}

#[test]
fn settings_reach_their_place() {
    let settings =
        ["stages.1.rate=1", "model.width=64", "stages.1.model.allocation=sampled", "data.folders=[\"a\", \"b\"]"];
    let config = Config::<SplatWeaverRecipe>::resolve(Some("micro"), None, &settings.map(String::from)).unwrap();
    assert_eq!(
        (config.stages[1].rate, config.model.width, config.stages[1].model.allocation.to_string()),
        (1.0, 64, "sampled".to_string())
    );
    assert_eq!(config.data.folders.len(), 2);
}

/// Settings are switched off and on and tables change their kind.
#[test]
fn settings_switch_and_tables_change_kind() {
    let published = "{ kind = \"published\", offset_reach = 0.035, scale_multiplier = 0.007, scale_max = 0.4 }";
    let settings = [
        "model.dense.log_depth_limit=none".to_string(),
        "model.backbone.position_table=[5, 7]".to_string(),
        format!("model.gaussians.parametrization={published}"),
    ];
    let model = Config::<SplatWeaverRecipe>::resolve(Some("micro"), None, &settings).unwrap().model;
    assert_eq!((model.dense.log_depth_limit, model.backbone.position_table), (None, Some([5, 7])));
    let expected = ParametrizationConfig::Published { offset_reach: 0.035, scale_multiplier: 0.007, scale_max: 0.4 };
    assert_eq!(model.gaussians.parametrization, expected);
    let text = message(&["model.gaussians.parametrization.kind=published"]);
    assert!(text.contains("scale"), "{text}");
}

#[test]
fn wrong_settings_are_explained() {
    assert!(message(&["model.widht=64"]).contains("unknown key `model.widht`; did you mean `width`?"));
    assert!(message(&["model.width=wide"]).contains("model.width: expected integer, found string"));
    assert!(
        message(&["model.width=-8"]).contains("`-8`, expected usize in `model.width`"),
        "{}",
        message(&["model.width=-8"])
    );
    assert!(message(&["stages.7.rate=1"]).contains("expected an index below 2, found `7`"));
    assert!(message(&["seed"]).contains("expected key=value"));
}

#[test]
fn files_lie_between_preset_and_flags() {
    let folder = std::env::temp_dir().join(format!("weaver-config-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("c.toml");
    std::fs::write(&path, "preset = \"micro\"\nseed = 3\n[model]\nwidth = 64\n[[stages]]\nsteps = 5\n").unwrap();
    let config = Config::<SplatWeaverRecipe>::resolve(None, Some(&path), &["seed=4".into()]).unwrap();
    assert_eq!((config.preset.as_str(), config.seed, config.model.width), ("micro", 4, 64));
    assert_eq!((config.stages.len(), config.stages[0].steps), (1, 5));
    std::fs::write(&path, "[model]\nbackbone = 3\n").unwrap();
    let text = Config::<SplatWeaverRecipe>::resolve(None, Some(&path), &[]).unwrap_err().to_string();
    assert!(text.contains("c.toml") && text.contains("model.backbone: expected table"), "{text}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn endless_scenes_have_no_frame_of_their_own() {
    let config = Config::<SplatWeaverRecipe>::resolve(Some("micro"), None, &["data.endless=5".into()]).unwrap();
    assert!(config.stages.iter().all(|s| s.losses.pose.absolute == 0.0 && s.losses.pose.l1 > 0.0));
}

/// The endless preset trains the tiny network with given cameras and views compared.
#[test]
fn the_endless_preset() {
    let [endless, tiny] = ["tiny-endless", "tiny"].map(|name| Config::<SplatWeaverRecipe>::preset(name).unwrap());
    let mut without_stereo = endless.model.clone();
    assert!(without_stereo.dense.stereo.take().is_some(), "it compares views");
    assert_eq!(without_stereo, tiny.model);
    assert!(endless.data.endless.is_some() && tiny.data.endless.is_none());
    for stage in &endless.stages {
        assert_eq!((stage.model.cameras, stage.model.pose_tuples), (CameraMode::Given, 0));
        // The camera head needs gradients; scenes that do not come back have no frame of their own.
        assert!(stage.losses.pose.l1 > 0.0 && stage.losses.pose.absolute == 0.0);
    }
}

#[test]
fn a_resolved_config_survives_its_file() {
    for preset in SplatWeaverRecipe::PRESETS {
        let config = Config::<SplatWeaverRecipe>::preset(preset).unwrap();
        assert_eq!(Config::<SplatWeaverRecipe>::from_toml(&config.to_toml(), "x").unwrap(), config);
    }
}

#[test]
fn steps_rescale_in_proportion() {
    let mut config = Config::<SplatWeaverRecipe>::preset("tiny").unwrap();
    let ratio = config.stages[0].steps as f64 / config.steps() as f64;
    config.rescale(100);
    assert_eq!(config.steps(), 100);
    assert!((config.stages[0].steps as f64 - 100.0 * ratio).abs() <= 1.0);
}
