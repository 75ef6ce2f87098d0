//! Training and fits by processes of an MPI, under `mpirun`; skipped where there is none.

mod fit;

use crate::capture;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const BINARY: &str = env!("CARGO_BIN_EXE_splatweaver");
const RUN: &str = "train --preset micro --steps 6 --set optimizer.accumulate=4 --set output.checkpoint_every=1 \
                   --set output.log_every=1";

/// `count` processes, on any number of processors.
fn mpirun(folder: &Path, count: usize, words: &str) -> Command {
    let mut command = Command::new("mpirun");
    command.args(["--oversubscribe", "--allow-run-as-root", "-n", &count.to_string(), BINARY]).args(words.split(' '));
    command.args(["--threads", "1"]).current_dir(folder).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn done(mut command: Command) -> Output {
    command.output().unwrap()
}

fn weights(folder: &Path, run: &str) -> Vec<u8> {
    std::fs::read(folder.join(run).join("checkpoint.safetensors")).unwrap()
}

/// True where `mpirun` starts processes; says so where it does not.
fn is_there() -> bool {
    let there = Command::new("mpirun").arg("--version").output().is_ok_and(|done| done.status.success());
    if !there {
        eprintln!("skipped: no mpirun");
    }
    there
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// One, two and four processes come to the same bits, also where a run goes on with another number of them.
#[test]
fn processes_come_to_the_same_bits() {
    if !is_there() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for count in [1, 2, 4] {
        let output = done(mpirun(folder.path(), count, &format!("{RUN} --out run-{count}")));
        assert!(output.status.success(), "{}", said(&output));
    }
    let one = weights(folder.path(), "run-1");
    assert!(weights(folder.path(), "run-2") == one && weights(folder.path(), "run-4") == one);
    let alone = Command::new(BINARY)
        .args(format!("{RUN} --out alone --threads 1").split(' '))
        .current_dir(folder.path())
        .output();
    assert!(alone.unwrap().status.success() && weights(folder.path(), "alone") == one);

    // Killed after two steps, on with another number of processes.
    let mut child = mpirun(folder.path(), 2, &format!("{RUN} --out parts")).spawn().unwrap();
    wait_for(&mut child, &folder.path().join("parts"), 2);
    kill_one(&mut child);
    let output = done(mpirun(folder.path(), 3, "train --resume parts"));
    assert!(output.status.success() && weights(folder.path(), "parts") == one, "{}", said(&output));
}

/// Waits until `steps` steps are logged, each after a checkpoint of the step before.
fn wait_for(child: &mut Child, run: &Path, steps: usize) {
    let logged = || std::fs::read_to_string(run.join("metrics.jsonl")).map_or(0, |text| text.lines().count());
    while logged() < steps {
        assert!(child.try_wait().unwrap().is_none(), "it ended before step {steps}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Kills one of the processes that `mpirun` started; all end within ten seconds.
fn kill_one(child: &mut Child) {
    let children = Command::new("pgrep").args(["-P", &child.id().to_string()]).output().unwrap();
    let last = String::from_utf8(children.stdout).unwrap().lines().last().unwrap().to_string();
    assert!(Command::new("kill").args(["-9", &last]).status().unwrap().success());
    let start = Instant::now();
    assert!(!child.wait().unwrap().success());
    assert!(start.elapsed() < Duration::from_secs(10), "{:?}", start.elapsed());
}

/// A process that reads other photos, a full disk and too many processes end all, and leave the last checkpoint.
#[test]
fn a_failure_of_one_process_ends_all() {
    if !is_there() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let many = done(mpirun(folder.path(), 5, &format!("{RUN} --out many")));
    let text = said(&many);
    assert!(!many.status.success() && text.contains("at least one batch for each of 5 processes, found 4"), "{text}");

    // Each process reads the capture of its own working directory.
    for name in ["a", "b"] {
        capture::colmap(&folder.path().join(name).join("capture"), capture::VIEWS);
    }
    let photo = folder.path().join("b/capture/images/03.png");
    let mut image = weaver_io::Image::read(&photo, weaver_io::Background::White).unwrap();
    image.pixels[5] = 1.0 - image.pixels[5];
    image.write_png(&photo).unwrap();
    let script = format!(
        "d=a; [ $OMPI_COMM_WORLD_RANK = 1 ] && d=b; ln -sfn $d/capture link-$d; exec \"$0\" {RUN} --data $PWD/link-$d --out other"
    );
    let mut command = Command::new("mpirun");
    command.args(["--oversubscribe", "--allow-run-as-root", "-n", "2", "sh", "-c", &script, BINARY]);
    let other = command.current_dir(folder.path()).output().unwrap();
    assert!(!other.status.success() && said(&other).contains("process 1"), "{}", said(&other));

    let begun = done(mpirun(folder.path(), 2, &format!("{RUN} --out full")));
    assert!(begun.status.success(), "{}", said(&begun));
    let before = weights(folder.path(), "full");
    let script = "ulimit -f 8; exec \"$0\" train --resume full --steps 8 --threads 1";
    let mut command = Command::new("mpirun");
    command.args(["--oversubscribe", "--allow-run-as-root", "-n", "2", "sh", "-c", script, BINARY]);
    let full = command.current_dir(folder.path()).output().unwrap();
    assert!(!full.status.success() && said(&full).contains("File too large"), "{}", said(&full));
    assert!(weights(folder.path(), "full") == before);
}
