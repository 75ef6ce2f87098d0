//! Runs on disk: their plans, and their resumption.

mod cleaning;
mod ends;
mod gaining;
mod partition;
mod promises;
mod requests;
mod shared;
mod stored;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use weaver_data::capture::HoldOut;
use weaver_data::posed::{self, CaptureCameras, PosedOptions};
use weaver_data::{CameraSummary, CamerasSummary};
use weaver_fit::{FitSettings, Judge};
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::{Camera, Distortion, Pose, Similarity, so3};
use weaver_io::Transforms;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_reconstruct::{Budget, Error, Initial, Run, RunSettings, Work, plan};
use weaver_scene::Frame;
use weaver_splat::CpuRasterizer;

fn capture(folder: &Path, views: usize) {
    sized(folder, views, [40, 32]);
}

/// A capture with photos of a width and height.
fn sized(folder: &Path, views: usize, [width, height]: [usize; 2]) {
    let scene = scene(2, &ProceduralOptions { width, height, views });
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

/// The report of a short fit of a capture.
fn report(settings: RunSettings, out: &Path) -> String {
    let mut run = Run::create(out, settings, None, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
    run.advance(&AtomicBool::new(false), |_| {}).unwrap();
    run.finish().unwrap();
    std::fs::read_to_string(out.join("report.html")).unwrap()
}

/// A report begins with doubts about its cameras.
#[test]
fn reports_begin_with_doubts_about_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), |name: &str| folder.path().join(name));
    capture(&data, 4);
    let settings = || {
        let fit = FitSettings { steps: 2, gaussians: 50, ..FitSettings::default() };
        RunSettings { hold_out: HoldOut::Nothing, ..RunSettings::new(data.join("transforms.json"), fit) }
    };
    // Cameras without a summary of their estimation.
    let html = report(settings(), &out("given"));
    assert!(!html.contains("Warning") && !html.contains("Estimated cameras"), "{html}");
    let photo = |rotation: f64, center: f64| CameraSummary {
        points: 321,
        focal_length: Some(0.871),
        rotation_deviation_degrees: Some(rotation),
        center_deviation: Some(center),
        ..CameraSummary::default()
    };
    let left_out = CameraSummary { left_out: Some("no texture".into()), ..CameraSummary::default() };
    let photos = [("a.jpg", photo(0.125, 0.02)), ("b.jpg", photo(1.5, 0.005)), ("c.jpg", left_out)];
    let mut cameras = CamerasSummary {
        confidence: "good".into(),
        points: 4321,
        error_pixels: Some(0.25),
        focal_length: Some(0.871),
        focal_length_deviation: Some(0.013),
        spread_of_centers: Some(0.5),
        photos: photos.map(|(name, photo)| (name.to_string(), photo)).into(),
        ..CamerasSummary::default()
    };
    let write = |cameras: &CamerasSummary| {
        std::fs::write(data.join(CamerasSummary::NAME), serde_json::to_string(cameras).unwrap()).unwrap();
    };
    write(&cameras);
    let html = report(settings(), &out("good"));
    assert!(!html.contains("Warning"), "{html}");
    for text in [
        "2 of 3 photos have a camera",
        "Focal length 0.871 +- 0.013 of the longer side",
        "within +- 1.50 degrees, centers within +- 4.0 %",
        "<td>a.jpg</td><td>321</td><td>0.871</td><td>0.125</td><td>4.00</td>",
        "<td>c.jpg</td><td>left out: no texture</td>",
    ] {
        assert!(html.contains(text), "{text}: {html}");
    }
    cameras.doubt = Some("the focal length is told to 6 % only".into());
    cameras.help = Some("photos from more different places, or --focal, would tell".into());
    write(&cameras);
    let html = report(settings(), &out("doubtful"));
    let body = html.split("<body>").nth(1).unwrap();
    assert!(
        body.starts_with("<p class=\"warning\"") && body.find("Warning").unwrap() < body.find("<h1>").unwrap(),
        "{html}"
    );
    assert!(body.contains("told to 6 % only; photos from more different places, or --focal, would tell."), "{html}");
    // A foreign file of that name.
    std::fs::write(data.join(CamerasSummary::NAME), "[1]").unwrap();
    assert!(!report(settings(), &out("other")).contains("Estimated cameras"));
}

/// Takes a key out of a file.
fn without(path: &Path, key: &str) {
    let mut written: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    written.as_object_mut().unwrap().remove(key).unwrap();
    std::fs::write(path, written.to_string()).unwrap();
}

#[test]
fn a_plan_grows_with_what_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    capture(folder.path(), 10);
    let small = plan(&settings(folder.path())).unwrap();
    assert_eq!((small.training, small.held_out, small.size), (8, 2, [40, 32]));
    assert!(small.photos >= 10 * 40 * 32 * 3 && small.total() > small.photos + small.gaussians);
    let mut more = settings(folder.path());
    more.fit.gaussians = 2000;
    assert!(plan(&more).unwrap().gaussians == 10 * small.gaussians);
    let fewer = RunSettings { views: Some(3), long_side: Some(20), ..settings(folder.path()) };
    let fewer = plan(&fewer).unwrap();
    assert_eq!((fewer.training, fewer.size), (3, [20, 16]));
    assert!(fewer.photos < small.photos);
    let mut several = settings(folder.path());
    several.fit.views_per_step = 4;
    assert!(plan(&several).unwrap().gaussians > small.gaussians);
    // Finding depth comes before there are Gaussians: it counts where it takes more than these.
    assert_eq!(small.start, 0);
    let dense = RunSettings { init: Initial::Dense, ..settings(folder.path()) };
    let dense = plan(&dense).unwrap();
    assert!(dense.start > 8 * 40 * 32 * 40 && dense.total() > dense.photos + dense.start);
    more.init = Initial::Dense;
    more.fit.gaussians = 100_000;
    let many = plan(&more).unwrap();
    assert_eq!(many.total(), many.photos + many.gaussians + many.rasterizer);
}

/// Promise (fits): photos that memory has no room for are on disk, and do not count.
#[test]
fn photos_beyond_memory_are_on_disk() {
    let folder = tempfile::tempdir().unwrap();
    capture(folder.path(), 10);
    let small = plan(&settings(folder.path())).unwrap();
    assert!(!small.on_disk);
    let path = folder.path().join("transforms.json");
    let mut transforms = Transforms::read(&path).unwrap();
    let large = |camera: Camera| Camera { width: 1_000_000, height: 800_000, ..camera };
    transforms.frames.iter_mut().for_each(|frame| frame.camera = large(frame.camera));
    transforms.write(path).unwrap();
    let large = plan(&settings(folder.path())).unwrap();
    assert!(large.on_disk && large.photos > 10 * 3 * 800_000_000_000);
    assert!(large.total() < large.photos + large.rasterizer);
}

#[test]
fn a_run_of_another_capture_is_not_gone_on_with() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    capture(&data, 10);
    let mut run = Run::create(&out, settings(&data), None, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
    run.advance(&AtomicBool::new(false), |_| {}).unwrap();
    drop(run);
    assert!(Run::resume(&out, Judge::default(), Arc::new(CpuRasterizer)).is_ok());
    assert!(matches!(
        Run::create(&out, settings(&data), None, Judge::default(), Arc::new(CpuRasterizer)),
        Err(Error::Run(weaver_run::Error::RunExists { .. }))
    ));
    // A photo less; the folder of a run from before there were checksums says so by its checkpoint.
    capture(&data, 9);
    let error = Run::resume(&out, Judge::default(), Arc::new(CpuRasterizer)).unwrap_err().to_string();
    assert!(error.contains("expected what the fit began with"), "{error}");
    without(&out.join("run.json"), "sources");
    let error = Run::resume(&out, Judge::default(), Arc::new(CpuRasterizer)).unwrap_err().to_string();
    assert!(error.contains("checkpoint.safetensors") && error.contains("poses"), "{error}");
    std::fs::write(out.join("run.json"), "{}").unwrap();
    let error = Run::resume(&out, Judge::default(), Arc::new(CpuRasterizer)).unwrap_err().to_string();
    assert!(error.contains("run.json") && error.contains("capture"), "{error}");
}

/// Promise of `short_times_make_scenes_and_their_excess_is_said`.
#[test]
fn a_time_that_is_too_short_is_spoken_of() {
    let folder = tempfile::tempdir().unwrap();
    capture(&folder.path().join("data"), 10);
    let in_time = |out: &str, minutes: f64, least_steps: usize| {
        let settings = RunSettings { minutes: Some(minutes), least_steps, ..settings(&folder.path().join("data")) };
        Run::create(&folder.path().join(out), settings, None, Judge::default(), Arc::new(CpuRasterizer)).unwrap()
    };
    let spoken =
        |run: &Run| run.remarks().iter().filter(|remark| !remark.contains("no points")).cloned().collect::<String>();
    let hurried = in_time("hurried", 1e-6, 1);
    assert_eq!(hurried.settings().fit.steps, 1);
    assert!(spoken(&hurried).contains("enough for 1 steps, fewer than there are photos"), "{}", spoken(&hurried));
    let patient = in_time("patient", 1e-6, 20);
    assert_eq!((patient.settings().fit.steps, patient.fit().settings().steps), (20, 20));
    let said = spoken(&patient);
    assert!(said.contains("enough for 1 of the 20 steps that are made at least; all of it takes about "), "{said}");
    let settings = RunSettings::new(folder.path().join("data"), FitSettings::default());
    assert_eq!(settings.least_steps, RunSettings::LEAST_STEPS, "no scene of one step unless it is asked for");
    let calm = in_time("calm", 1.0, 5);
    assert!(calm.settings().fit.steps > 8 && spoken(&calm).is_empty(), "{}", spoken(&calm));
}

/// Promise (scenes): a reconstruction makes no more passes through its photos than pay, and its photos are as large
/// as time allows.
#[test]
fn rounds_bound_the_steps_of_a_time() {
    let folder = tempfile::tempdir().unwrap();
    capture(&folder.path().join("data"), 10);
    let create = |out: &str, minutes: f64, rounds: usize, views: usize| {
        let mut settings = settings(&folder.path().join("data"));
        settings.fit.views_per_step = views;
        let settings = RunSettings { minutes: Some(minutes), least_steps: 1, most_rounds: Some(rounds), ..settings };
        Run::create(&folder.path().join(out), settings, None, Judge::default(), Arc::new(CpuRasterizer)).unwrap()
    };
    let run = create("alone", 5.0, 3, 1);
    assert_eq!(run.settings().fit.steps, 3 * run.fit().photos());
    assert!(run.ends_early());
    let pairs = create("pairs", 5.0, 3, 2);
    assert_eq!(pairs.settings().fit.steps, 3 * pairs.fit().photos().div_ceil(2));
    let short = create("short", 1e-6, 3, 1);
    assert!(short.settings().fit.steps == 1 && !short.ends_early());
}

/// Photos are the larger the more time there is, between two bounds; where they are no larger, by the lower
/// one.
///
/// Promise of `rounds_bound_the_steps_of_a_time`.
#[test]
fn photos_are_as_large_as_time_allows() {
    let folder = tempfile::tempdir().unwrap();
    capture(&folder.path().join("data"), 10);
    let settings = settings(&folder.path().join("data"));
    let cameras = CaptureCameras::read(&settings.capture, settings.hold_out).unwrap();
    let budget = |sides, minutes| {
        let work = Work { sides, minutes, rounds: 50 };
        Budget::of(&settings, &cameras, &work, Arc::new(CpuRasterizer)).unwrap()
    };
    let side = |sides, minutes| budget(sides, minutes).long_side;
    assert_eq!(side(16..=32, 1e-6), 16);
    assert_eq!(side(16..=32, 1e6), 32);
    // The photos have 40 pixels.
    assert_eq!(side(16..=100, 1e6), 40);
    assert_eq!(side(40..=100, 1e6), 40);
}

/// Runs from before there was a least number of steps go on.
#[test]
fn runs_without_least_steps_go_on() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    capture(&data, 10);
    Run::create(&out, settings(&data), None, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
    without(&out.join("run.json"), "least_steps");
    Run::resume(&out, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
}

#[test]
fn gaussians_that_were_given_are_there_again() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    capture(&data, 10);
    let given = {
        let mut run = Run::create(&out, settings(&data), None, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
        run.advance(&AtomicBool::new(false), |_| {}).unwrap();
        run.fit().gaussians()
    };
    let again = RunSettings { init: Initial::Given, ..settings(&data) };
    let other = folder.path().join("other");
    let error =
        Run::create(&other, again.clone(), None, Judge::default(), Arc::new(CpuRasterizer)).unwrap_err().to_string();
    assert!(error.contains("init"), "{error}");
    assert!(!other.exists());
    Run::create(&other, again, Some(&given), Judge::default(), Arc::new(CpuRasterizer)).unwrap();
    let resumed = Run::resume(&other, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
    assert_eq!(resumed.fit().gaussians().means, given.means);
}

#[test]
fn a_compressed_scene_is_what_all_results_are_of() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    capture(&data, 6);
    let scene = |name: &str, compress: Option<f64>, stop_at: usize| {
        let out = folder.path().join(name);
        let settings = RunSettings { compress, ..settings(&data) };
        let mut run = Run::create(&out, settings, None, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
        let stop = AtomicBool::new(false);
        run.advance(&stop, |report| stop.store(report.step == stop_at, Ordering::Relaxed)).unwrap();
        if run.fit().steps_done() < 20 {
            drop(run);
            run = Run::resume(&out, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
            run.advance(&AtomicBool::new(false), |_| {}).unwrap();
        }
        run.finish().unwrap();
        (weaver_io::read_gaussians(out.join("scene.ply")).unwrap(), std::fs::read(out.join("scene.wsz")).ok())
    };
    let (ply, wsz) = scene("whole", Some(2.0), 0);
    let decoded = weaver_codec::lite::decode(wsz.as_ref().unwrap()).unwrap();
    // The PLY has the order of the fit.
    let sorted = |gaussians: &weaver_scene::Gaussians| {
        let mut rows: Vec<_> = gaussians.means.iter().zip(&gaussians.opacity_logits).map(|(m, o)| (*m, *o)).collect();
        rows.sort_by(|a, b| a.partial_cmp(b).unwrap());
        rows
    };
    assert_eq!(sorted(&ply), sorted(&decoded));
    assert!(scene("stopped", Some(2.0), 19) == (ply, wsz), "the same bits after a stop");
    assert!(scene("without", None, 0).1.is_none());
}

/// Median angle of the cameras in a file from the true ones, degrees.
fn error(path: &Path, truth: &[Pose]) -> f64 {
    let found: Vec<Pose> = Transforms::read(path).unwrap().frames.iter().map(|frame| frame.camera.pose).collect();
    let onto = Similarity::fit_poses(&found, truth).unwrap();
    let mut angles: Vec<f64> =
        found.iter().zip(truth).map(|(a, b)| onto.apply_to_pose(a).angle_to(b).to_degrees()).collect();
    angles.sort_unstable_by(f64::total_cmp);
    angles[angles.len() / 2]
}

/// Wrong cameras are corrected, held-out ones too, to the same values after a stop.
#[test]
fn cameras_are_refined_and_written() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out, other) = (folder.path().join("data"), folder.path().join("out"), folder.path().join("other"));
    let scene = scene(3, &ProceduralOptions { width: 128, height: 96, views: 9 });
    std::fs::create_dir_all(data.join("images")).unwrap();
    let frame = |(i, view): (usize, &weaver_data::View)| {
        let name = format!("images/{i:02}.png");
        view.image.write_png(data.join(&name)).unwrap();
        let axis = DVec3::new((3.0 * i as f64).sin(), (5.0 * i as f64).cos(), (7.0 * i as f64).sin()).normalize();
        let rotation = so3::exp(axis * 1.0_f64.to_radians()) * view.camera.pose.rotation;
        let pose = Pose::new(rotation, -(rotation * view.camera.pose.center()));
        Frame::new(name, Camera { pose, ..view.camera })
    };
    let frames = scene.views.iter().enumerate().map(frame).collect();
    Transforms { frames, ..Transforms::default() }.write(data.join("transforms.json")).unwrap();
    let mut settings = settings(&data);
    settings.fit.poses.refine = true;
    let mut run = Run::create(&out, settings.clone(), None, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
    run.advance(&AtomicBool::new(false), |_| {}).unwrap();
    let outcome = run.finish().unwrap();
    assert!(outcome.poses.refined && outcome.poses.points > 50 && outcome.poses.degrees > 0.3, "{:?}", outcome.poses);
    assert!(outcome.poses.focal == 1.0 && outcome.poses.pixels.is_some_and(|p| p < 0.6), "{:?}", outcome.poses);
    // Training cameras come first: all but the first of every eight.
    let order = [1, 2, 3, 4, 5, 6, 7, 0, 8];
    let truth: Vec<Pose> = order.iter().map(|i| scene.views[*i].camera.pose).collect();
    let given = Transforms::read(data.join("transforms.json")).unwrap();
    let given = Transforms { frames: order.iter().map(|i| given.frames[*i].clone()).collect(), ..given };
    given.write(data.join("given.json")).unwrap();
    let (before, after) = (error(&data.join("given.json"), &truth), error(&out.join("transforms.json"), &truth));
    assert!(after < 0.6 * before, "from {before} to {after} degrees");

    Run::create(&other, settings, None, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
    let mut resumed = Run::resume(&other, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
    resumed.advance(&AtomicBool::new(false), |_| {}).unwrap();
    resumed.finish().unwrap();
    let bytes = |folder: &Path| std::fs::read(folder.join("scene.ply")).unwrap();
    assert_eq!(bytes(&out), bytes(&other));
}

/// The result of a fit to distorted photos is a capture of the same photos and masks, with the refined cameras.
#[test]
fn a_fit_of_distorted_photos_is_a_capture() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let scene = scene(3, &ProceduralOptions { width: 96, height: 72, views: 9 });
    for part in ["images", "masks"] {
        std::fs::create_dir_all(data.join(part)).unwrap();
    }
    let radial = Distortion::Radial { k: [-0.06, 0.02, 0.0, 0.0, 0.01, 0.0], p: [0.001, -0.002] };
    let fisheye = Distortion::Fisheye { k: [0.02, 0.01, 0.0, 0.0] };
    for (lens, focal) in [(radial, true), (fisheye, false)] {
        let frame = |(i, view): (usize, &weaver_data::View)| {
            let name = format!("images/{i:02}.png");
            view.image.write_png(data.join(&name)).unwrap();
            let mut mask = view.image.clone();
            mask.pixels.iter_mut().enumerate().for_each(|(at, m)| *m = f32::from(at > 3000));
            mask.write_png(data.join(format!("masks/{i:02}.png"))).unwrap();
            let mut camera = view.camera;
            (camera.intrinsics.fx, camera.intrinsics.fy) = (1.06 * camera.intrinsics.fx, 1.06 * camera.intrinsics.fy);
            let (time, number) = (Some(i as f64 / 30.0), (i != 4).then_some(i as u64));
            Frame { distortion: Some(lens), time, number, ..Frame::new(name, camera) }
        };
        let frames = scene.views.iter().enumerate().map(frame).collect();
        Transforms { frames, ..Transforms::default() }.write(data.join("transforms.json")).unwrap();
        let out = folder.path().join(if focal { "radial" } else { "fisheye" });
        let mut settings = RunSettings { masks: true, focal: true, ..settings(&data) };
        settings.fit.steps = 2;
        settings.fit.poses.refine = true;
        let mut run = Run::create(&out, settings, None, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
        run.advance(&AtomicBool::new(false), |_| {}).unwrap();
        let outcome = run.finish().unwrap();
        assert_eq!((outcome.poses.focal - 1.0).abs() > 1e-3, focal, "{:?}", outcome.poses);

        let options = PosedOptions { masks: true, ..PosedOptions::default() };
        let again = posed::load(&out, &options).unwrap();
        let (given, held_out): (Vec<_>, Vec<_>) = again.photos.into_iter().partition(|photo| !photo.held_out);
        assert_eq!((given.len(), held_out.len()), (run.fit().photos(), run.held_out().len()));
        let close = |a: f64, b: f64| (a - b).abs() < 1e-6 * b.abs();
        for (i, loaded) in given.iter().map(|posed| &posed.photo).enumerate() {
            let (photo, camera) = (run.fit().photo(i), run.fit().camera(i));
            let apart = loaded.rgb.iter().zip(&photo.rgb).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(apart.is_some_and(|apart| apart <= 1) && loaded.mask == photo.mask, "{}", photo.name);
            let (k, l) = (loaded.camera.intrinsics, camera.intrinsics);
            assert!(close(k.fx, l.fx) && close(k.fy, l.fy) && k.cx == l.cx && k.cy == l.cy, "{k:?} and {l:?}");
            assert!(loaded.camera.pose.angle_to(&camera.pose) < 1e-6);
        }
        // COLMAP's form says the same of the lenses.
        let of_colmap = weaver_io::read_cameras(out.join("sparse/0")).unwrap();
        let of_json = Transforms::read(out.join("transforms.json")).unwrap().frames;
        for frame in &of_json {
            let i: u64 = Path::new(&frame.name).file_stem().unwrap().to_str().unwrap().parse().unwrap();
            assert!(
                frame.time.is_some_and(|time| (time - i as f64 / 30.0).abs() < 1e-12),
                "{:?} of photo {i}",
                frame.time
            );
            assert_eq!(frame.number, (i != 4).then_some(i));
            let same = of_colmap.iter().find(|other| frame.name.ends_with(&other.name)).unwrap();
            let at = DVec2::new(0.3, -0.4);
            let [a, b] =
                [same, frame].map(|f| f.camera.intrinsics.project(f.distortion.unwrap().distort(at).extend(1.0)));
            assert!(a.distance(b) < 1e-9, "{a} and {b}");
        }
    }
}

/// A fit is a capture that holds out the same photos wherever it is moved.
///
/// Promise of `files_may_hold_nothing_out`.
#[test]
fn a_fit_is_a_capture_with_the_same_split() {
    let folder = tempfile::tempdir().unwrap();
    for all in [false, true] {
        let before = folder.path().join(format!("before-{all}"));
        capture(&before.join("data"), 9);
        let mut settings = RunSettings {
            hold_out: if all { HoldOut::Nothing } else { HoldOut::Listed },
            ..settings(&before.join("data"))
        };
        settings.fit.steps = 1;
        let mut run =
            Run::create(&before.join("out"), settings, None, Judge::default(), Arc::new(CpuRasterizer)).unwrap();
        run.advance(&AtomicBool::new(false), |_| {}).unwrap();
        run.finish().unwrap();
        let after = folder.path().join(format!("after-{all}"));
        std::fs::rename(&before, &after).unwrap();
        let held_out = |name: &str| {
            let photos = posed::load(after.join(name), &PosedOptions::default()).unwrap().photos;
            assert_eq!(photos.len(), 9);
            photos.into_iter().filter(|photo| photo.held_out).map(|photo| photo.photo.rgb).collect::<Vec<_>>()
        };
        // All of them, where every eighth would be held out if the file did not say.
        assert_eq!(held_out("out"), if all { vec![] } else { held_out("data") }, "all: {all}");
        std::fs::remove_file(after.join("out/transforms.json")).unwrap();
        held_out("out");
    }
}
