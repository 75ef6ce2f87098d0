//! A run goes on with the configuration that it began with, or with a longer one.

use crate::{PixelCnnRecipe, Silent, config};
use std::sync::atomic::AtomicBool;
use weaver_trainer::{Config, Registry, Session, Setup, create_run};

type Pixel = Config<PixelCnnRecipe>;

#[test]
fn another_configuration_than_the_checkpoints_is_refused_with_its_key() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.safetensors");
    let mut first = Session::new(config(6)).unwrap();
    (0..3).for_each(|_| _ = first.advance().unwrap().unwrap());
    first.save(&path).unwrap();
    let resumed = |change: fn(&mut Pixel)| {
        let mut changed = config(6);
        change(&mut changed);
        Session::resume(changed, &path).map(|session| session.steps()).map_err(|e| e.to_string())
    };
    type Change = (fn(&mut Pixel), &'static str);
    let changes: [Change; 6] = [
        (|c| c.stages[0].rate = 0.5, "stages.0.rate: expected 0.002, found 0.5"),
        (|c| c.seed = 9, "seed: expected 0, found 9"),
        (|c| c.optimizer.clip = 2.0, "optimizer.clip: expected 1.0, found 2.0"),
        (|c| c.data.endless = Some(3), "data.endless: expected nothing, found 3"),
        (|c| c.stages[0].losses.ssim = 0.0, "stages.0.losses.ssim: expected 0.15, found 0.0"),
        (|c| c.stages[0].steps = 5, "stages.0.steps: expected 6, found 5"),
    ];
    for (change, said) in changes {
        let message = resumed(change).unwrap_err();
        assert!(message.contains(said) && message.contains("checkpoint.safetensors"), "{message}");
    }
    // What changes no weight may change.
    let steps = resumed(|c| {
        (c.threads, c.output.log_every) = (Some(3), 77);
    });
    assert_eq!(steps, Ok((3, 6)));
    assert_eq!(resumed(|c| c.stages[0].steps = 9), Ok((3, 9)));
}

#[test]
fn captures_may_have_been_moved_but_not_exchanged() {
    let at = |folder: &str| {
        let mut config = config(6);
        config.data.folders = vec![folder.into()];
        config
    };
    assert_eq!(at("/here/fox").difference(&at("/there/fox")), None);
    let expected = ("data.folders.0".to_string(), "fern".to_string(), "fox".to_string());
    assert_eq!(at("/here/fern").difference(&at("/here/fox")), Some(expected));
}

/// A finished run goes on under a longer cosine, and an interrupted one comes to the same bits.
#[test]
fn more_steps_prolong_the_last_stage_and_are_recorded() {
    let parent = tempfile::tempdir().unwrap();
    let registry = Registry::new().with::<PixelCnnRecipe>();
    let recipe = registry.find(None).unwrap();
    let settings = ["model.size=[16, 16]", "model.channels=4"].map(String::from).to_vec();
    let config = recipe.resolve(&Setup { settings, steps: Some(3), ..Setup::default() }).unwrap();
    let finished = || {
        let folder = create_run(&tempfile::tempdir_in(&parent).unwrap().keep(), &config).unwrap();
        recipe.start(&config).unwrap().train(&folder, &mut Silent, &AtomicBool::new(false)).unwrap();
        folder
    };
    let [whole, parts] = [finished(), finished()];
    let mut on = recipe.resume(&whole, Some(7)).unwrap();
    assert_eq!(on.steps(), (3, 7));
    let summary = on.train(&whole, &mut Silent, &AtomicBool::new(false)).unwrap();
    assert_eq!((summary.steps, summary.planned), (7, 7));
    assert!(std::fs::read_to_string(whole.config_path()).unwrap().contains("steps = 7"));
    // Stopped at once, then resumed without a word about steps.
    recipe.resume(&parts, Some(7)).unwrap().train(&parts, &mut Silent, &AtomicBool::new(true)).unwrap();
    let other = recipe.resume(&parts, None).unwrap().train(&parts, &mut Silent, &AtomicBool::new(false)).unwrap();
    assert_eq!(other.checksum, summary.checksum);
    let message = recipe.resume(&parts, Some(5)).err().unwrap().to_string();
    assert!(message.contains("steps: expected at least the 7 that are planned, found 5"), "{message}");
}
