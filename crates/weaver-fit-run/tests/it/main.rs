//! Runs on disk: what they would take, and what they go on from.

use std::path::Path;
use std::sync::atomic::AtomicBool;
use weaver_data::procedural::{ProceduralOptions, scene};
use weaver_fit::{FitSettings, Judge};
use weaver_fit_run::{Initial, Run, RunError, RunSettings, dry_run};
use weaver_io::Transforms;
use weaver_scene::Frame;

fn capture(folder: &Path, views: usize) {
    let scene = scene(2, &ProceduralOptions { width: 40, height: 32, views });
    std::fs::create_dir_all(folder.join("images")).unwrap();
    let frame = |(i, view): (usize, &weaver_data::View)| {
        let name = format!("images/{i:02}.png");
        view.image.write_png(folder.join(&name)).unwrap();
        Frame::new(name, view.camera)
    };
    let frames = scene.views.iter().enumerate().map(frame).collect();
    Transforms { frames, ..Transforms::default() }.write(folder.join("transforms.json")).unwrap();
}

fn settings(folder: &Path) -> RunSettings {
    RunSettings::new(folder, FitSettings { steps: 20, gaussians: 200, ..FitSettings::default() })
}

#[test]
fn a_plan_grows_with_what_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    capture(folder.path(), 10);
    let small = dry_run(&settings(folder.path())).unwrap();
    assert_eq!((small.training, small.held_out, small.size), (8, 2, [40, 32]));
    assert!(small.photos >= 10 * 40 * 32 * 3 && small.total() > small.photos + small.gaussians);
    let mut more = settings(folder.path());
    more.fit.gaussians = 2000;
    assert!(dry_run(&more).unwrap().gaussians == 10 * small.gaussians);
    let fewer = RunSettings { views: Some(3), long_side: Some(20), ..settings(folder.path()) };
    let fewer = dry_run(&fewer).unwrap();
    assert_eq!((fewer.training, fewer.size), (3, [20, 16]));
    assert!(fewer.photos < small.photos);
}

#[test]
fn a_run_of_another_capture_is_not_gone_on_with() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    capture(&data, 10);
    let mut run = Run::create(&out, settings(&data), None, Judge::default()).unwrap();
    run.advance(&AtomicBool::new(false), |_| {}).unwrap();
    drop(run);
    assert!(Run::resume(&out, Judge::default()).is_ok());
    assert!(matches!(Run::create(&out, settings(&data), None, Judge::default()), Err(RunError::RunExists { .. })));
    // A photo less.
    capture(&data, 9);
    let error = Run::resume(&out, Judge::default()).unwrap_err().to_string();
    assert!(error.contains("checkpoint.safetensors") && error.contains("poses"), "{error}");
    std::fs::write(out.join("run.json"), "{}").unwrap();
    let error = Run::resume(&out, Judge::default()).unwrap_err().to_string();
    assert!(error.contains("run.json") && error.contains("capture"), "{error}");
}

#[test]
fn gaussians_that_were_given_are_there_again() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    capture(&data, 10);
    let given = {
        let mut run = Run::create(&out, settings(&data), None, Judge::default()).unwrap();
        run.advance(&AtomicBool::new(false), |_| {}).unwrap();
        run.fit().gaussians()
    };
    let again = RunSettings { init: Initial::Given, ..settings(&data) };
    let other = folder.path().join("other");
    let error = Run::create(&other, again.clone(), None, Judge::default()).unwrap_err().to_string();
    assert!(error.contains("init"), "{error}");
    assert!(!other.exists());
    Run::create(&other, again, Some(&given), Judge::default()).unwrap();
    let resumed = Run::resume(&other, Judge::default()).unwrap();
    assert_eq!(resumed.fit().gaussians().means, given.means);
}
