//! A fit as a process: killed, interrupted, on a full disk.

use crate::command::capture;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::sync::LazyLock;
use std::time::Duration;
use weaver_io::safetensors::Tensors;

const BINARY: &str = env!("CARGO_BIN_EXE_splatweaver");
const STEPS: u64 = 1500;

fn arguments(out: &str) -> Vec<String> {
    let line = format!("fit capture -o {out} --steps {STEPS} --gaussians 500 --save-every 0.02 --exposure");
    line.split(' ').map(String::from).collect()
}

fn run(folder: &Path, arguments: &[impl AsRef<std::ffi::OsStr>]) -> Output {
    Command::new(BINARY).current_dir(folder).args(arguments).output().unwrap()
}

fn start(folder: &Path, arguments: &[impl AsRef<std::ffi::OsStr>]) -> Child {
    let silent = || Stdio::null();
    Command::new(BINARY).current_dir(folder).args(arguments).stdout(silent()).stderr(silent()).spawn().unwrap()
}

fn signal(child: &Child, name: &str) {
    assert!(Command::new("kill").args([name, &child.id().to_string()]).status().unwrap().success());
}

/// Steps of the last checkpoint; 0 if there is none.
fn saved(run: &Path) -> u64 {
    let checkpoint = run.join("checkpoint.safetensors");
    if !checkpoint.exists() {
        return 0;
    }
    Tensors::read(checkpoint).unwrap().values::<u64>("step", &[1, 1]).unwrap()[0]
}

fn scene_bytes(run: &Path) -> Vec<u8> {
    std::fs::read(run.join("scene.ply")).unwrap()
}

/// The scene of a fit that nothing interrupts.
static WHOLE: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    capture(folder.path());
    let whole = run(folder.path(), &arguments("whole"));
    assert!(whole.status.success(), "{}", String::from_utf8_lossy(&whole.stderr));
    scene_bytes(&folder.path().join("whole"))
});

#[test]
fn killed_twenty_times_it_ends_with_the_same_bits() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    capture(folder);
    let parts = folder.join("parts");
    let mut child = start(folder, &arguments("parts"));
    while !parts.join("run.json").exists() {
        std::thread::sleep(Duration::from_millis(5));
    }
    let mut reached = 0;
    for kill in 0..20 {
        // Now and then before the first checkpoint of a session, mostly after some.
        std::thread::sleep(Duration::from_millis(7 + 31 * (kill % 7)));
        // It may have ended by itself.
        let _ = child.kill();
        child.wait().unwrap();
        let now = saved(&parts);
        assert!(now >= reached, "kill {kill}: step {now} after {reached}");
        reached = now;
        child = start(folder, &["fit", "--resume", "parts"]);
    }
    assert!(child.wait().unwrap().success());
    assert!(saved(&parts) == STEPS && scene_bytes(&parts) == *WHOLE);
}

#[test]
fn interrupted_it_leaves_results_and_goes_on() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    capture(folder);
    let parts = folder.join("parts");
    let mut child = start(folder, &arguments("parts"));
    while saved(&parts) == 0 {
        std::thread::sleep(Duration::from_millis(5));
    }
    signal(&child, "-INT");
    assert!(child.wait().unwrap().success());
    let summary = std::fs::read_to_string(parts.join("summary.json")).unwrap();
    let ended_early = !summary.contains(&format!("\"steps\": {STEPS}"));
    assert!(ended_early, "{summary}");
    assert!(parts.join("report.html").is_file() && !scene_bytes(&parts).is_empty());
    assert!(run(folder, &["fit", "--resume", "parts"]).status.success());
    assert!(scene_bytes(&parts) == *WHOLE);
}

#[test]
fn a_full_disk_leaves_the_last_checkpoint() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    capture(folder);
    let parts = folder.join("parts");
    let mut child = start(folder, &arguments("parts"));
    while saved(&parts) == 0 {
        std::thread::sleep(Duration::from_millis(5));
    }
    let _ = child.kill();
    child.wait().unwrap();
    let before = std::fs::read(parts.join("checkpoint.safetensors")).unwrap();
    let script = "ulimit -f 8; exec \"$0\" fit --resume parts";
    let done = Command::new("sh").args(["-c", script, BINARY]).current_dir(folder).output().unwrap();
    let stderr = String::from_utf8_lossy(&done.stderr).into_owned();
    assert_eq!(done.status.code(), Some(1), "{stderr}");
    let error = stderr.lines().last().unwrap();
    assert!(error.starts_with("error: parts/") && error.contains("File too large"), "{stderr}");
    assert!(std::fs::read(parts.join("checkpoint.safetensors")).unwrap() == before);
    assert!(run(folder, &["fit", "--resume", "parts"]).status.success());
}
