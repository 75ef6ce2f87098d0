//! Ends of fits: in time, and with results although some cannot be made.

use crate::{capture, settings};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use weaver_data::capture::HoldOut;
use weaver_fit::{FitSettings, Judge};
use weaver_io::{Image, SceneFormat, Transforms};
use weaver_reconstruct::{Error, Outcome, Run, RunSettings};
use weaver_splat::CpuRasterizer;

fn create(out: &Path, settings: RunSettings) -> Result<Run, Error> {
    Run::create(out, settings, None, Judge::default(), Arc::new(CpuRasterizer))
}

fn ended(mut run: Run) -> Result<Outcome, Error> {
    run.advance(&AtomicBool::new(false), |_| {})?;
    run.finish()
}

/// The capture with its world in other units.
fn in_units(data: &Path, unit: f64) {
    let path = data.join("transforms.json");
    let mut transforms = Transforms::read(&path).unwrap();
    transforms.frames.iter_mut().for_each(|frame| frame.camera.pose.translation *= unit);
    transforms.write(path).unwrap();
}

/// Promise (fits): a fit ends with all its results in whatever units its capture is.
#[test]
fn a_fit_in_large_units_has_all_results() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    capture(&data, 6);
    in_units(&data, 1e7);
    let outcome = ended(create(&out, settings(&data)).unwrap()).unwrap();
    assert!(outcome.missing.is_empty(), "{:?}", outcome.missing);
    for name in ["scene.ply", "transforms.json", "summary.json", "report.html", "view.html"] {
        assert!(out.join(name).is_file(), "{name}");
    }
}

/// Promise (fits): a further file that cannot hold the scene takes no other result with it.
#[test]
fn a_format_that_fails_leaves_all_else() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    capture(&data, 6);
    in_units(&data, 1e7);
    let formats = vec!["spz".parse::<SceneFormat>().unwrap()];
    let error = ended(create(&out, RunSettings { formats, ..settings(&data) }).unwrap()).unwrap_err().to_string();
    assert!(error.contains("scene.spz") && error.contains("2^23"), "{error}");
    for name in ["scene.ply", "transforms.json", "summary.json", "report.html", "view.html"] {
        assert!(out.join(name).is_file(), "{name}");
    }
}

/// Promise (fits): a foreign file in `transients/` is found before any work, and when a fit goes on.
#[test]
fn foreign_transients_are_met_at_the_start() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    capture(&data, 6);
    let claim = || Run::claim(&out, [&data]).map(drop);
    claim().unwrap();
    let foreign = out.join("transients/0002-02.png");
    let refused = |result: Result<(), Error>| {
        let error = result.unwrap_err().to_string();
        assert!(error.contains("0002-02.png") && error.contains("written.jsonl"), "{error}");
    };
    let put = || {
        std::fs::create_dir_all(foreign.parent().unwrap()).unwrap();
        std::fs::write(&foreign, "mine").unwrap();
    };
    put();
    refused(claim());
    std::fs::remove_dir_all(out.join("transients")).unwrap();
    std::fs::write(out.join("transients"), "mine, too").unwrap();
    assert!(claim().unwrap_err().to_string().contains("transients"));
    std::fs::remove_file(out.join("transients")).unwrap();
    drop(create(&out, settings(&data)).unwrap());
    put();
    refused(Run::resume(&out, Judge::default(), Arc::new(CpuRasterizer)).map(drop));
    assert_eq!(std::fs::read(&foreign).unwrap(), b"mine");
}

/// Promise (fits): photos that masks cover altogether are left out by name.
#[test]
fn photos_masked_altogether_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    capture(&data, 6);
    std::fs::create_dir(data.join("masks")).unwrap();
    for i in 0..6 {
        let counts = f32::from(i != 2 && i != 4);
        Image::filled(40, 32, [counts; 3]).write_png(data.join(format!("masks/{i:02}.png"))).unwrap();
    }
    let settings = RunSettings { masks: true, hold_out: HoldOut::Nothing, ..settings(&data) };
    let run = create(&out, settings).unwrap();
    assert_eq!(run.fit().photos(), 4);
    let said = run.remarks().join("\n");
    assert!(said.contains("02.png, ") && said.contains("04.png are left out: masks cover all of"), "{said}");
    assert!(!said.contains("03.png"), "{said}");
}

/// A run that used its time up judges some of its photos, evenly spread, in place of all.
///
/// Promise of `slower_machines_leave_out_steps`.
#[test]
fn late_runs_judge_fewer_photos() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    capture(&data, 20);
    let judged = |out: &str, minutes: f64, late: Duration| {
        let minutes = Some(minutes);
        let settings = RunSettings { minutes, html: false, hold_out: HoldOut::Nothing, ..settings(&data) };
        let mut run = create(&folder.path().join(out), settings).unwrap();
        run.advance(&AtomicBool::new(true), |_| {}).unwrap();
        std::thread::sleep(late);
        run.finish().unwrap().train.views
    };
    assert_eq!(judged("in-time", 2.0, Duration::ZERO), 20);
    assert_eq!(judged("late", 0.02, Duration::from_secs(2)), 10);
}

/// A run whose steps turn out slower than rehearsed leaves out steps, and Gaussians that the others could not place,
/// says how many, and writes down which: these settings lead to the same bits.
///
/// Promise of `slower_machines_leave_out_steps`.
#[test]
fn slow_steps_are_left_out_to_end_in_time() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    capture(&data, 10);
    let fit = FitSettings { gaussians: 6000, ..FitSettings::default() };
    let in_time = RunSettings { minutes: Some(0.1), least_steps: 5, gaussians_in_time: true, ..settings(&data) };
    let settings = RunSettings { fit, html: false, ..in_time };
    let mut run = create(&out, settings).unwrap();
    let planned = run.settings().fit.steps;
    assert!(planned > 20, "{planned} steps");
    // All of them would take eight seconds more than the six that there are.
    let more = Duration::from_secs(8) / planned as u32;
    run.advance(&AtomicBool::new(false), |_| std::thread::sleep(more)).unwrap();
    let outcome = run.finish().unwrap();
    assert_eq!((outcome.steps, outcome.planned), (planned, planned));
    assert!(outcome.left_out > planned / 10, "{} of {planned} left out", outcome.left_out);
    let most = run.settings().fit.thinned.iter().map(|thinning| thinning.gaussians.unwrap()).max().unwrap();
    assert!(most < 6000 && outcome.gaussians <= most, "{} Gaussians of at most {most}", outcome.gaussians);
    drop(run);
    let stored = Run::resume(&out, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
    assert_eq!(stored.settings().fit.left_out(planned), outcome.left_out);
    let settings = RunSettings { minutes: None, ..stored.settings().clone() };
    let again = folder.path().join("again");
    let repeated = ended(create(&again, settings).unwrap()).unwrap();
    assert_eq!(repeated.left_out, outcome.left_out);
    let [one, other] = [&out, &again].map(|out| std::fs::read(out.join("scene.ply")).unwrap());
    assert!(one == other, "the settings that were written down lead to another scene");
}
