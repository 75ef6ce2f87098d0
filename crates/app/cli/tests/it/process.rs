//! The binary as a process: exit codes, closed pipes, signals, a full disk.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use weaver_scene::Gaussians;

const BINARY: &str = env!("CARGO_BIN_EXE_splatweaver");

fn splatweaver(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(BINARY).current_dir(folder).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn exit_codes_tell_what_happened() {
    let folder = tempfile::tempdir().unwrap();
    let cases: [(&[&str], i32); 6] = [
        (&["--version"], 0),
        (&["info", "nothing.ply"], 1),
        (&["info"], 2),
        // No number means one per core, not 0.
        (&["train", "--threads", "0"], 2),
        (&["eval", "--threads", "0"], 2),
        (&["fit", "nothing", "--threads", "0"], 2),
    ];
    for (arguments, code) in cases {
        let done = splatweaver(folder.path(), arguments);
        assert_eq!(done.status.code(), Some(code), "{arguments:?}: {}", text(&done.stderr));
    }
    let done = splatweaver(folder.path(), &["info", "nothing.ply"]);
    assert_eq!(text(&done.stderr).lines().count(), 1);
    assert!(text(&done.stderr).starts_with("error: nothing.ply: "), "{}", text(&done.stderr));
}

/// A sphere of small Gaussians in many colors.
fn sphere(count: usize) -> Gaussians {
    let at = |n: usize| {
        let (z, turn) = (1.0 - 2.0 * (n as f32 + 0.5) / count as f32, 2.4 * n as f32);
        let radius = (1.0 - z * z).sqrt();
        [radius * turn.cos(), radius * turn.sin(), z]
    };
    Gaussians {
        means: (0..count).map(at).collect(),
        log_scales: vec![[-2.5; 3]; count],
        quats: vec![[1.0, 0.0, 0.0, 0.0]; count],
        opacity_logits: vec![3.0; count],
        sh: (0..count).flat_map(at).collect(),
        degree: 0,
    }
}

/// Promise (scenes): a compressed scene is drawn to the same bits in every process.
#[test]
fn a_compressed_scene_is_one_in_every_process() {
    let folder = tempfile::tempdir().unwrap();
    weaver_io::write_gaussians(folder.path().join("s.ply"), &sphere(400)).unwrap();
    let run = |line: &str| {
        let done = splatweaver(folder.path(), &line.split(' ').collect::<Vec<_>>());
        assert!(done.status.success(), "{line}: {}", text(&done.stderr));
    };
    run("compress s.ply -o s.wsz --psnr 40");
    run("convert s.wsz decoded.ply");
    for (scene, threads, out) in [("s.wsz", 1, "a"), ("s.wsz", 3, "b"), ("decoded.ply", 2, "c"), ("s.ply", 1, "d")] {
        run(&format!("render {scene} --orbit 2 --width 48 --height 36 --threads {threads} -o {out}"));
    }
    for picture in ["0000.png", "0001.png"] {
        let [a, b, c, d] =
            ["a", "b", "c", "d"].map(|out| std::fs::read(folder.path().join(out).join(picture)).unwrap());
        assert!(a == b && a == c, "{picture}: other bits in another process");
        assert!(a != d, "{picture}: nothing was lost");
    }
}

#[test]
fn an_instruction_set_that_is_none_is_refused() {
    let done = Command::new(BINARY).args(["completions", "bash"]).env("WEAVER_SIMD", "AVX2").output().unwrap();
    let stderr = text(&done.stderr);
    assert_eq!((done.status.code(), stderr.lines().count()), (Some(2), 1), "{stderr}");
    assert!(
        stderr.contains("WEAVER_SIMD") && stderr.contains("AVX2") && stderr.contains("portable, neon, avx2 or avx512")
    );
}

#[cfg(unix)]
mod unix {
    use super::*;
    use std::io::{BufRead, BufReader};

    #[test]
    fn a_reader_that_leaves_is_no_panic() {
        let child = Command::new(BINARY)
            .args(["completions", "bash"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut child = child;
        drop(child.stdout.take());
        let done = child.wait_with_output().unwrap();
        assert_eq!((done.status.code(), text(&done.stderr)), (Some(0), String::new()));
    }

    /// A small network, trained on a small capture.
    const MICRO: [&str; 6] = ["--preset", "micro", "--data", "capture", "--set", "data.scene_scale=1"];

    #[test]
    fn a_full_disk_leaves_the_old_checkpoint() {
        let folder = tempfile::tempdir().unwrap();
        let checkpoint = folder.path().join("run/checkpoint.safetensors");
        crate::command::capture(folder.path());
        let out = ["train", "--out", "run", "--set", "output.checkpoint_every=1"];
        let done = interrupted(folder.path(), &[&out, &MICRO[..]].concat());
        assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
        let before = std::fs::read(&checkpoint).unwrap();
        // Files of at most 8 blocks.
        let script = "ulimit -f 8; exec \"$0\" train --resume run";
        let done = Command::new("sh").args(["-c", script, BINARY]).current_dir(folder.path()).output().unwrap();
        let stderr = text(&done.stderr);
        assert_eq!(done.status.code(), Some(1), "{stderr}");
        let error = stderr.lines().last().unwrap();
        assert!(error.starts_with("error: run/") && error.contains("File too large"), "{stderr}");
        assert_eq!(std::fs::read(&checkpoint).unwrap(), before);
        let left: Vec<_> =
            std::fs::read_dir(folder.path().join("run")).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert!(left.iter().all(|name| !name.to_string_lossy().starts_with('.')), "{left:?}");
    }

    #[test]
    fn a_full_disk_leaves_no_half_a_dump() {
        let folder = tempfile::tempdir().unwrap();
        let script =
            "ulimit -f 8; exec \"$0\" bench raster --synthetic 2000,64,48 --runs 1 --json --dump out.safetensors";
        let done = Command::new("sh").args(["-c", script, BINARY]).current_dir(folder.path()).output().unwrap();
        let stderr = text(&done.stderr);
        assert_eq!((done.status.code(), text(&done.stdout)), (Some(1), String::new()), "{stderr}");
        assert!(stderr.starts_with("error: out.safetensors: ") && stderr.contains("File too large"), "{stderr}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn an_interrupted_run_goes_on_to_the_same_weights() {
        let folder = tempfile::tempdir().unwrap();
        crate::command::capture(folder.path());
        let steps = [&["--steps", "20", "--set", "output.sample_every=1000"], &MICRO[..]].concat();
        let whole = [&["train", "--out", "whole"][..], &steps].concat();
        let parts = [&["train", "--out", "parts"][..], &steps].concat();
        assert!(splatweaver(folder.path(), &whole).status.success());
        let done = interrupted(folder.path(), &parts);
        let stderr = text(&done.stderr);
        assert_eq!(done.status.code(), Some(0), "{stderr}");
        assert!(stderr.contains("splatweaver train --resume parts"), "{stderr}");
        let judged = |run: &str| text(&splatweaver(folder.path(), &["eval", "--run", run]).stderr);
        assert!(judged("parts").contains("warning: parts is at step "), "{}", judged("parts"));
        assert!(!judged("whole").contains("warning"), "{}", judged("whole"));
        assert!(splatweaver(folder.path(), &["train", "--resume", "parts"]).status.success());
        let checksum = |run: &str| {
            let summary = std::fs::read_to_string(folder.path().join(run).join("summary.json")).unwrap();
            let line = summary.lines().find(|l| l.contains("\"checksum\"")).unwrap().to_string();
            (line, summary.contains("\"steps\": 20"))
        };
        assert_eq!(checksum("parts"), checksum("whole"));
        assert!(checksum("parts").1);
    }

    /// Starts a training run and presses Ctrl-C as soon as the first step is logged.
    fn interrupted(folder: &Path, arguments: &[&str]) -> Output {
        let mut child = Command::new(BINARY)
            .current_dir(folder)
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut stderr = BufReader::new(child.stderr.take().unwrap());
        let mut said = String::new();
        while !said.contains("run folder") {
            assert!(stderr.read_line(&mut said).unwrap() > 0, "ended early: {said}");
        }
        let run = said.split("run folder ").nth(1).unwrap().trim().to_string();
        let log = folder.join(run).join("metrics.jsonl");
        while std::fs::read_to_string(&log).map_or(true, |t| t.is_empty()) {
            assert!(child.try_wait().unwrap().is_none(), "ended before the first step");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        let id = child.id().to_string();
        assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
        std::io::Read::read_to_string(&mut stderr, &mut said).unwrap();
        let done = child.wait_with_output().unwrap();
        Output { stderr: said.into_bytes(), ..done }
    }
}
