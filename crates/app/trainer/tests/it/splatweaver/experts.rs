//! Experts that training never used are named before they are used.

use crate::capture;
use weaver_inference::{Checkpoint, Density, Predictor, SplatWeaverPredictor};
use weaver_trainer::splatweaver::SplatWeaverRecipe;
use weaver_trainer::{Config, Session};

fn resolve(settings: &[&str]) -> Config<SplatWeaverRecipe> {
    let settings: Vec<String> = settings.iter().map(|s| s.to_string()).collect();
    let mut config = Config::resolve(Some("micro"), None, &settings).unwrap();
    config.data.folders = capture::folders();
    config
}

fn of(allocation: &str) -> Density {
    Density { allocation: Some(allocation.parse().unwrap()), budget: None }
}

#[test]
fn a_checkpoint_tells_which_experts_were_trained() {
    for (settings, trained) in [
        (&[][..], vec![1, 2, 3]),
        (&["stages.1.model.dense=0"], vec![1]),
        (&["stages.1.model.allocation=sampled"], vec![1, 2, 3]),
        (&["stages.1.model.allocation=fixed:2"], vec![2]),
        (&["stages.1.model.allocation=fixed:0"], vec![]),
        // A stage that renders nothing, or has no steps, trains none.
        (&["stages.0.model.allocation=sampled", "stages.1.model.dense=0"], vec![1]),
        (&["stages.1.model.allocation=sampled", "stages.1.steps=0"], vec![]),
    ] {
        let config = resolve(settings);
        assert_eq!(SplatWeaverRecipe::trained_experts(&config), trained, "{settings:?}");
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.safetensors");
    Session::new(resolve(&["stages.1.model.allocation=sampled"])).unwrap().save(&path).unwrap();
    assert_eq!(Checkpoint::read(&path).unwrap().defaults().trained_experts, [1, 2, 3]);
}

/// Promise (results): experts that never learned are named where an allocation uses them.
#[test]
fn untrained_experts_are_named_and_trained_ones_pass() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.safetensors");
    Session::new(resolve(&["stages.1.model.dense=0"])).unwrap().save(&path).unwrap();
    let of_run = SplatWeaverPredictor::from_checkpoint(&Checkpoint::read(&path).unwrap()).unwrap();
    let built_in = SplatWeaverPredictor::built_in().unwrap();
    for (allocation, said) in
        [("fixed:2", "2 Gaussians"), ("fixed:3", "3 Gaussians"), ("argmax", "2 or 3"), ("sampled", "2 or 3")]
    {
        let remark = of_run.remark(of(allocation)).unwrap();
        assert!(remark.contains(allocation) && remark.contains(said), "{remark}");
        assert_eq!(built_in.remark(of(allocation)), None, "{allocation}");
    }
    for allocation in ["fixed:0", "fixed:1", "dithered", "grid", "random"] {
        assert_eq!(of_run.remark(of(allocation)), None, "{allocation}");
    }
    assert_eq!(of_run.remark(Density::default()), None);
}

/// A run whose evaluation uses untrained experts reports it before it begins.
#[test]
fn evaluation_by_untrained_experts_is_warned_of() {
    let plan = |settings: &[&str]| Session::new(resolve(settings)).unwrap().plan();
    let without = "stages.1.model.dense=0";
    assert!(plan(&["evaluation.allocation=sampled", without]).contains("warning: allocation sampled"));
    assert!(!plan(&["evaluation.allocation=sampled"]).contains("warning"));
    assert!(!plan(&["evaluation.allocation=sampled", "stages.1.model.allocation=sampled"]).contains("warning"));
    assert!(!plan(&[]).contains("warning"));
}
