//! The ranking loss that ends at half time.

use crate::capture;
use weaver_autograd::{Params, Tape};
use weaver_data::{Layout, training_tuple};
use weaver_kernels::random::Stream;
use weaver_losses::{global_budget, ranking_cross_entropy, share_budget};
use weaver_model::SplatWeaver;
use weaver_nn::Context;
use weaver_router::Sampled;
use weaver_splat::WorkspacePool;
use weaver_trainer::losses::ImageNetworks;
use weaver_trainer::splatweaver::{BudgetForm, Objective, SplatWeaverRecipe};
use weaver_trainer::{Example, Recipe, Session, StepReport, scenes};

type Config = weaver_trainer::Config<SplatWeaverRecipe>;

/// The stage `everything` alone, a number of steps long, on captures.
pub fn everything(steps: usize, settings: &[&str]) -> Config {
    let mut config = everything_built_in(steps, settings);
    config.data.folders = capture::folders();
    config
}

/// The stage `everything` alone, a number of steps long, on the built-in scenes or the scenes of the settings.
pub fn everything_built_in(steps: usize, settings: &[&str]) -> Config {
    let settings: Vec<String> = settings.iter().map(|s| s.to_string()).collect();
    let mut config = Config::resolve(Some("micro"), None, &settings).unwrap();
    config.stages.remove(0);
    config.stages[0].steps = steps;
    config
}

fn with_ranking(steps: usize, budget_limit: f64) -> Config {
    let mut config = everything(steps, &["stages.1.model.allocation=sampled"]);
    let losses = &mut config.stages[0].losses.router;
    (losses.rank, losses.budget, losses.rank_until, losses.budget_limit) = (0.01, 0.01, 0.5, budget_limit);
    losses.budget_form = BudgetForm::SharesThenLimit;
    config
}

pub fn reports(config: Config) -> Vec<StepReport> {
    let mut session = Session::new(config).unwrap();
    std::iter::from_fn(|| session.advance().unwrap()).collect()
}

pub fn term(report: &StepReport, name: &str) -> Option<f32> {
    report.scalar(&format!("loss/{name}")).map(|value| value as f32)
}

#[test]
fn the_ranking_ends_at_half_time() {
    // No pixel can have more than 3 Gaussians, so that the global hinge is 0 under this limit.
    let found = reports(with_ranking(5, 3.0));
    let ranked: Vec<bool> = found.iter().map(|r| term(r, "rank").is_some()).collect();
    assert_eq!(ranked, [true, true, true, false, false]);
    for report in &found {
        let budget = term(report, "budget").unwrap();
        assert_eq!(budget > 0.0, report.step <= 3, "step {}: budget {budget}", report.step);
    }
    // Without any allowance the hinge is the square of the number of Gaussians per pixel.
    for report in &reports(with_ranking(4, 0.0))[2..] {
        let (budget, count) = (term(report, "budget").unwrap(), report.scalar("gaussians_per_pixel").unwrap() as f32);
        assert!(count > 0.1 && (budget - count * count).abs() < 1e-5, "budget {budget}, {count} Gaussians per pixel");
    }
}

#[test]
fn ranking_and_budget_are_those_of_the_losses() {
    let mut config = with_ranking(2, 0.3);
    config.stages[0].model.pose_tuples = 0;
    let (stage, d, m) = (&config.stages[0], &config.data, &config.model);
    let scenes = scenes::load(&config.data, SplatWeaverRecipe::image_size(m)).unwrap();
    let layouts: Vec<Layout> = scenes.iter().map(Layout::of).collect();
    let tuple = training_tuple(&layouts, Stream::new(0, 0, "tuples"), 0, d.pool, d.context_views, d.target_views);
    let examples = [Example::new(&scenes[tuple.scene], &layouts[tuple.scene], tuple).unwrap()];
    let mut params = Params::new();
    let model = SplatWeaver::new(m.clone(), &mut params, 0);
    let (workspaces, stream) = (WorkspacePool::new(), Stream::new(0, 0, "allocation"));
    let tape = Tape::new();
    let cx = Context::new(&tape, &params);

    let views = d.context_views;
    let photos = tape.constant(examples[0].context_photos().planes, [views, 3, m.height, m.width]);
    let encoded = model.encode(cx, photos.reshape([1, views, 3, m.height, m.width]));
    let dense = model.dense(cx, &encoded, 0, photos);
    let predicted = model.gaussians(cx, &dense, photos, &encoded.scene_cameras(0), &Sampled, stream.fork(0));
    let (choice, losses) = (predicted.choice.unwrap(), &stage.losses.router);
    let rank = ranking_cross_entropy(dense.logits, dense.energy, &losses.rank_quantiles, losses.label_smoothing).item();
    let of_experts = share_budget(choice, &losses.budget_shares).item();
    let of_all = global_budget(choice, losses.budget_limit).item();
    assert!(rank > 0.0 && of_experts > 0.0 && of_all > 0.0 && of_experts != of_all);

    for (ranking, expected) in [(true, [Some(rank), Some(of_experts)]), (false, [None, Some(of_all)])] {
        let objective = Objective {
            stage,
            ranking,
            allocation: &Sampled,
            networks: &ImageNetworks::default(),
            workspaces: &workspaces,
            stream,
        };
        let terms = objective.terms(cx, &model, &examples);
        let found = ["rank", "budget"].map(|name| terms.values().find(|(n, _)| *n == name).map(|(_, value)| value));
        assert_eq!(found, expected, "ranking: {ranking}");
    }
}
