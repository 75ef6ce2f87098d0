//! Figures and remarks of a fit, and files that it leaves alone.

use crate::{capture, settings, sized, without};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use weaver_data::capture::HoldOut;
use weaver_data::posed::{self, PosedOptions};
use weaver_fit::{Judge, Quality, Rates};
use weaver_io::{Image, Transforms};
use weaver_procedural::{ProceduralOptions, scene};
use weaver_reconstruct::{ByPhotos, Error, Initial, Outcome, Run, RunSettings};
use weaver_scene::PointCloud;
use weaver_splat::{CpuRasterizer, RasterSettings, Workspace, render};

fn fitted(folder: &Path, settings: RunSettings) -> Outcome {
    let mut run = Run::create(folder, settings, None, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
    run.advance(&AtomicBool::new(false), |_| {}).unwrap();
    run.finish().unwrap()
}

fn resumed(folder: &Path) -> Result<Run, Error> {
    Run::resume(folder, Judge::default(), Arc::new(CpuRasterizer))
}

/// Promise (figures): a fit judges the unmasked part of held-out photos and of its own.
#[test]
fn what_is_masked_is_not_judged() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    capture(&data, 10);
    std::fs::create_dir(data.join("masks")).unwrap();
    for i in 0..10 {
        // A passer-by in red, where the mask is black.
        let path = data.join(format!("images/{i:02}.png"));
        let mut photo = Image::read(&path, Default::default()).unwrap();
        let mut mask = Image::filled(40, 32, [1.0; 3]);
        for y in 4..28 {
            for x in 2 * i..2 * i + 12 {
                let at = 3 * (y * 40 + x);
                photo.pixels[at..at + 3].copy_from_slice(&[1.0, 0.0, 0.0]);
                mask.pixels[at..at + 3].fill(0.0);
            }
        }
        photo.write_png(&path).unwrap();
        mask.write_png(data.join(format!("masks/{i:02}.png"))).unwrap();
    }
    let mut settings = RunSettings { masks: true, ..settings(&data) };
    settings.fit.steps = 200;
    let outcome = fitted(&out, settings);
    let options = PosedOptions { masks: true, ..PosedOptions::default() };
    let gaussians = weaver_io::read_gaussians(out.join("scene.ply")).unwrap().to_activated();
    let raster = RasterSettings { near: outcome.near, ..RasterSettings::default() };
    let photos = posed::load(&data, &options).unwrap().photos;
    let judged = |held_out: bool, masked: bool| {
        let quality = |photo: &posed::PosedPhoto| {
            let image = render(&gaussians, &[photo.photo.camera], [1.0; 3], &raster, &mut Workspace::new()).unwrap();
            let mask = photo.photo.mask.as_deref().filter(|_| masked);
            Judge::default().compare_inside(&image.concat(), &photo.photo.rgb, [32, 40], mask)
        };
        let all: Vec<Quality> = photos.iter().filter(|photo| photo.held_out == held_out).map(quality).collect();
        Quality::mean(&all).unwrap().psnr
    };
    let (train, test) = (outcome.train.quality.psnr, outcome.test.unwrap().quality.psnr);
    assert!((train - judged(false, true)).abs() < 0.05, "{train} and {}", judged(false, true));
    assert!((test - judged(true, true)).abs() < 0.05, "{test} and {}", judged(true, true));
    assert!(test > judged(true, false) + 2.0, "the passer-by would have counted: {}", judged(true, false));
}

/// Promise (figures): a fit reports the error on held-out photos while it goes on.
#[test]
fn held_out_photos_are_met_while_it_fits() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    capture(&data, 10);
    let mut settings = settings(&data);
    settings.fit.steps = 40;
    let outcome = fitted(&out, settings);
    let records = weaver_run::read_records(out.join("metrics.jsonl")).unwrap();
    let looks: Vec<(usize, f64)> = records.iter().filter_map(|r| Some((r.step, r.value("held_out")?))).collect();
    assert_eq!(looks.iter().map(|look| look.0).collect::<Vec<_>>(), (2..=40).step_by(2).collect::<Vec<_>>());
    let last = outcome.test.unwrap().quality.psnr;
    assert!((looks[19].1 - last).abs() < 1e-4 && looks[0].1 < last - 1.0, "{looks:?} and {last}");
}

/// Writes points on the surfaces of the capture's scene beside it.
fn with_points(data: &Path) -> PointCloud {
    let scene = scene(2, &ProceduralOptions { width: 40, height: 32, views: 10 });
    let positions: Vec<[f32; 3]> = scene.points.iter().map(|p| p.as_vec3().to_array()).take(300).collect();
    let cloud = PointCloud { colors: vec![[90, 120, 200]; positions.len()], positions };
    weaver_io::ply::write_points(data.join("points3D.ply"), &cloud).unwrap();
    cloud
}

/// Gaussians begin on surfaces that photos agree about by default, and a run that is cut off before its first
/// checkpoint goes on from them.
#[test]
fn a_dense_start_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let (data, whole, cut) = (folder.path().join("data"), folder.path().join("whole"), folder.path().join("cut"));
    capture(&data, 16);
    with_points(&data);
    let settings = || RunSettings { by_photos: [ByPhotos::Start].into(), ..settings(&data) };
    let outcome = fitted(&whole, settings());
    assert_eq!(outcome.coverage.0.len(), outcome.train.views);
    assert!(outcome.coverage.0.values().all(|part| *part > 0.2), "{:?}", outcome.coverage);
    let run = Run::create(&cut, settings(), None, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
    assert_eq!(run.settings().init, Initial::Dense);
    drop(run);
    let mut run = resumed(&cut).unwrap();
    run.advance(&AtomicBool::new(false), |_| {}).unwrap();
    assert_eq!(run.finish().unwrap().coverage, outcome.coverage);
    let [a, b] = [&whole, &cut].map(|out| std::fs::read(out.join("scene.ply")).unwrap());
    assert!(a == b, "a run that went on made another scene");
}

/// Promise (kept): where Gaussians begin on surfaces, their means move the more slowly the larger the photos are,
/// unless a rate is named.
#[test]
fn on_surfaces_means_move_by_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    sized(&data, 3, [768, 16]);
    with_points(&data);
    let rate = |init, means: bool| {
        let by_photos = means.then_some(ByPhotos::Means).into_iter().collect();
        let settings = RunSettings { init, by_photos, hold_out: HoldOut::Nothing, ..settings(&data) };
        let out = folder.path().join(format!("{init:?}-{means}"));
        let run = Run::create(&out, settings, None, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
        run.settings().fit.rates.means / Rates::default().means
    };
    assert_eq!(rate(Initial::Dense, true), 0.5);
    assert_eq!([rate(Initial::Dense, false), rate(Initial::Points, true)], [1.0; 2]);
}

/// Without points, or with few photos, Gaussians begin without depth; a requested dense start is refused.
#[test]
fn a_dense_start_needs_points() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    capture(&data, 16);
    let settings =
        |init, start: Option<ByPhotos>| RunSettings { init, by_photos: start.into_iter().collect(), ..settings(&data) };
    let create = |name: &str, settings| {
        Run::create(&folder.path().join(name), settings, None, Judge::default(), Arc::new(CpuRasterizer))
    };
    let random = create("random", settings(Initial::Auto, Some(ByPhotos::Start))).unwrap();
    assert!(random.coverage().is_empty());
    assert_eq!(random.settings().init, Initial::Auto);
    let error = create("dense", settings(Initial::Dense, None)).unwrap_err().to_string();
    assert!(error.contains("init") && error.contains("points"), "{error}");
    with_points(&data);
    let few = create("few", RunSettings { views: Some(12), ..settings(Initial::Auto, Some(ByPhotos::Start)) }).unwrap();
    assert_eq!(few.settings().init, Initial::Points);
    assert!(few.coverage().is_empty());
}

/// Promise (kept): a fit writes a capture with points, and a second fit of it is as good; a capture without points is
/// reported.
#[test]
fn what_a_fit_writes_is_a_capture_with_points() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out, again) = (folder.path().join("data"), folder.path().join("out"), folder.path().join("again"));
    capture(&data, 10);
    let cloud = with_points(&data);
    let first = fitted(&out, settings(&data));
    let loaded = posed::load(&out, &PosedOptions::default()).unwrap();
    assert_eq!(loaded.points.colors, cloud.colors);
    for (a, b) in loaded.points.positions.iter().zip(&cloud.positions) {
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5), "{a:?} and {b:?}");
    }
    // The same photos, cameras and points, and so the same scene.
    let second = fitted(&again, settings(&out));
    let [a, b] = [first, second].map(|outcome| outcome.test.unwrap().quality.psnr);
    assert!((a - b).abs() < 0.1, "{a} dB, then {b} dB");
}

/// Photos that differ in exposure are corrected by default, and held-out ones are judged in the light of their
/// neighbors; nothing is corrected where photos agree.
#[test]
fn exposures_are_corrected_where_photos_differ() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    capture(&data, 10);
    with_points(&data);
    let measured = |name: &str| {
        let settings = RunSettings { by_photos: [ByPhotos::Exposure].into(), ..settings(&data) };
        let out = folder.path().join(name);
        let run = Run::create(&out, settings, None, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
        let corrected = run.settings().fit.exposure;
        drop(run);
        let mut run = resumed(&out).unwrap();
        assert_eq!(run.settings().fit.exposure, corrected, "as it was decided when the run began");
        run.advance(&AtomicBool::new(false), |_| {}).unwrap();
        (corrected, run.finish().unwrap())
    };
    let (corrected, outcome) = measured("same");
    assert!(!corrected && outcome.exposures.is_empty(), "{outcome:?}");
    for i in (0..10).filter(|i| i % 4 < 2) {
        let path = data.join(format!("images/{i:02}.png"));
        let mut photo = Image::read(&path, Default::default()).unwrap();
        photo.pixels.iter_mut().for_each(|x| *x *= 0.6);
        photo.write_png(&path).unwrap();
    }
    let (corrected, outcome) = measured("differ");
    assert!(corrected && outcome.exposures.len() == 10, "{outcome:?}");
    let page = |name: &str| std::fs::read_to_string(folder.path().join(name).join("report.html")).unwrap();
    assert!(page("differ").contains("Photos differ in exposure") && !page("same").contains("Photos differ"));
    let written = std::fs::read_to_string(folder.path().join("differ/summary.json")).unwrap();
    let read: Outcome = serde_json::from_str(&written).unwrap();
    assert_eq!(read.exposures, outcome.exposures);
    let light = |name: &str| read.exposure_of(name).unwrap();
    let name = read.exposures.keys().next().unwrap();
    let file = Path::new(name).file_name().unwrap().to_str().unwrap();
    assert_eq!(light(&format!("elsewhere/{file}")), light(name));
    assert!(read.exposure_of("another.png").is_none());
}

/// Promise of `what_a_fit_writes_is_a_capture_with_points`.
#[test]
fn a_capture_without_points_is_told_at_the_start() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out, other) = (folder.path().join("data"), folder.path().join("out"), folder.path().join("other"));
    capture(&data, 10);
    let begun =
        |out: &Path| Run::create(out, settings(&data), None, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
    let remarks = begun(&out).remarks().to_vec();
    assert!(remarks.iter().any(|remark| remark.contains("no points")), "{remarks:?}");
    with_points(&data);
    assert!(begun(&other).remarks().is_empty());
}

/// Promise (kept): a run goes on with the inputs that it began with, or names the one that changed.
#[test]
fn a_capture_that_changed_is_not_gone_on_with() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    capture(&data, 10);
    with_points(&data);
    drop(Run::create(&out, settings(&data), None, Judge::default(), Arc::new(CpuRasterizer)).unwrap());
    drop(resumed(&out).unwrap());
    let refused = |key: &str| {
        let error = resumed(&out).unwrap_err().to_string();
        assert!(error.contains(key) && error.contains("what the fit began with"), "{key}: {error}");
    };
    // Two photos exchanged: as many, as large, of the same names.
    let [a, b] = ["03", "04"].map(|name| data.join(format!("images/{name}.png")));
    let swap = || {
        let between = data.join("between");
        std::fs::rename(&a, &between).unwrap();
        std::fs::rename(&b, &a).unwrap();
        std::fs::rename(&between, &b).unwrap();
    };
    swap();
    refused("photo 0003 03.png");
    swap();
    let path = data.join("transforms.json");
    let given = std::fs::read(&path).unwrap();
    let mut other = Transforms::read(&path).unwrap();
    other.frames[5].camera.pose.translation.x += 1e-3;
    other.write(&path).unwrap();
    refused("camera of 00");
    std::fs::write(&path, given).unwrap();
    std::fs::remove_file(data.join("points3D.ply")).unwrap();
    refused("points");
    with_points(&data);
    // Moved, but not changed.
    let elsewhere = folder.path().join("elsewhere");
    std::fs::rename(&data, &elsewhere).unwrap();
    let run = out.join("run.json");
    let text = std::fs::read_to_string(&run).unwrap();
    // As JSON has it: backslashes are escaped.
    let in_json = |path: &Path| path.to_str().unwrap().replace('\\', r"\\");
    std::fs::write(&run, text.replace(&in_json(&data), &in_json(&elsewhere))).unwrap();
    drop(resumed(&out).unwrap());
    // Runs of earlier versions lack checksums of their inputs.
    without(&run, "sources");
    drop(resumed(&out).unwrap());
}

/// Promise of `a_folder_is_written_by_one_run_at_a_time`.
#[test]
fn a_folder_is_one_runs_alone_and_other_files_stay() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    capture(&data, 10);
    let create = |out: &Path| Run::create(out, settings(&data), None, Judge::default(), Arc::new(CpuRasterizer));
    let before = std::fs::read(data.join("transforms.json")).unwrap();
    for into in [data.clone(), data.join("fit")] {
        let error = create(&into).unwrap_err().to_string();
        assert!(error.contains("apart from what is read"), "{error}");
    }
    assert!(std::fs::read(data.join("transforms.json")).unwrap() == before && !data.join("fit").exists());
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("summary.json"), "mine").unwrap();
    let error = create(&out).unwrap_err().to_string();
    assert!(error.contains("summary.json") && error.contains("output"), "{error}");
    std::fs::remove_file(out.join("summary.json")).unwrap();
    let run = create(&out).unwrap();
    for second in [create(&out), resumed(&out)] {
        let error = second.unwrap_err().to_string();
        assert!(error.contains("a run exists there") || error.contains("in use"), "{error}");
    }
    drop(run);
    drop(resumed(&out).unwrap());
}
