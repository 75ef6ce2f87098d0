//! Fits in a time, and faults found before it is spent.

use super::{captured, fit, json, small};
use crate::in_process::splatweaver;

/// Promise (fits): a time that is too short makes a scene of 200 steps; the time that these take is printed, and the
/// excess at the end.
#[test]
fn short_times_make_scenes_and_their_excess_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let (capture, out) = (captured(folder.path()), folder.path().join("out"));
    let line: [&dyn AsRef<std::ffi::OsStr>; 6] =
        [&"--minutes", &"0.05", &"--least-steps", &"2000", &"--gaussians", &"300"];
    let done = fit(&capture, &out, &line).fine();
    let summary = json(&out.join("summary.json"));
    let (steps, seconds) = (summary["planned"].as_u64().unwrap(), summary["seconds"].as_f64().unwrap());
    assert!(steps >= 2000 && summary["steps"] == summary["planned"], "{summary}");
    let hurried = done.stderr.contains("of the 2000 steps that are made at least; all of it takes about ");
    assert!(hurried || steps > 2000, "{}", done.stderr);
    assert!(seconds < 3.6 || done.stderr.contains("more than was asked for"), "{seconds} s: {}", done.stderr);
}

/// Promise (fits): an empty scene to begin with is named before any work.
#[test]
fn an_empty_scene_to_begin_with_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let (capture, out) = (captured(folder.path()), folder.path().join("out"));
    let empty = folder.path().join("empty.ply");
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 0\n";
    let names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"];
    let rotation = ["rot_0", "rot_1", "rot_2", "rot_3"];
    let properties: String = names.iter().chain(&rotation).map(|name| format!("property float {name}\n")).collect();
    std::fs::write(&empty, format!("{header}{properties}end_header\n")).unwrap();
    small(&capture, &out, &[&"--init", &empty]).refused(1, &["empty.ply", "found an empty scene"]);
    assert!(!out.exists());
}

/// A job script of a larger machine runs here with as many threads as help, and says so; results are the same.
///
/// Promise of `threads_are_no_more_than_cores_can_use`.
#[test]
fn threads_beyond_the_cores_are_left_out_with_a_word() {
    let folder = tempfile::tempdir().unwrap();
    let capture = captured(folder.path());
    let scene = |threads: &str| {
        let out = folder.path().join(threads);
        let done = small(&capture, &out, &[&"--threads", &threads]).fine();
        (done.stderr.contains("are used, as there are"), std::fs::read(out.join("scene.ply")).unwrap())
    };
    let (few, many) = (scene("2"), scene("1000"));
    assert!(!few.0 && many.1 == few.1, "another scene");
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    assert_eq!(many.0, 8 * cores < 1000);
    let help = splatweaver(&[&"fit", &"--threads", &"1025"]);
    assert_eq!(help.code, 2, "{help:?}");
}
