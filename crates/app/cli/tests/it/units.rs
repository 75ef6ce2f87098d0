//! Commands as units of work, and lists of them.

use crate::capture;
use crate::in_process::splatweaver;
use std::path::Path;
use std::time::Duration;

const BINARY: &str = env!("CARGO_BIN_EXE_splatweaver");

fn scene(folder: &Path, out: &str) -> Vec<u8> {
    std::fs::read(folder.join(out).join("scene.ply")).unwrap()
}

/// A unit that is complete stays as it is, one that was killed goes on to the same bits, and one of other settings or inputs is refused.
#[test]
fn a_unit_is_done_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    capture::colmap(&path("capture"), 6);
    let fit = |out: &str, steps: &str| {
        let (capture, out) = (path("capture"), path(out));
        splatweaver(&[
            &"fit",
            &capture,
            &"-o",
            &out,
            &"--steps",
            &steps,
            &"--gaussians",
            &"300",
            &"--no-html",
            &"--if-complete",
            &"skip",
        ])
    };
    fit("whole", "400").fine();
    let before = std::fs::metadata(path("whole/scene.ply")).unwrap().modified().unwrap();
    let again = fit("whole", "400").fine();
    assert!(again.stderr.contains("complete, nothing to do"), "{}", again.stderr);
    assert_eq!(std::fs::metadata(path("whole/scene.ply")).unwrap().modified().unwrap(), before);
    fit("whole", "401").refused(2, &["unit.json: expected the unit of work", "of other inputs or settings"]);

    let words = format!(
        "fit {} -o {} --steps 400 --gaussians 300 --no-html --save-every 0 --if-complete skip",
        path("capture").display(),
        path("parts").display()
    );
    let mut child =
        std::process::Command::new(BINARY).args(words.split(' ')).stderr(std::process::Stdio::null()).spawn();
    let child = child.as_mut().unwrap();
    while !path("parts/checkpoint.safetensors").exists() {
        std::thread::sleep(Duration::from_millis(2));
    }
    let _ = child.kill();
    child.wait().unwrap();
    fit("parts", "400").fine();
    assert!(scene(folder.path(), "parts") == scene(folder.path(), "whole"));
    assert!(fit("parts", "400").fine().stderr.contains("nothing to do"));

    let photo = path("capture/images/03.png");
    let mut image = weaver_io::Image::read(&photo, weaver_io::Background::White).unwrap();
    image.pixels[5] = 1.0 - image.pixels[5];
    image.write_png(&photo).unwrap();
    fit("whole", "400").refused(2, &["of other inputs or settings"]);
}

/// A list becomes one command a line, each of which was checked.
#[test]
fn a_list_becomes_a_command_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for name in ["a one", "b"] {
        capture::transforms(&path("captures").join(name), 6);
    }
    let list = |flags: &str| {
        let work = format!(
            "[[work]]\ncommand = \"fit\"\ninputs = ['{}']\nout = \"scenes\"\nflags = {flags}\n",
            path("captures/*").display()
        );
        std::fs::write(path("list.toml"), work).unwrap();
        splatweaver(&[&"plan", &path("list.toml")])
    };
    let planned = list("['--minutes', '0.5', '--gaussians', '1000']").fine();
    let lines: Vec<&str> = planned.stdout.lines().collect();
    assert_eq!(lines.len(), 2);
    let first = format!(
        "splatweaver fit '{}' -o 'scenes/a one' --if-complete skip --minutes 0.5",
        path("captures/a one").display()
    );
    assert!(lines[0].starts_with(&first) && lines[0].contains("  # 0.5 min, "), "{}", lines[0]);
    assert!(lines[0].ends_with(" MB") && lines[1].contains("-o scenes/b "), "{}", lines[1]);
    let steps = list("['--steps', '5', '--gaussians', '300', '--init', 'random']").fine();
    assert!(!steps.stdout.contains(" min, "), "{}", steps.stdout);
    let measured = splatweaver(&[&"plan", &path("list.toml"), &"--measure"]).fine();
    assert_eq!(measured.stdout.matches(" min, ").count(), 2, "{}", measured.stdout);
    list("['--step', '5']").refused(2, &["list.toml: work.0: unexpected argument '--step' found"]);
    std::fs::write(path("list.toml"), "[[work]]\ncommand = \"train\"\ninputs = []\nout = \"x\"\n").unwrap();
    splatweaver(&[&"plan", &path("list.toml")])
        .refused(2, &["work.0.command: expected reconstruct, fit, cameras or infer"]);
}
