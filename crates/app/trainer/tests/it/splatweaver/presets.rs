//! Every preset trains, made small where it must be; and settings of single presets take effect.

use super::switch_off::{everything, everything_built_in, reports, term};
use crate::capture;
use weaver_trainer::scenes::Endless;
use weaver_trainer::splatweaver::SplatWeaverRecipe;
use weaver_trainer::{Recipe, Session, StepReport};

type Config = weaver_trainer::Config<SplatWeaverRecipe>;

/// Settings that make a preset quick; its choices stay.
const SMALL: [&str; 17] = [
    "model.width=32",
    "model.height=32",
    "model.patch=8",
    "model.backbone.dim=24",
    "model.backbone.encoder_depth=1",
    "model.backbone.encoder_heads=2",
    "model.backbone.heads=2",
    "model.backbone.rounds=4",
    "model.camera.depth=1",
    "model.camera.heads=4",
    "model.camera.iterations=2",
    "model.dense.out_channels=[4, 8, 8, 8]",
    "model.dense.features=8",
    "model.dense.channels=8",
    "model.gaussians.neighbors=2",
    "data.context_views=2",
    "data.pool=4",
];

fn shrunk(preset: &str, settings: &[&str]) -> Config {
    let settings: Vec<String> = SMALL.iter().chain(settings).map(|s| s.to_string()).collect();
    let mut config = Config::resolve(Some(preset), None, &settings).unwrap();
    // Scenes without end take no captures beside them.
    if config.data.endless.is_none() {
        config.data.folders = capture::folders();
    }
    config.rescale(4);
    // In proportion a short stage would have none.
    config.stages.iter_mut().for_each(|stage| stage.steps = stage.steps.max(1));
    config
}

/// Promise of `every_preset_trains`.
#[test]
fn every_preset_trains_all_its_experts() {
    for preset in SplatWeaverRecipe::PRESETS {
        let config = Config::resolve(Some(preset), None, &[]).unwrap();
        let experts: Vec<u8> = (1..=config.model.gaussians.max_per_pixel as u8).collect();
        assert_eq!(SplatWeaverRecipe::trained_experts(&config), experts, "{preset}");
    }
}

fn names(report: &StepReport) -> Vec<&str> {
    report.group("loss").map(|(name, _)| name).collect()
}

/// Promise (options): every preset trains, and all its experts; the dagger with a third of the Gaussians.
#[test]
fn every_preset_trains() {
    for preset in SplatWeaverRecipe::PRESETS {
        let config = shrunk(preset, &[]);
        let stages: Vec<String> = config.stages.iter().map(|stage| stage.name.clone()).collect();
        let mut session = Session::new(config).unwrap();
        let before = session.checksum();
        let mut found: Vec<StepReport> = Vec::new();
        while let Some(report) = session.advance().unwrap() {
            found.push(report);
        }
        assert_ne!(session.checksum(), before, "{preset}");
        let reached: Vec<&str> = found.iter().map(|r| r.stage.as_str()).collect();
        assert!(
            reached.len() >= 4 && stages.iter().all(|name| reached.contains(&name.as_str())),
            "{preset}: {reached:?}"
        );
        for report in &found {
            assert!(report.loss.is_finite() && report.scalar("gradient_norm") > Some(0.0), "{preset}: {report:?}");
            assert_eq!(
                report.scalar("gaussians_per_pixel") > Some(0.0),
                report.stage != "poses",
                "{preset}: {report:?}"
            );
        }
        let published = names(found.last().unwrap()).contains(&"rank") || names(&found[0]).contains(&"rank");
        assert_eq!(published, ["tiny-published", "tiny-dagger"].contains(preset), "{preset}");
    }
}

#[test]
fn endless_scenes_are_fresh_ones() {
    let losses = |settings: &[&str]| -> Vec<f64> {
        let config = everything_built_in(2, settings);
        reports(config).iter().map(|report| report.loss).collect()
    };
    let (fixed, endless) = (losses(&[]), losses(&["data.endless=1"]));
    assert!(fixed.iter().zip(&endless).all(|(a, b)| a != b), "{fixed:?} {endless:?}");

    let config = everything_built_in(1, &["data.endless=2"]);
    let mut scenes = Endless::new(&config.data, SplatWeaverRecipe::image_size(&config.model), 0);
    let mut photos = |step: usize| -> Vec<Vec<f32>> {
        let (scenes, layouts) = scenes.scenes(step).unwrap();
        for (scene, layout) in scenes.iter().zip(layouts) {
            assert_eq!((layout.scene(), layout.training_views()), (scene.name.as_str(), &scene.training_views()[..]));
        }
        scenes.iter().map(|scene| scene.views[0].image.pixels.clone()).collect()
    };
    let (first, second, third) = (photos(0), photos(1), photos(2));
    assert_eq!(first, second);
    let changed = first.iter().zip(&third).filter(|(a, b)| a != b).count();
    assert_eq!((first.len(), changed), (16, 1), "one of sixteen at every second step");
}

/// Given cameras replace the network's predictions of them altogether.
#[test]
fn given_cameras_replace_predicted_ones() {
    // With a camera head that moves, renders from predicted cameras change; renders from given cameras do not.
    let mse = |cameras: &str, gain: &str| -> f32 {
        let config = everything(
            1,
            &[
                &format!("stages.1.model.cameras={cameras}"),
                &format!("model.camera.base_fov={gain}"),
                "stages.1.model.allocation=grid",
            ],
        );
        term(&reports(config)[0], "mse").unwrap()
    };
    assert_eq!(mse("given", "0.8"), mse("given", "1.1"));
    assert_ne!(mse("predicted", "0.8"), mse("predicted", "1.1"));
}

#[test]
fn targets_are_rendered_or_not() {
    let mse = |targets: bool, views: usize| -> f32 {
        let settings = [format!("stages.1.model.render_targets={targets}"), format!("data.target_views={views}")];
        term(&reports(everything(1, &[&settings[0], &settings[1]]))[0], "mse").unwrap()
    };
    assert_eq!(mse(false, 1), mse(false, 2), "targets are not looked at");
    assert_ne!(mse(true, 1), mse(true, 2));
    assert_ne!(mse(true, 1), mse(false, 1));
}

/// Promise (options): every form of a budget trains and is kept.
#[test]
fn every_form_of_the_budget_trains() {
    let budgets = |form: &str| -> Vec<f32> {
        let settings = [
            "stages.1.model.allocation=sampled",
            "stages.1.losses.router.rank=0.01",
            "stages.1.losses.router.budget=0.01",
            "stages.1.losses.router.budget_limit=0.1",
            &format!("stages.1.losses.router.budget_form={form}"),
        ];
        let mut config = everything(4, &settings);
        // With hardly any learning, steps differ by their tuples and noise alone.
        config.stages[0].rate = 1e-30;
        reports(config).iter().map(|report| term(report, "budget").unwrap()).collect()
    };
    let [shares, limit, both] = ["shares", "limit", "shares-then-limit"].map(budgets);
    assert!(shares.iter().zip(&limit).all(|(a, b)| a != b && *a > 0.0 && *b > 0.0), "{shares:?} {limit:?}");
    assert_eq!((&both[..2], &both[2..]), (&shares[..2], &limit[2..]));
}

/// Promise of `every_preset_trains`.
#[test]
fn the_dagger_asks_for_a_third_of_the_gaussians() {
    let router = |preset: &str| shrunk(preset, &[]).stages[0].losses.router.clone();
    let (all, few) = (router("tiny-published"), router("tiny-dagger"));
    let asked = |shares: &[f64]| (1..).zip(shares).map(|(count, share)| f64::from(count) * share).sum::<f64>();
    let ranked = |quantiles: &[f64]| quantiles.iter().map(|q| 1.0 - q).sum::<f64>();
    for (router, count) in [(&all, 0.3), (&few, 0.1)] {
        assert!((asked(&router.budget_shares) - count).abs() < 1e-9, "{router:?}");
        assert!((ranked(&router.rank_quantiles) - count).abs() < 1e-9, "{router:?}");
        assert_eq!(router.budget_limit, count);
    }
}
