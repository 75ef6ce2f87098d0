//! A comparison in a folder: interrupted and resumed.

use super::run::{Comparison, Inputs, KIND};
use super::settings::Settings;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use weaver_io::{Transforms, write_gaussians};
use weaver_run::{Folder, Job, Run};
use weaver_scene::{Frame, Gaussians, orbit};

/// Twenty-four Gaussians of all sizes on a spiral.
fn scene() -> Gaussians {
    let turn = |i: usize| [(i as f32).cos(), 0.1 * i as f32, (i as f32).sin()];
    Gaussians {
        means: (0..24).map(turn).collect(),
        log_scales: (0..24).map(|i| [-1.0 - 0.05 * i as f32, -1.5, -2.0]).collect(),
        quats: (0..24).map(|i| [1.0, 0.1 * i as f32, 0.0, 0.3]).collect(),
        opacity_logits: (0..24).map(|i| 0.1 * i as f32).collect(),
        sh: (0..72).map(|i| (i as f32).sin()).collect(),
        degree: 0,
    }
}

/// Settings of quick methods, with few and small pictures.
fn settings(scene: &Path) -> Settings {
    let methods = ["mesongs", "speedysplat", "spz4", "c3dgs"].map(String::from).into();
    let cameras = scene.with_file_name("cameras.json");
    let frame = |(i, camera)| Frame::new(format!("{i}.png"), camera);
    let frames = orbit(&self::scene(), 9, [48; 2]).unwrap().into_iter().enumerate().map(frame).collect();
    Transforms { frames, ..Transforms::default() }.write(&cameras).unwrap();
    Settings { scenes: vec![scene.into()], methods, cameras: Some(cameras), steps: 12, ..Settings::default() }
}

/// Runs to the end or to a step, from the beginning or from the folder's checkpoint; returns the folder's content
/// without logs.
fn run(folder: &Path, settings: &Settings, last: usize) -> (bool, BTreeMap<String, Vec<u8>>) {
    let inputs = Inputs::read(settings.clone()).unwrap();
    let tasks = inputs.tasks();
    let folder = match folder.exists() {
        true => Folder::reopen_with(folder, KIND, inputs.names().unwrap()).unwrap(),
        false => Folder::claim(folder, KIND, &settings.scenes).unwrap(),
    };
    folder.store(inputs.settings()).unwrap();
    let mut run = Run::resume(folder, Comparison::new(&inputs, &tasks)).unwrap();
    run.job.write(&run.folder).unwrap();
    let stop = AtomicBool::new(false);
    let advanced = run.advance(&stop, |report| {
        stop.store(report.step >= last, Relaxed);
        Ok(())
    });
    let files = std::fs::read_dir(run.folder.path()).unwrap().map(|entry| entry.unwrap());
    let files = files.filter(|file| file.file_name().to_string_lossy().starts_with("scene."));
    let read = |file: std::fs::DirEntry| {
        (file.file_name().to_string_lossy().into_owned(), std::fs::read(file.path()).unwrap())
    };
    (advanced.unwrap(), files.map(read).collect())
}

/// Promise (scenes): a comparison of methods that was stopped goes on to the same bytes, and not with other scenes.
#[test]
fn stopped_comparisons_go_on_to_the_same_bytes() {
    let temporary = tempfile::tempdir().unwrap();
    let path = |name: &str| temporary.path().join(name);
    write_gaussians(path("scene.ply"), &scene()).unwrap();
    let settings = settings(&path("scene.ply"));
    let (complete, whole) = run(&path("whole"), &settings, usize::MAX);
    let expected = ["c3dgs-4096-codes.bin", "mesongs-keeps-0.67.bin", "speedysplat-3-hard.bin", "spz4.v4.spz"];
    assert!(complete && expected.iter().all(|name| whole.contains_key(&format!("scene.{name}"))), "{:?}", whole.keys());
    // Stops in the middle of a method, at its end, and at prunings.
    for last in [3, 7, 8, 26, 31, 39, 55, 70] {
        let (complete, some) = run(&path("part"), &settings, last);
        assert!(!complete && some.len() < whole.len(), "step {last}");
    }
    let (complete, part) = run(&path("part"), &settings, usize::MAX);
    assert!(complete);
    assert_eq!(part, whole);
}

/// Promise of `stopped_comparisons_go_on_to_the_same_bytes`.
#[test]
fn a_comparison_of_other_scenes_is_not_gone_on_with() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("scene.ply");
    write_gaussians(&path, &scene()).unwrap();
    let began = Inputs::read(settings(&path)).unwrap().settings().clone();
    assert!(Inputs::read(began.clone()).is_ok());
    let mut other = scene();
    other.sh[5] += 0.5;
    write_gaussians(&path, &other).unwrap();
    let error = Inputs::read(began).err().and_then(|failure| failure.line()).unwrap_or_default();
    assert!(error.contains("scene.ply") && error.contains("found others"), "{error}");
    // Names of files would be the same.
    let twice = Settings { scenes: vec![path.clone(), path], ..Settings::default() };
    let inputs = Inputs::read(twice).unwrap();
    assert!(inputs.names().is_err());
    let [done, all] = Comparison::new(&inputs, &inputs.tasks()).steps();
    assert!(done == 0 && all > 0);
}
