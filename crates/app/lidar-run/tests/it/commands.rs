//! Runs of simulated scans.

use clap::Parser;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use weaver_command::{Console, Interrupt};
use weaver_data::lidar::{LidarWorld, SpinningSensor, room_loop};
use weaver_io::{TrajectoryFile, TrajectoryFormat, write_lidar_scan};
use weaver_lidar_run::{EvalTrajectory, KIND, Lidar, LidarJob, eval_trajectory, run};
use weaver_run::{Folder, Job, Run};

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    lidar: Lidar,
}

#[derive(Parser)]
struct Compared {
    #[command(flatten)]
    line: EvalTrajectory,
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
    let compared = Compared::parse_from(["eval-trajectory", &at("run/trajectory.txt"), &poses]);
    let (mut out, mut notes) = (Vec::new(), Vec::new());
    let mut console = Console::new(&mut out, &mut notes, false);
    eval_trajectory(&compared.line, &mut console).unwrap();
    let line = String::from_utf8(out).unwrap();
    let ate: f64 = line.split_whitespace().nth(1).unwrap().parse().unwrap();
    assert!(ate < 3.0, "{line}");
    let (result, ..) = command(&words);
    assert!(result.unwrap_err().contains("a run exists there already"));
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
    let plan = Folder::settings(Path::new(&stopped), KIND, "lidar").unwrap();
    for name in ["summary.json", "trajectory.txt", "map.ply", "report.html"] {
        std::fs::remove_file(Path::new(&stopped).join(name)).unwrap();
    }
    {
        let mut run = Run::begin(Folder::reopen(Path::new(&stopped), KIND).unwrap(), LidarJob::new(plan).unwrap());
        let stop = AtomicBool::new(false);
        let done = run.advance(&stop, |report| {
            stop.store(report.step == 3, std::sync::atomic::Ordering::Relaxed);
            Ok(())
        });
        assert!(!done.unwrap() && run.job.steps() == [3, 5]);
    }
    let (resumed, _, notes) = command(&["--resume", &stopped, "--live"]);
    resumed.unwrap();
    assert!(notes.contains("live: http://127.0.0.1:"), "{notes}");
    for name in ["trajectory.txt", "map.ply", "keyframes.toml"] {
        let [a, b] = [&whole, &stopped].map(|run| std::fs::read(Path::new(run).join(name)).unwrap());
        assert!(a == b, "{name}");
    }
    assert!(command(&["--resume", &stopped]).0.unwrap_err().contains("the run is complete"));
}

/// Scans that cannot be used are said and the rest is saved.
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
    assert!(Line::try_parse_from(["lidar", &scans, "--range", "5,3"]).is_err());
    assert!(Line::try_parse_from(["lidar", &scans, "--size", "64"]).is_err());
    assert!(!Path::new(&out).exists());
}
