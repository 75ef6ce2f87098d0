//! Photos without any other information.

use std::path::Path;
use std::process::{Command, Output};
use weaver_geometry::{Pose, Similarity};
use weaver_io::{Image, Transforms};
use weaver_kernels::order::median_high;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::Frame;

const BINARY: &str = env!("CARGO_BIN_EXE_splatweaver");

/// Writes `photos/00.png` and on, every second view of a built-in scene, and their true cameras to
/// `truth/transforms.json`.
fn photos(folder: &Path, views: usize) {
    let scene = scene(3, &ProceduralOptions { width: 192, height: 144, views });
    std::fs::create_dir_all(folder.join("photos")).unwrap();
    std::fs::create_dir_all(folder.join("truth")).unwrap();
    let frame = |(i, view): (usize, &weaver_data::View)| {
        view.image.write_png(folder.join(format!("photos/{i:02}.png"))).unwrap();
        Frame::new(format!("../photos/{i:02}.png"), view.camera)
    };
    let frames = scene.views.iter().step_by(2).enumerate().map(frame).collect();
    Transforms { frames, ..Transforms::default() }.write(folder.join("truth/transforms.json")).unwrap();
}

fn run(folder: &Path, line: &str) -> Output {
    Command::new(BINARY).current_dir(folder).args(line.split(' ')).output().unwrap()
}

fn said(output: &Output) -> String {
    let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    crate::in_process::with_slashes(&said)
}

/// The object that a command with `--json` has printed.
fn json(output: &Output) -> serde_json::Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", said(output)))
}

/// Number of photos that have a camera, and of all, by the summary of `cameras --json`.
fn placed(summary: &serde_json::Value) -> [usize; 2] {
    let photos = summary["photos"].as_object().unwrap();
    [photos.values().filter(|photo| photo["left_out"].is_null()).count(), photos.len()]
}

/// Median angle between the cameras of a file and the true ones, degrees.
fn error(folder: &Path, found: &str) -> f64 {
    let poses = |file: &str| -> Vec<Pose> {
        let frames = Transforms::read(folder.join(file)).unwrap().frames;
        frames.iter().map(|frame| frame.camera.pose).collect()
    };
    let (found, truth) = (poses(found), poses("truth/transforms.json"));
    let onto = Similarity::fit_poses(&found, &truth).unwrap();
    let angle = |(a, b): (&Pose, &Pose)| onto.apply_to_pose(a).angle_to(b).to_degrees();
    median_high(&mut found.iter().zip(&truth).map(angle).collect::<Vec<f64>>()).unwrap()
}

#[test]
fn cameras_become_a_capture() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    photos(folder, 12);
    let output = run(folder, "cameras photos -o found --json");
    assert!(output.status.success(), "{}", said(&output));
    assert_eq!(placed(&json(&output)), [6, 6], "{}", said(&output));
    let degrees = error(folder, "found/transforms.json");
    assert!(degrees < 1.5, "{degrees} degrees");
    assert!(folder.join("found/points.png").exists());
    let capture = weaver_data::posed::load(folder.join("found"), &Default::default()).unwrap();
    assert_eq!(capture.photos.len(), 6);
    assert!(capture.points.positions.len() > 100, "{} points", capture.points.positions.len());
    let again = run(folder, "cameras photos -o again --threads 1 --compare truth/transforms.json");
    let compared = said(&again);
    assert!(
        again.status.success() && compared.contains("beside truth/transforms.json: 6 of 6 photos; rotation"),
        "{compared}"
    );
    for name in ["transforms.json", "sparse/0/points3D.bin", "sparse/0/images.bin", "points.png"] {
        let bytes = |out: &str| std::fs::read(folder.join(out).join(name)).unwrap();
        assert!(bytes("found") == bytes("again"), "{name} depends on the number of threads");
    }
}

#[test]
fn a_distortion_is_named_with_the_cameras() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    photos(folder, 12);
    let output = run(folder, "cameras photos -o found --distortion k1 --compare truth/transforms.json");
    let text = said(&output);
    assert!(output.status.success() && text.contains("radial distortion k1"), "{text}");
    let written = std::fs::read_to_string(folder.join("found/transforms.json")).unwrap();
    assert!(written.contains("\"k1\""), "{written}");
    let capture = weaver_data::posed::load(folder.join("found"), &Default::default()).unwrap();
    assert_eq!(capture.photos.len(), 6);
    // Lines are straight in these photos: no distortion can be estimated from them.
    let output = run(folder, "cameras photos -o straight --json");
    assert!(output.status.success() && !said(&output).contains("radial distortion"), "{}", said(&output));
    let summary = json(&output);
    let written = std::fs::read(folder.join("straight/cameras.json")).unwrap();
    assert_eq!(serde_json::from_slice::<serde_json::Value>(&written).unwrap(), summary);
    let deviation = summary["focal_length_deviation"].as_f64().unwrap();
    assert!(deviation > 0.0 && deviation < 0.1, "{summary}");
    assert_eq!(summary["photos"].as_object().unwrap().len(), 6, "{summary}");
}

#[test]
fn networks_are_judged_with_estimated_cameras() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    photos(folder, 12);
    // A capture with points, which fix its scale.
    let capture = run(folder, "cameras photos -o capture");
    assert!(capture.status.success(), "{}", said(&capture));
    let output = run(folder, "eval --data capture --cameras estimated --match-size 192 --json");
    let found = json(&output);
    assert_eq!(found["cameras"], "estimated");
    let mean = &found["mean"];
    let figure = |key: &str| mean[key].as_f64().unwrap_or_else(|| panic!("{key} in {mean}"));
    assert!(figure("pose_rotation_deg") < 3.0 && figure("psnr") > 10.0 && figure("psnr_strict") > 10.0, "{mean}");
    for (flags, key) in [
        ("--cameras given --match-size 192", "expected --cameras estimated"),
        ("--cameras estimated --points", "expected --cameras given"),
    ] {
        let output = run(folder, &format!("eval --data truth {flags}"));
        assert_eq!(output.status.code(), Some(2), "{}", said(&output));
        assert!(said(&output).contains(key), "{}", said(&output));
    }
    assert_eq!(run(folder, "eval").status.code(), Some(2));
}

#[test]
fn a_scene_from_photos_alone() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    photos(folder, 12);
    let output = run(folder, "reconstruct photos -o scene --minutes 0.05 --gaussians 1000 --hold-out listed");
    let text = said(&output);
    assert!(output.status.success() && text.contains("held out"), "{text}");
    for name in ["scene.ply", "report.html", "summary.json", "cameras/transforms.json", "cameras/points.png"] {
        assert!(folder.join("scene").join(name).exists(), "{name}");
    }
    let before = std::fs::read(folder.join("scene/scene.ply")).unwrap();
    // Doubt stands above all else, and only where there is any.
    let doubts = |out: &str| {
        let html = std::fs::read_to_string(folder.join(out).join("report.html")).unwrap();
        assert!(html.contains("Estimated cameras") && html.contains("+-"), "{html}");
        html.split("<h1>").next().unwrap().contains("doubtful")
    };
    assert_eq!(doubts("scene"), text.contains("cameras: doubtful"), "{text}");
    let two = run(folder, "reconstruct photos/00.png photos/01.png -o two --minutes 0.05 --gaussians 300");
    assert!(two.status.success() && said(&two).contains("doubtful: two photos") && doubts("two"), "{}", said(&two));
    let again = run(folder, "reconstruct photos -o scene --minutes 0.1");
    assert_eq!(again.status.code(), Some(2));
    assert!(said(&again).contains("a finished scene is there already"), "{}", said(&again));
    assert!(std::fs::read(folder.join("scene/scene.ply")).unwrap() == before);
    let fitted = run(folder, "fit photos --cameras estimated --steps 20 --gaussians 1000 -o fitted");
    assert!(fitted.status.success() && folder.join("fitted/cameras/sparse").exists(), "{}", said(&fitted));
}

/// Promise (fits): the time of a fit whose cameras are estimated includes the estimate.
#[test]
fn matching_is_part_of_the_time_of_a_fit() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    photos(folder, 8);
    let output = run(folder, "fit photos --cameras estimated --minutes 0.1 --gaussians 100 -o timed");
    assert!(output.status.success(), "{}", said(&output));
    let file = |name: &str| -> serde_json::Value {
        serde_json::from_str(&std::fs::read_to_string(folder.join("timed").join(name)).unwrap()).unwrap()
    };
    let minutes = file("run.json")["minutes"].as_f64().unwrap();
    assert!((0.05..0.1).contains(&minutes), "{minutes} are the fit's");
    assert!(file("summary.json")["planned"].as_u64().unwrap() >= 200, "{}", file("summary.json"));
}

/// The weights that come with the program take estimated cameras.
#[test]
fn built_in_weights_take_estimated_cameras() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    photos(folder, 8);
    let output = run(folder, "infer photos -o result");
    let text = said(&output);
    assert!(output.status.success() && text.contains("depth was brought to the points"), "{text}");
    assert!(folder.join("result/scene.ply").exists() && folder.join("result/cameras/points.png").exists());
    let alone = run(folder, "infer photos/00.png -o alone");
    assert!(alone.status.success() && said(&alone).contains("the network's own cameras are taken"), "{}", said(&alone));
    let asked = run(folder, "infer photos/00.png --cameras estimated -o asked");
    assert_eq!(asked.status.code(), Some(1), "{}", said(&asked));
}

#[test]
fn what_cannot_be_solved_is_refused_with_a_reason() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    photos(folder, 4);
    std::fs::copy(folder.join("photos/00.png"), folder.join("copy.png")).unwrap();
    Image::filled(192, 144, [0.4; 3]).write_png(folder.join("flat.png")).unwrap();
    std::fs::write(folder.join("broken.png"), "no picture").unwrap();
    std::fs::create_dir(folder.join("empty")).unwrap();
    for (photos, reason) in [
        ("photos/00.png", "expected at least two photos that overlap, found one"),
        ("photos/00.png copy.png", "taken from the place of others"),
        ("flat.png photos/00.png", "flat.png: nothing in them to find again"),
        ("photos/00.png broken.png", "broken.png"),
        ("photos/00.png nothing.png", "nothing.png"),
        ("empty", "empty: expected photos"),
    ] {
        for command in ["cameras", "reconstruct"] {
            let output = run(folder, &format!("{command} {photos} -o out"));
            assert_eq!(output.status.code(), Some(1), "{command} {photos}: {}", said(&output));
            assert!(said(&output).contains(reason), "{command} {photos}: {}", said(&output));
            assert!(!folder.join("out").exists(), "{command} {photos} left something behind");
        }
    }
    let own = run(folder, "reconstruct truth -o out --focal 1.2");
    assert_eq!(own.status.code(), Some(2), "{}", said(&own));
    assert!(said(&own).contains("expected estimated cameras"), "{}", said(&own));
    let given = run(folder, "infer photos --cameras truth/transforms.json -o out --no-exif");
    assert_eq!(given.status.code(), Some(2), "{}", said(&given));
    let dry = run(folder, "fit photos --cameras estimated --dry-run -o out");
    assert_eq!(dry.status.code(), Some(2), "{}", said(&dry));
    assert!(!folder.join("out").exists());
    for wrong in ["--focal 0", "--focal x", "--match-size 3", "--quality perfect"] {
        let output = run(folder, &format!("reconstruct photos -o out {wrong}"));
        assert_eq!(output.status.code(), Some(2), "{wrong}: {}", said(&output));
    }
}

#[test]
fn what_is_not_used_is_said() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    photos(folder, 12);
    // A model of COLMAP that lacks a photo.
    let mut frames = Transforms::read(folder.join("truth/transforms.json")).unwrap().frames;
    frames.truncate(5);
    frames.iter_mut().for_each(|frame| frame.name = frame.name.replace("../photos/", ""));
    std::fs::create_dir_all(folder.join("capture/sparse/0")).unwrap();
    std::fs::rename(folder.join("photos"), folder.join("capture/images")).unwrap();
    weaver_io::colmap::Model::from_frames(&frames).write_binary(folder.join("capture/sparse/0")).unwrap();
    let output = run(folder, "fit capture -o out --steps 2 --gaussians 100 --long-side 48");
    let text = said(&output);
    assert!(output.status.success() && text.contains("capture/sparse/0: photos that are not"), "{text}");
    assert!(text.contains("capture/images/05.png"), "{text}");
    let text = said(&run(folder, "compare out/scene.ply --data capture --long-side 48"));
    assert!(text.contains("capture/sparse/0: photos that are not") && text.contains("05.png"), "{text}");

    // A photo that cannot be read is left out, with a warning.
    std::fs::write(folder.join("capture/images/06.heic"), b"\0\0\0\x18ftypheic\0\0\0\0mif1heic").unwrap();
    let output = run(folder, "cameras capture/images -o found --json");
    let text = said(&output);
    assert!(output.status.success(), "{text}");
    assert_eq!(placed(&json(&output))[0], 6, "{text}");
    assert!(text.contains("warning: 1 of 7 photos") && text.contains("capture/images/06.heic"), "{text}");
    let output = run(folder, "cameras capture/images/00.png capture/images/06.heic -o found");
    let text = said(&output);
    assert!(
        output.status.code() == Some(1) && text.contains("06.heic") && text.contains("cannot be decoded"),
        "{text}"
    );
}

/// Promise (photos): `reconstruct` and `fit` take masks of empty space, which shows the background.
#[test]
fn masks_may_say_that_nothing_stands_there() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    photos(folder, 12);
    std::fs::create_dir(folder.join("segments")).unwrap();
    let mut mask = Image::filled(192, 144, [0.0; 3]);
    mask.pixels.chunks_mut(3 * 192).for_each(|row| row[..3 * 150].fill(1.0));
    (0..6).for_each(|i| mask.write_png(folder.join(format!("segments/{i:02}.png"))).unwrap());
    let masks = "--masks segments --masked empty";
    let output = run(folder, &format!("reconstruct photos -o out --minutes 0.05 --gaussians 300 {masks}"));
    assert!(output.status.success(), "{}", said(&output));
    let output = run(folder, "fit out/cameras -o fitted --steps 2 --gaussians 300 --masks --masked empty");
    assert!(output.status.success(), "{}", said(&output));
    for run in ["out", "fitted"] {
        let settings = std::fs::read_to_string(folder.join(run).join("run.json")).unwrap();
        let settings: serde_json::Value = serde_json::from_str(&settings).unwrap();
        assert_eq!((&settings["masks"], &settings["masked"]), (&true.into(), &"empty".into()), "{run}");
        assert_eq!(settings["fit"]["background"], serde_json::json!([1.0, 1.0, 1.0]), "{run}");
    }
    // A capture names its masks.
    let output = run(folder, "reconstruct out/cameras -o again --masks segments");
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(said(&output).contains("masks that the capture names") && said(&output).contains("segments"));
    for wrong in ["--masked empty", "--invert-masks", "--masks segments --masked full"] {
        assert_eq!(run(folder, &format!("reconstruct photos -o again {wrong}")).status.code(), Some(2), "{wrong}");
    }
}

/// Photos that were cropped have a focal length of their own.
///
/// Promise (figures): photos of one lens that were cropped have a focal length of their own, which is said; ten
/// photos without a focal length find theirs.
#[test]
fn cropped_photos_have_their_own_focal_length() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    photos(folder, 12);
    for name in ["01", "04"] {
        let path = folder.join(format!("photos/{name}.png"));
        Image::read(&path, Default::default()).unwrap().crop(32, 8, 128, 128).write_png(&path).unwrap();
    }
    let output = run(folder, "cameras photos -o found --json");
    let text = said(&output);
    assert!(text.contains("photos of 2 proportions") && text.contains("--own-focal"), "{text}");
    assert_eq!(placed(&json(&output)), [6, 6], "{text}");
    let frames = Transforms::read(folder.join("found/transforms.json")).unwrap().frames;
    let truth = Transforms::read(folder.join("truth/transforms.json")).unwrap().frames;
    // In pixels, which cropping leaves as they are. Six photos of a narrow arc hardly determine the focal length
    // itself.
    let focal = frames.iter().map(|frame| frame.camera.intrinsics.fx / truth[0].camera.intrinsics.fx);
    let [least, most] = [f64::min, f64::max].map(|of| focal.clone().reduce(of).unwrap());
    assert!(most / least < 1.08 && most < 1.25, "focal lengths from {least:.3} to {most:.3} of the true one");
    let own = said(&run(folder, "cameras photos -o own --own-focal"));
    assert!(!own.contains("proportions"), "{own}");
}

/// Promise (figures): where no held-out photo has a place, no other one judges.
#[test]
fn photos_held_out_in_vain_are_not_replaced_by_others() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    photos(folder, 18);
    // The photos to be held out show nothing, and cannot be placed.
    for name in ["00", "08"] {
        Image::filled(192, 144, [0.4; 3]).write_png(folder.join(format!("photos/{name}.png"))).unwrap();
    }
    let output = run(folder, "reconstruct photos -o scene --minutes 0.05 --gaussians 500 --hold-out listed");
    let text = said(&output);
    assert!(output.status.success() && text.contains("held out   none"), "{text}");
    let summary = std::fs::read_to_string(folder.join("scene/summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    assert!(summary["test"].is_null() && summary["train"]["views"] == 7, "{summary}");
    // The written capture has no held-out photos either.
    let text = said(&run(folder, "compare scene/scene.ply --data scene"));
    assert!(text.contains("no photo is held out") && text.contains("all, none held out"), "{text}");
}

/// A reconstruction that was killed says how it goes on.
///
/// Promise (kept): a killed reconstruction prints the command that goes on.
#[cfg(unix)]
#[test]
fn a_killed_reconstruction_says_how_to_go_on() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    photos(folder, 12);
    let line = "reconstruct photos -o scene --minutes 0.3 --gaussians 500";
    let mut child = Command::new(BINARY)
        .current_dir(folder)
        .args(line.split(' '))
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    while !folder.join("scene/run.json").exists() {
        assert!(child.try_wait().unwrap().is_none(), "ended early");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let again = run(folder, line);
    assert_eq!(again.status.code(), Some(2), "{}", said(&again));
    assert!(said(&again).contains("to go on: splatweaver fit --resume scene"), "{}", said(&again));
    // Fewer steps than were chosen for the time, and then to the end.
    let path = folder.join("scene/run.json");
    let mut run_file: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
    run_file["fit"]["steps"] = 40.into();
    std::fs::write(&path, run_file.to_string()).unwrap();
    let _ = std::fs::remove_file(folder.join("scene/checkpoint.safetensors"));
    let resumed = run(folder, "fit --resume scene");
    assert!(resumed.status.success() && folder.join("scene/scene.ply").exists(), "{}", said(&resumed));
    assert!(said(&run(folder, line)).contains("a finished scene is there already"));
}
