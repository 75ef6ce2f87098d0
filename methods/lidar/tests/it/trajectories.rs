//! Errors of trajectories.

use clap::Parser;
use weaver_command::Console;
use weaver_lidar::command::{EvalTrajectory, eval_trajectory};

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    line: EvalTrajectory,
}

/// The output line of `eval-trajectory`, or its error's line.
pub fn compared(estimate: &str, reference: &str) -> Result<String, String> {
    words(&[estimate, reference])
}

fn words(words: &[&str]) -> Result<String, String> {
    let line = Line::parse_from([&["eval-trajectory"], words].concat()).line;
    let (mut out, mut notes) = (Vec::new(), Vec::new());
    let done = eval_trajectory(&line, &mut Console::new(&mut out, &mut notes, false));
    done.map(|()| String::from_utf8(out).unwrap()).map_err(|failure| failure.line().unwrap())
}

/// Poses along x at these times, in the TUM format.
fn along_x(path: &std::path::Path, times: &[f64], speed: f64) -> String {
    let line = |t: &f64| format!("{t} {} 0 0 0 0 0 1\n", speed * (t - times[0]));
    std::fs::write(path, times.iter().map(line).collect::<String>()).unwrap();
    path.to_str().unwrap().into()
}

/// Errors in percent of a reference without motion are absent, and not zero.
///
/// Promise (fits): errors of trajectories that are undefined are not given, and a pose is paired once.
#[test]
fn what_is_undefined_is_not_given() {
    let folder = tempfile::tempdir().unwrap();
    let times = [0.0, 1.0, 2.0, 3.0];
    let [moving, still] =
        [("a", 1.0), ("b", 0.0)].map(|(name, speed)| along_x(&folder.path().join(name), &times, speed));
    let line = compared(&moving, &still).unwrap();
    assert!(line.contains("RPE 100.00 cm, 0.000 degrees") && !line.contains('%'), "{line}");
    let figures: serde_json::Value = serde_json::from_str(&words(&[&moving, &still, "--json"]).unwrap()).unwrap();
    assert!(figures["rpe_percent"].is_null() && figures["rpe_m"] == 1.0, "{figures}");
    assert!(compared(&still, &moving).unwrap().contains("100.00 %"));
}

/// A pose belongs to one other at most, and times without anything in common make no pairs.
///
/// Promise of `what_is_undefined_is_not_given`.
#[test]
fn poses_are_paired_once() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str, times: &[f64]| along_x(&folder.path().join(name), times, 1.0);
    let few = at("few", &[0.0, 1.0, 2.0, 3.0, 4.0]);
    let sparse = at("sparse", &[0.0, 1000.0, 2000.0, 3000.0]);
    for [estimate, reference] in [[&few, &sparse], [&sparse, &few]] {
        let error = compared(estimate, reference).unwrap_err();
        assert!(error.contains("poses: expected at least two of the") && error.ends_with("found 1"), "{error}");
    }
    let later = at("later", &[100.0, 101.0, 102.0, 103.0, 104.0]);
    let error = compared(&few, &later).unwrap_err();
    assert!(error.contains("later: times: expected some of those of the estimate, 0 to 4"), "{error}");
    assert!(error.ends_with("found 100 to 104"), "{error}");
    // By order where the reference has no times, and by times where there are more of them.
    let row = |i: usize| format!("1 0 0 {i} 0 1 0 0 0 0 1 0\n");
    let kitti = folder.path().join("kitti");
    std::fs::write(&kitti, (0..5).map(row).collect::<String>()).unwrap();
    assert!(compared(&later, kitti.to_str().unwrap()).unwrap().ends_with("5 poses over 4.0 m\n"));
    let dense: Vec<f64> = (0..9).map(|i| 0.5 * f64::from(i)).collect();
    let dense = at("dense", &dense);
    let line = compared(&few, &dense).unwrap();
    assert!(line.starts_with("ATE 0.00 cm") && line.ends_with("5 poses over 4.0 m\n"), "{line}");
}
