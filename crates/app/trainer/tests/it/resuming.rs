//! A run goes on with the configuration that it began with, or with a longer one.

use crate::scale::captured;
use crate::{PixelCnnRecipe, Silent, config};
use std::sync::atomic::AtomicBool;
use weaver_inference::RunFolder;
use weaver_trainer::{Config, ConfigSource, EvalOptions, Registry, Session, Source, create_run};

type Pixel = Config<PixelCnnRecipe>;

/// Another configuration than the checkpoints is refused with its key.
///
/// Promise (results): a run is resumed with the configuration that it began with, or refused with the key that
/// differs.
#[test]
fn another_configuration_is_refused_by_key() {
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
    // Keys that affect no weight may change.
    let steps = resumed(|c| {
        (c.threads, c.output.log_every) = (Some(3), 77);
    });
    assert_eq!(steps, Ok((3, 6)));
    assert_eq!(resumed(|c| c.stages[0].steps = 9), Ok((3, 9)));
}

/// Captures may have been moved and renamed but not changed.
///
/// Promise (results): captures may have been moved meanwhile, but not changed.
#[test]
fn captures_may_move_but_not_change() {
    let parent = tempfile::tempdir().unwrap();
    let [here, there] = ["here/fox", "there/fern"].map(|name| parent.path().join(name));
    let path = parent.path().join("checkpoint.safetensors");
    let first = captured(&here, 0);
    let mut session = Session::new(first.clone()).unwrap();
    session.advance().unwrap();
    session.save(&path).unwrap();
    let resumed = |config: &Pixel| Session::resume(config.clone(), &path).map(|s| s.steps()).map_err(|e| e.to_string());
    assert_eq!(resumed(&first), Ok((1, 4)));
    std::fs::create_dir_all(there.parent().unwrap()).unwrap();
    std::fs::rename(&here, &there).unwrap();
    let mut moved = first.clone();
    moved.data.folders = vec![there.clone()];
    assert_eq!((moved.difference(&first), resumed(&moved)), (None, Ok((1, 4))));

    // Another capture of the same name, in the same place.
    let exchanged = captured(&here, 0);
    let photo = here.join("images/3.png");
    let mut image = weaver_io::Image::read(&photo, weaver_io::Background::White).unwrap();
    image.pixels[5] = 1.0 - image.pixels[5];
    image.write_png(&photo).unwrap();
    let message = resumed(&exchanged).unwrap_err();
    let said = "data.folders.0: expected the photos, cameras and points that the run began with";
    assert!(message.contains(said) && message.contains("checkpoint.safetensors"), "{message}");
    assert!(message.contains(&format!("found others in {}", here.display())), "{message}");
    let camera = there.join("sparse/0/cameras.txt");
    std::fs::write(&camera, "1 PINHOLE 16 16 17 16 8 8\n").unwrap();
    assert!(resumed(&moved).unwrap_err().contains(said));
    let mut two = first.clone();
    two.data.folders = vec![there.clone(), here];
    std::fs::write(&camera, "1 PINHOLE 16 16 16 16 8 8\n").unwrap();
    let message = resumed(&two).unwrap_err();
    assert!(message.contains("data.folders.1") && message.contains("which it began without"), "{message}");
    let message = resumed(&Pixel { data: config(4).data, ..first }).unwrap_err();
    assert!(message.contains("data."), "{message}");
}

/// An evaluation on a run's own captures says which of them have changed since.
#[test]
fn evaluations_name_captures_that_have_changed() {
    let parent = tempfile::tempdir().unwrap();
    let data = parent.path().join("fox");
    let folder = RunFolder::at(parent.path().join("run"));
    let config = captured(&data, 0);
    std::fs::create_dir(parent.path().join("run")).unwrap();
    std::fs::write(folder.config_path(), config.to_toml()).unwrap();
    let mut session = Session::new(config).unwrap();
    session.advance().unwrap();
    session.save(&folder.checkpoint_path()).unwrap();
    let registry = Registry::empty().with::<PixelCnnRecipe>();
    let remarks = || {
        let mut run = registry.find(None).unwrap().open(&folder).unwrap();
        run.evaluate(&Source::Run, &EvalOptions::default(), &mut |_, _| ()).unwrap().remarks
    };
    assert!(remarks().iter().all(|remark| !remark.contains("the run began with")), "{:?}", remarks());
    let photo = data.join("images/3.png");
    let mut image = weaver_io::Image::read(&photo, weaver_io::Background::White).unwrap();
    image.pixels[5] = 1.0 - image.pixels[5];
    image.write_png(&photo).unwrap();
    let said = format!("{}: other photos, cameras or points than the run began with", data.display());
    assert!(remarks().contains(&said), "{:?}", remarks());
}

/// A finished run goes on under a longer cosine, and an interrupted one comes to the same bits.
///
/// Promise of `a_run_is_prolonged`.
#[test]
fn more_steps_prolong_the_last_stage_and_are_recorded() {
    let parent = tempfile::tempdir().unwrap();
    let registry = Registry::empty().with::<PixelCnnRecipe>();
    let recipe = registry.find(None).unwrap();
    let settings = ["model.size=[16, 16]", "model.channels=4"].map(String::from).to_vec();
    let config = recipe.resolve(&ConfigSource { settings, steps: Some(3), ..ConfigSource::default() }).unwrap();
    let finished = || {
        let folder = create_run(&tempfile::tempdir_in(&parent).unwrap().keep(), &config).unwrap();
        recipe.start(&config).unwrap().train(&folder, &mut Silent, &AtomicBool::new(false)).unwrap();
        folder
    };
    let [whole, parts] = [finished(), finished()];
    let [whole_path, parts_path] = [&whole, &parts].map(|folder| RunFolder::at(folder.path()));
    let mut on = recipe.resume(&whole_path, Some(7)).unwrap();
    assert_eq!(on.steps(), (3, 7));
    let summary = on.train(&whole, &mut Silent, &AtomicBool::new(false)).unwrap();
    assert_eq!((summary.steps, summary.planned), (7, 7));
    assert!(std::fs::read_to_string(whole_path.config_path()).unwrap().contains("steps = 7"));
    // Stopped at once, then resumed without a number of steps.
    recipe.resume(&parts_path, Some(7)).unwrap().train(&parts, &mut Silent, &AtomicBool::new(true)).unwrap();
    let other = recipe.resume(&parts_path, None).unwrap().train(&parts, &mut Silent, &AtomicBool::new(false)).unwrap();
    assert_eq!(other.checksum, summary.checksum);
    let message = recipe.resume(&parts_path, Some(5)).err().unwrap().to_string();
    assert!(message.contains("steps: expected at least the 7 that are planned, found 5"), "{message}");
}
