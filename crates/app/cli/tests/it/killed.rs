//! Training that is killed at any moment, or runs out of disk, goes on to the same bits.
//!
//! `cargo xtask stress kill` does this a hundred times.

use crate::command::capture;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use weaver_kernels::random::Stream;

const BINARY: &str = env!("CARGO_BIN_EXE_splatweaver");

/// Kills of an ordinary run; `WEAVER_KILLS` sets another number.
const TIMES: u64 = 3;

fn times() -> u64 {
    std::env::var("WEAVER_KILLS").map_or(TIMES, |n| n.parse().unwrap())
}

/// A shell that runs the binary, with files of at most `blocks` blocks.
fn start(folder: &Path, arguments: &str, blocks: Option<u64>) -> Child {
    let limit = blocks.map_or(String::new(), |blocks| format!("ulimit -f {blocks}; "));
    let script = format!("{limit}exec \"$0\" {arguments}");
    let quiet = || Stdio::null();
    let mut command = Command::new("sh");
    command.args(["-c", &script, BINARY]).current_dir(folder).stdout(quiet()).stderr(quiet()).spawn().unwrap()
}

fn train(out: &str, steps: u64) -> String {
    // A checkpoint at every step, so that many a kill meets one that is being written.
    let data = "--data capture --set data.scene_scale=1";
    let settings = "--set output.checkpoint_every=1 --set output.sample_every=100000 --set output.log_every=1";
    format!("train --preset micro --steps {steps} --seed 3 --threads 1 --out {out} {data} {settings}")
}

fn checkpoint(folder: &Path, run: &str) -> Vec<u8> {
    fs::read(folder.join(run).join("checkpoint.safetensors")).unwrap()
}

/// The lines of the log, without the time that each took.
fn log(folder: &Path, run: &str) -> Vec<String> {
    let text = fs::read_to_string(folder.join(run).join("metrics.jsonl")).unwrap();
    text.lines().map(|line| line.split("\"seconds\"").next().unwrap().to_string()).collect()
}

/// Trains `steps` steps in one session and in many, each ended by `end`, and compares checkpoint and log.
fn the_same(steps: u64, end: impl Fn(&Path, u64)) {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    capture(folder);
    assert!(start(folder, &train("whole", steps), None).wait().unwrap().success());
    let mut first = start(folder, &train("parts", steps), None);
    while !folder.join("parts/checkpoint.safetensors").exists() {
        assert!(first.try_wait().unwrap().is_none(), "ended before its first checkpoint");
        std::thread::sleep(Duration::from_millis(2));
    }
    first.kill().unwrap();
    first.wait().unwrap();
    for time in 0..times() {
        end(folder, time);
        // After every kind of end, the checkpoint is whole.
        weaver_io::safetensors::Tensors::read(folder.join("parts/checkpoint.safetensors")).unwrap();
    }
    assert!(start(folder, "train --resume parts --threads 1", None).wait().unwrap().success());
    assert!(checkpoint(folder, "parts") == checkpoint(folder, "whole"));
    assert_eq!(log(folder, "parts"), log(folder, "whole"));
}

/// Promise (kept): a run that is killed at any moment, or out of disk, goes on to the same bits.
#[test]
fn killed_at_any_moment_it_ends_with_the_same_bits() {
    let moments = Stream::new(5, 0, "test.kill");
    the_same(4 + times() / 2, |folder, time| {
        let mut child = start(folder, "train --resume parts --threads 1", None);
        std::thread::sleep(Duration::from_millis(moments.below(time, 500) as u64));
        // It may have ended by itself.
        let _ = child.kill();
        child.wait().unwrap();
    });
}

/// Promise of `killed_at_any_moment_it_ends_with_the_same_bits`.
#[test]
fn out_of_disk_it_ends_with_the_same_bits() {
    let sizes = Stream::new(6, 0, "test.disk");
    the_same(4 + times() / 2, |folder, time| {
        // From no room at all to nearly a checkpoint's, in blocks of 512 bytes.
        let room = checkpoint(folder, "parts").len() / 512;
        let blocks = sizes.below(time, room) as u64;
        let done = start(folder, "train --resume parts --threads 1", Some(blocks)).wait().unwrap();
        assert!(done.code().is_some_and(|code| code <= 1), "{blocks} blocks: {done}");
    });
}
