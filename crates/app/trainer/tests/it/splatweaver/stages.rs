//! Frozen parts, recomputation and samplers of stages.

use super::switch_off::reports;
use crate::capture;
use weaver_autograd::Params;
use weaver_trainer::Session;
use weaver_trainer::splatweaver::SplatWeaverRecipe;

type Config = weaver_trainer::Config<SplatWeaverRecipe>;

fn config(steps: usize, settings: &[&str]) -> Config {
    let settings: Vec<String> = settings.iter().map(|s| s.to_string()).collect();
    let mut config = Config::resolve(Some("micro"), None, &settings).unwrap();
    config.data.folders = capture::folders();
    config.rescale(steps);
    config
}

/// Parts that have moved, up to the first dot, or to the second in the aggregator.
fn moved(before: &Params<f32>, after: &Params<f32>) -> Vec<String> {
    let pairs = before.iter().zip(after.iter()).filter(|((_, a), (_, b))| a.value() != b.value());
    let part = |name: &str| {
        let count = if name.starts_with("aggregator") { 2 } else { 1 };
        name.split('.').take(count).collect::<Vec<_>>().join(".")
    };
    let mut parts: Vec<String> = pairs.map(|((_, p), _)| part(p.name())).collect();
    parts.dedup();
    parts
}

/// Promise (options): frozen parts stay as they are; recomputing gives the same bits.
#[test]
fn frozen_parts_stay_as_they_are_in_their_stage_alone() {
    let frozen = "stages.1.frozen=[\"aggregator.patch_embed\", \"camera_head\"]";
    let mut session = Session::new(config(10, &[frozen])).unwrap();
    let plan = session.plan();
    assert!(plan.contains("frozen: aggregator.patch_embed, camera_head\n"), "{plan}");
    let random = session.params().clone();
    for _ in 0..2 {
        session.advance().unwrap();
    }
    let first = session.params().clone();
    let trained = moved(&random, &first);
    assert!(
        trained.contains(&"aggregator.patch_embed".into()) && trained.contains(&"camera_head".into()),
        "{trained:?}"
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.safetensors");
    for step in 2..10 {
        if step == 5 {
            session.save(&path).unwrap();
        }
        session.advance().unwrap();
    }
    let trained = moved(&first, session.params());
    assert!(
        trained.contains(&"aggregator.frame_blocks".into()) && trained.contains(&"depth_head".into()),
        "{trained:?}"
    );
    assert!(
        !trained.contains(&"aggregator.patch_embed".into()) && !trained.contains(&"camera_head".into()),
        "{trained:?}"
    );
    let mut resumed = Session::resume(config(10, &[frozen]), &path).unwrap();
    while resumed.advance().unwrap().is_some() {}
    assert_eq!(resumed.checksum(), session.checksum());
}

#[test]
fn what_is_frozen_must_be_there_and_leave_something() {
    let message = |settings: &[&str]| Session::new(config(10, settings)).expect_err("an error").to_string();
    let unknown = message(&["stages.1.frozen=[\"camera\"]"]);
    assert!(unknown.contains("stages.1.frozen: expected the beginning of a parameter's name"), "{unknown}");
    assert!(unknown.contains("camera_head") && unknown.contains("found `camera`"), "{unknown}");
    let all = "[\"aggregator\", \"camera_head\", \"depth_head\", \"gaussian_param_head\"]";
    let nothing = message(&[&format!("stages.0.frozen={all}")]);
    assert!(nothing.contains("stages.0.frozen: expected a part that is left to train"), "{nothing}");
    // All parts that the losses of the stage reach are frozen.
    let mut session = Session::new(config(10, &["stages.0.frozen=[\"aggregator\", \"camera_head\"]"])).unwrap();
    let unreached = session.advance().expect_err("an error").to_string();
    assert!(unreached.contains("stages.0.frozen: expected a part to learn"), "{unreached}");
}

/// Recomputing takes less memory and gives the same bits.
///
/// Promise of `frozen_parts_stay_as_they_are_in_their_stage_alone`.
#[test]
fn recomputing_takes_less_memory() {
    let trained = |recompute: bool| {
        let [a, b] = [0, 1].map(|stage| format!("stages.{stage}.recompute={recompute}"));
        // Where transformer blocks are most of the network.
        let mut session = Session::new(config(4, &[&a, &b, "model.backbone.rounds=6"])).unwrap();
        session.advance().unwrap();
        let bytes = session.tape_bytes();
        while session.advance().unwrap().is_some() {}
        (session.checksum(), bytes)
    };
    let ((kept, all), (computed, few)) = (trained(false), trained(true));
    assert_eq!(kept, computed);
    assert!(10 * few < 8 * all, "{few} of {all} bytes");
}

/// Samplers and numbers of views change the training.
///
/// Promise of `a_gap_is_bounded`.
#[test]
fn samplers_and_views_change_the_run() {
    let losses = |settings: &[&str]| -> Vec<f64> {
        let found: Vec<f64> = reports(config(8, settings)).iter().map(|report| report.loss).collect();
        assert!(found.len() == 8 && found.iter().all(|loss| loss.is_finite()), "{settings:?}: {found:?}");
        found
    };
    let nearest = losses(&[]);
    assert_eq!(losses(&["data.sampler=nearest"]), nearest);
    assert_ne!(losses(&["data.sampler=bounded-gap"]), nearest);
    assert_ne!(losses(&["data.sampler=uniform"]), nearest);
    let more = losses(&["data.most_context_views=4"]);
    // The same seed draws the same scene and pool; steps with the same number of views are equal.
    assert!(more != nearest && more[0] != more[1]);
    assert_eq!(losses(&["data.most_context_views=2"]), nearest);

    let refused = |settings: &[&str]| {
        let settings: Vec<String> = settings.iter().map(|s| s.to_string()).collect();
        Config::resolve(Some("micro"), None, &settings).unwrap_err().to_string()
    };
    let message = refused(&["data.context_views=3", "data.most_context_views=2"]);
    assert!(message.contains("data.most_context_views: expected at least data.context_views, 3, found 2"), "{message}");
    let message = refused(&["data.endless=2", "data.most_context_views=8", "data.pool=9"]);
    assert!(message.contains("data.endless: expected at most 7 context views"), "{message}");
    let message = refused(&["data.most_context_views=5"]);
    assert!(message.contains("data.pool: expected at least data.most_context_views, 5, found 4"), "{message}");
}
