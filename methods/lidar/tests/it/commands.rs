//! Runs of simulated scans.

use clap::Parser;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use weaver_command::{Console, Interrupt};
use weaver_io::{TrajectoryFile, TrajectoryFormat, write_lidar_scan};
use weaver_lidar::command::{KIND, Lidar, LidarJob, LidarPlan, run};
use weaver_procedural::lidar::{LidarWorld, SpinningSensor, room_loop};
use weaver_run::{Folder, Job, Run};

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    lidar: Lidar,
}

/// Writes scans of the beginning of a loop.
pub fn scans(folder: &Path, count: usize) {
    let (world, poses) = (LidarWorld::room(), room_loop(120));
    std::fs::create_dir(folder.join("scans")).unwrap();
    let sensor = SpinningSensor { columns: 256, ..Default::default() };
    for (i, pose) in poses.iter().take(count).enumerate() {
        let sweep = sensor.sweep(&world, |_| *pose, 0, i as u64);
        write_lidar_scan(folder.join(format!("scans/{i:04}.bin")), &sweep.points).unwrap();
    }
    let file = TrajectoryFile { poses: poses[..count].to_vec(), times: (0..count).map(|i| i as f64).collect() };
    file.write(folder.join("poses.txt"), TrajectoryFormat::Kitti).unwrap();
}

pub fn command(words: &[&str]) -> (Result<(), String>, String, String) {
    let line = Line::parse_from([&["lidar"], words].concat());
    let (mut out, mut notes) = (Vec::new(), Vec::new());
    let mut console = Console::new(&mut out, &mut notes, false);
    let result = run(&line.lidar, &mut console, &Interrupt::new());
    let texts = [out, notes].map(|text| String::from_utf8(text).unwrap());
    let [out, notes] = texts;
    (result.map_err(|failure| failure.line().unwrap_or_default()), out, notes)
}

pub const SMALL: [&str; 8] = ["--size", "32x256", "--steps", "20", "--density", "1", "--keyframe-distance", "0.6"];

pub fn text(path: PathBuf) -> String {
    path.to_str().unwrap().into()
}

#[test]
fn a_run_leaves_all_its_files_and_is_compared() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(folder.path().join(name));
    scans(folder.path(), 5);
    let (scans, poses, out) = (at("scans"), at("poses.txt"), at("run"));
    let words = [&[scans.as_str(), "--reference", &poses, "--out", &out, "--json"][..], &SMALL].concat();
    let (result, printed, notes) = command(&words);
    result.unwrap();
    assert!(printed.starts_with('{') && printed.contains("\"ate_m\""), "{printed}");
    assert!(!notes.contains("lost"), "{notes}");
    for name in
        ["run.json", "trajectory.txt", "keyframes.toml", "map.ply", "summary.json", "report.html", "metrics.jsonl"]
    {
        assert!(folder.path().join("run").join(name).exists(), "{name}");
    }
    let line = crate::trajectories::compared(&at("run/trajectory.txt"), &poses).unwrap();
    let ate: f64 = line.split_whitespace().nth(1).unwrap().parse().unwrap();
    assert!(ate < 3.0, "{line}");
    let (result, ..) = command(&words);
    assert!(result.unwrap_err().contains("a run exists there already"));
}

fn plan(run: &Path) -> LidarPlan {
    Folder::settings(run, KIND, "lidar").unwrap()
}

/// Turns a complete run into one that stopped after `scans` scans.
fn stop_at(path: &Path, scans: usize) {
    for name in ["summary.json", "trajectory.txt", "map.ply", "report.html"] {
        std::fs::remove_file(path.join(name)).unwrap();
    }
    let mut run = Run::begin(Folder::reopen(path, KIND).unwrap(), LidarJob::stored(plan(path)).unwrap());
    let stop = AtomicBool::new(false);
    let done = run.advance(&stop, |report| {
        stop.store(report.step == scans, std::sync::atomic::Ordering::Relaxed);
        Ok(())
    });
    assert!(!done.unwrap() && run.job.steps()[0] == scans);
}

#[test]
fn a_stopped_run_goes_on_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(folder.path().join(name));
    scans(folder.path(), 5);
    let (scans, whole, stopped) = (at("scans"), at("whole"), at("stopped"));
    command(&[&[scans.as_str(), "--out", &whole][..], &SMALL].concat()).0.unwrap();
    // Stopped before it is done: two scans by hand, then the checkpoint.
    command(&[&[scans.as_str(), "--out", &stopped][..], &SMALL].concat()).0.unwrap();
    stop_at(Path::new(&stopped), 3);
    let (resumed, _, notes) = command(&["--resume", &stopped, "--live"]);
    resumed.unwrap();
    assert!(notes.contains("live: http://127.0.0.1:"), "{notes}");
    for name in ["trajectory.txt", "map.ply", "keyframes.toml"] {
        let [a, b] = [&whole, &stopped].map(|run| std::fs::read(Path::new(run).join(name)).unwrap());
        assert!(a == b, "{name}");
    }
    assert!(command(&["--resume", &stopped]).0.unwrap_err().contains("the run is complete"));
}

/// Unusable scans are reported and the rest is saved.
#[test]
fn unusable_scans_are_named_and_the_rest_saved() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(folder.path().join(name));
    scans(folder.path(), 4);
    write_lidar_scan(folder.path().join("scans/0002.bin"), &[[900.0, 0.0, 0.0]]).unwrap();
    let (scans, out) = (at("scans"), at("run"));
    let (result, printed, notes) = command(&[&[scans.as_str(), "--out", &out][..], &SMALL].concat());
    result.unwrap();
    assert!(notes.contains("lost: 0002.bin: expected points between 1 and 60 m, found none among 1"), "{notes}");
    assert!(printed.contains("4 of 4 scans, 1 lost"), "{printed}");
}

/// A file without points, a cut one and one of another kind cost a scan each, at every point of interruption, and not
/// the run. The first file must be a scan.
///
/// Promise (fits): a bad file costs a scan and not the run.
#[test]
fn bad_files_cost_a_scan_each() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(folder.path().join(name));
    scans(folder.path(), 7);
    for (name, content) in [("scans/0001.bin", &[][..]), ("scans/0003.bin", &[1; 13]), ("scans/0005.pcd", b"PCD")] {
        std::fs::write(at(name), content).unwrap();
    }
    std::fs::remove_file(at("scans/0005.bin")).unwrap();
    let (scans, out) = (at("scans"), at("run"));
    let (result, printed, notes) = command(&[&[scans.as_str(), "--out", &out][..], &SMALL].concat());
    result.unwrap();
    assert!(printed.contains("7 of 7 scans, 3 lost"), "{printed}");
    for line in
        ["lost: 0001.bin: points: expected", "lost: 0003.bin: size: expected", "lost: 0005.pcd: header: expected"]
    {
        assert_eq!(notes.matches(line).count(), 1, "{line}: {notes}");
    }
    let whole = std::fs::read(at("run/trajectory.txt")).unwrap();
    stop_at(Path::new(&out), 2);
    command(&["--resume", &out]).0.unwrap();
    assert_eq!(std::fs::read(at("run/trajectory.txt")).unwrap(), whole);
    std::fs::write(at("scans/0000.bin"), "").unwrap();
    let found = command(&[&scans, "--out", &at("other")]).0.unwrap_err();
    assert!(found.contains("0000.bin: points: expected at least one, found none"), "{found}");
}

/// Scans are taken in the order of the numbers in their names. A run of an earlier version keeps its original order of
/// bytes.
///
/// Promise (fits): scans and photos are taken in the order of the numbers in their names; runs of earlier versions
/// keep their order.
#[test]
fn scans_are_taken_in_the_order_of_their_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(folder.path().join(name));
    scans(folder.path(), 3);
    for (i, name) in ["2", "9", "10"].iter().enumerate() {
        std::fs::rename(at(&format!("scans/{i:04}.bin")), at(&format!("scans/{name}.bin"))).unwrap();
    }
    let (scans, poses, out) = (at("scans"), at("poses.txt"), at("run"));
    let (result, printed, _) = command(&[&[scans.as_str(), "--reference", &poses, "--out", &out][..], &SMALL].concat());
    result.unwrap();
    assert!(printed.contains("3 of 3 scans, 0 lost"), "{printed}");
    let taken = |plan: LidarPlan| -> Vec<String> {
        let job = LidarJob::stored(plan).unwrap();
        job.files().iter().map(|file| file.file_name().unwrap().to_str().unwrap().into()).collect()
    };
    assert_eq!(taken(plan(Path::new(&out))), ["2.bin", "9.bin", "10.bin"]);
    let settings = std::fs::read_to_string(at("run/run.json")).unwrap();
    let mut settings: serde_json::Value = serde_json::from_str(&settings).unwrap();
    settings.as_object_mut().unwrap().remove("sources").unwrap();
    assert_eq!(taken(serde_json::from_value(settings).unwrap()), ["10.bin", "2.bin", "9.bin"]);
}

/// A run resumes with its original scans only, processed or not: the first changed one is named.
///
/// Promise (fits): a run of lidar goes on with the scans that it began with, and with no others.
#[test]
fn a_run_goes_on_with_its_own_scans_alone() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(folder.path().join(name));
    scans(folder.path(), 5);
    let (scans, out) = (at("scans"), at("run"));
    command(&[&[scans.as_str(), "--out", &out][..], &SMALL].concat()).0.unwrap();
    stop_at(Path::new(&out), 1);
    let refused = |name: &str, found: &str| {
        let line = command(&["--resume", &out]).0.unwrap_err();
        let expected = format!("{name}: scan: expected that with which the run began, found {found}");
        assert!(line.ends_with(&expected), "{line}");
    };
    let exchange = || {
        std::fs::rename(at("scans/0002.bin"), at("kept")).unwrap();
        std::fs::rename(at("scans/0004.bin"), at("scans/0002.bin")).unwrap();
        std::fs::rename(at("kept"), at("scans/0004.bin")).unwrap();
    };
    exchange();
    refused("0002.bin", "another");
    exchange();
    std::fs::copy(at("scans/0001.bin"), at("scans/0001b.bin")).unwrap();
    refused("0001b.bin", "one more");
    std::fs::rename(at("scans/0001b.bin"), at("kept")).unwrap();
    std::fs::rename(at("scans/0003.bin"), at("gone")).unwrap();
    refused("0003.bin", "none");
    std::fs::rename(at("gone"), at("scans/0003.bin")).unwrap();
    command(&["--resume", &out]).0.unwrap();
}

/// Numbers of a stored run are held to the bounds of the command line by all its readers.
///
/// Promise (fits): numbers of a stored run of lidar are held to the bounds of the command line.
#[test]
fn numbers_of_a_stored_run_are_checked() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(folder.path().join(name));
    scans(folder.path(), 2);
    let (scans, out) = (at("scans"), at("run"));
    command(&[&[scans.as_str(), "--fov", "-20,20", "--out", &out][..], &SMALL].concat()).0.unwrap();
    let whole: serde_json::Value = serde_json::from_slice(&std::fs::read(at("run/run.json")).unwrap()).unwrap();
    for (key, value, flag) in [
        ("size", serde_json::json!([64, 0]), "--size"),
        ("size", serde_json::json!([0, 0]), "--size"),
        ("size", serde_json::json!([4_294_967_296_u64, 64]), "--size"),
        ("fov", serde_json::json!([-90_000, 90_000]), "--fov"),
        ("range", serde_json::json!([-1, 5]), "--range"),
        ("density", serde_json::json!(-1e300), "--density"),
        ("keyframe_distance", serde_json::json!(-1), "--keyframe-distance"),
        ("steps", serde_json::json!(4_000_000_000_u32), "--steps"),
        ("seed", serde_json::json!(u64::MAX), "--seed"),
        ("scans", serde_json::Value::Null, "required"),
    ] {
        let mut settings = whole.clone();
        settings[key] = value;
        std::fs::write(at("run/run.json"), settings.to_string()).unwrap();
        let resumed = command(&["--resume", &out]).0.unwrap_err();
        let meshed = crate::meshes::of_run(&out, 0.5).unwrap_err();
        for line in [resumed, meshed] {
            assert!(line.contains("run.json: settings: expected those of") && line.contains(flag), "{key}: {line}");
        }
    }
    std::fs::write(at("run/run.json"), whole.to_string()).unwrap();
    crate::meshes::of_run(&out, 0.5).unwrap();
}

/// Promise of `numbers_of_a_stored_run_are_checked`.
#[test]
fn what_cannot_be_right_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(folder.path().join(name));
    scans(folder.path(), 3);
    let (scans, poses, out) = (at("scans"), at("poses.txt"), at("run"));
    std::fs::write(&poses, "1 0 0 0 0 1 0 0 0 0 1 0\n").unwrap();
    let message = |words: &[&str]| command(words).0.unwrap_err();
    let found = message(&[&scans, "--poses", &poses, "--out", &out]);
    assert!(found.contains("poses: expected 3, one for each scan, found 1"), "{found}");
    let found = message(&[&at("nowhere"), "--out", &out]);
    assert!(found.contains("nowhere"), "{found}");
    std::fs::create_dir(at("empty")).unwrap();
    let found = message(&[&at("empty"), "--out", &out]);
    assert!(found.contains("scans: expected at least two"), "{found}");
    assert!(
        Line::try_parse_from(["lidar"]).is_err() && Line::try_parse_from(["lidar", &scans, "--resume", &out]).is_err()
    );
    for (flag, value) in [
        ("--range", "5,3"),
        ("--range", "-1,3"),
        ("--size", "64"),
        ("--fov", "-90000,90000"),
        ("--fov", "10,-10"),
        ("--keyframe-distance", "nan"),
        ("--keyframe-distance", "inf"),
        ("--density", "nan"),
        ("--density", "0"),
    ] {
        assert!(Line::try_parse_from(["lidar", &scans, &format!("{flag}={value}")]).is_err(), "{flag} {value}");
    }
    assert!(Line::try_parse_from(["lidar", &scans, "--fov", "-90,90", "--keyframe-distance", "0"]).is_ok());
    assert!(!Path::new(&out).exists());
}
