//! Fits by processes of an MPI.

use super::{BINARY, done, is_there, kill_one, mpirun, said, wait_for};
use crate::capture;
use std::path::Path;
use std::process::Command;

/// Steps of four photos, with everything that has a state.
const FIT: &str = "fit capture --steps 40 --gaussians 300 --set views_per_step=4 --exposure --refine-cameras --no-html --save-every 0";

fn scene(folder: &Path, out: &str) -> Vec<u8> {
    std::fs::read(folder.join(out).join("scene.ply")).unwrap()
}

/// Promise (kept): under `mpirun`, a fit of 1, 2 and 4 processes is the same scene, a killed process ends all and
/// another number goes on; too many processes, other photos and a full disk end all with the reason.
#[test]
fn fits_of_processes_are_the_same_bits() {
    if !is_there() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    capture::colmap(&folder.path().join("capture"), 10);
    for count in [1, 2, 4] {
        let output = done(mpirun(folder.path(), count, &format!("{FIT} -o fit-{count}")));
        assert!(output.status.success(), "{}", said(&output));
    }
    let one = scene(folder.path(), "fit-1");
    assert!(scene(folder.path(), "fit-2") == one && scene(folder.path(), "fit-4") == one);
    let alone =
        Command::new(BINARY).args(format!("{FIT} -o alone --threads 1").split(' ')).current_dir(folder.path()).output();
    assert!(alone.unwrap().status.success() && scene(folder.path(), "alone") == one);

    // Killed in the middle, on with another number of processes.
    let unit = format!("{} -o parts --if-complete skip", FIT.replace("--steps 40", "--steps 400"));
    let mut child = mpirun(folder.path(), 2, &unit).spawn().unwrap();
    wait_for(&mut child, &folder.path().join("parts"), 2);
    kill_one(&mut child);
    let output = done(mpirun(folder.path(), 3, &unit));
    assert!(output.status.success() && said(&output).contains("goes on"), "{}", said(&output));
    let output = done(mpirun(folder.path(), 2, &unit));
    assert!(output.status.success() && said(&output).contains("nothing to do"), "{}", said(&output));
    let whole =
        Command::new(BINARY).args(unit.replace("parts", "whole").split(' ')).current_dir(folder.path()).output();
    assert!(whole.unwrap().status.success());
    assert!(scene(folder.path(), "parts") == scene(folder.path(), "whole"));
}

/// Too many processes, one that reads another photo and a full disk end all processes of a fit and say why.
///
/// Promise of `fits_of_processes_are_the_same_bits`.
#[test]
fn a_failure_of_one_process_ends_a_fit() {
    if !is_there() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    capture::colmap(&path("capture"), 10);
    let many = done(mpirun(folder.path(), 5, &format!("{FIT} -o many")));
    let text = said(&many);
    assert!(!many.status.success() && text.contains("at least one photo for each of 5 processes, found 4"), "{text}");
    assert!(!path("many").exists(), "nothing is left of a run that could not begin");

    if cfg!(target_os = "linux") {
        // One path, behind which each process has a capture of its own.
        for rank in ["0", "1"] {
            capture::colmap(&path(rank).join("capture"), 10);
        }
        let photo = path("1/capture/images/03.png");
        let mut image = weaver_io::Image::read(&photo, weaver_io::Background::White).unwrap();
        image.pixels[5] = 1.0 - image.pixels[5];
        image.write_png(&photo).unwrap();
        let words = FIT.replace("capture", "/proc/self/cwd/capture");
        let script =
            format!("cd $OMPI_COMM_WORLD_RANK; exec \"$0\" {words} -o {} --threads 1", path("other").display());
        let mut command = Command::new("mpirun");
        command.args(["--oversubscribe", "--allow-run-as-root", "-n", "2", "sh", "-c", &script, BINARY]);
        let other = command.current_dir(folder.path()).output().unwrap();
        let text = said(&other);
        assert!(!other.status.success() && text.contains("process 1 of 2") && text.contains("03.png"), "{text}");
    }

    let mut begun = mpirun(folder.path(), 2, &format!("{FIT} -o full").replace("--steps 40", "--steps 4000"));
    let mut child = begun.spawn().unwrap();
    wait_for(&mut child, &path("full"), 2);
    while !path("full/checkpoint.safetensors").exists() {
        assert!(child.try_wait().unwrap().is_none(), "it ended before its first checkpoint");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    kill_one(&mut child);
    let before = std::fs::read(path("full/checkpoint.safetensors")).unwrap();
    let script = "ulimit -f 8; exec \"$0\" fit --resume full --save-every 0 --threads 1";
    let mut command = Command::new("mpirun");
    command.args(["--oversubscribe", "--allow-run-as-root", "-n", "2", "sh", "-c", script, BINARY]);
    let full = command.current_dir(folder.path()).output().unwrap();
    assert!(!full.status.success() && said(&full).contains("File too large"), "{}", said(&full));
    assert!(std::fs::read(path("full/checkpoint.safetensors")).unwrap() == before);
}
