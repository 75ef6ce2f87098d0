//! Commands as units of work, and lists of them.

use crate::capture;
use crate::in_process::{Outcome, line, splatweaver, with_slashes};
use std::path::Path;
use std::time::Duration;

const BINARY: &str = env!("CARGO_BIN_EXE_splatweaver");

fn scene(folder: &Path, out: &str) -> Vec<u8> {
    std::fs::read(folder.join(out).join("scene.ply")).unwrap()
}

/// A unit that is complete stays as it is, one that was killed goes on to the same bits, and one of other settings or
/// inputs is refused.
#[test]
fn a_unit_is_done_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    capture::colmap(&path("capture"), 6);
    let fit = |out: &str, steps: &str| {
        let (capture, out) = (path("capture"), path(out));
        line(&[&"fit", &capture, &"-o", &out, &"--steps", &steps, &"--gaussians 300 --no-html --if-complete skip"])
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

/// A list becomes one checked command a line.
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
    let planned = with_slashes(&planned.stdout);
    let lines: Vec<&str> = planned.lines().collect();
    assert_eq!(lines.len(), 2);
    let first = format!(
        "splatweaver fit '{}' -o 'scenes/a one' --if-complete skip --minutes 0.5",
        with_slashes(&path("captures/a one").display().to_string())
    );
    assert!(lines[0].starts_with(&first) && lines[0].contains("  # 0.5 min, "), "{}", lines[0]);
    assert!(
        lines[0].ends_with(" MB") && lines[1].contains(if cfg!(windows) { "-o 'scenes/b' " } else { "-o scenes/b " }),
        "{}",
        lines[1]
    );
    let steps = list("['--steps', '5', '--gaussians', '300', '--init', 'random']").fine();
    assert!(!steps.stdout.contains(" min, "), "{}", steps.stdout);
    let measured = splatweaver(&[&"plan", &path("list.toml"), &"--measure"]).fine();
    assert_eq!(measured.stdout.matches(" min, ").count(), 2, "{}", measured.stdout);
    list("['--step', '5']").refused(2, &["list.toml: work.0: unexpected argument '--step' found"]);
    std::fs::write(path("list.toml"), "[[work]]\ncommand = \"train\"\ninputs = []\nout = \"x\"\n").unwrap();
    splatweaver(&[&"plan", &path("list.toml")])
        .refused(2, &["work.0.command: expected reconstruct, fit, cameras or infer"]);
}

/// The words of a quick fit that is a unit of work.
fn quick(capture: &Path, out: &Path, more: &[&str]) -> Outcome {
    let words = ["--steps", "30", "--gaussians", "200", "--init", "random", "--no-html", "--if-complete", "skip"];
    let mut line: Vec<&dyn AsRef<std::ffi::OsStr>> = vec![&"fit", &capture, &"-o", &out];
    words.iter().chain(more).for_each(|word| line.push(word));
    splatweaver(&line)
}

/// A unit whose results are gone is not complete: they are made again, to the same bits. A checkpoint is no result.
///
/// Promise (files): a unit of work whose results are gone is made again, to the same bits; a checkpoint is no result;
/// marks of earlier versions stay valid.
#[test]
fn results_that_are_gone_are_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    capture::colmap(&path("capture"), 6);
    let fit = || quick(&path("capture"), &path("out"), &[]).fine().stderr;
    fit();
    let before = scene(folder.path(), "out");
    for gone in ["scene.ply", "transforms.json", "run.json", "sparse/0/images.bin"] {
        std::fs::remove_file(path("out").join(gone)).unwrap();
        let said = fit();
        assert!(said.contains(&format!("is made again: {gone} is gone")), "{said}");
        assert!(path("out").join(gone).exists() && scene(folder.path(), "out") == before, "{gone}");
        assert!(fit().contains("complete, nothing to do"), "{gone}");
    }
    std::fs::remove_file(path("out/checkpoint.safetensors")).unwrap();
    assert!(fit().contains("complete, nothing to do"));
    // A mark from before results were listed in it.
    let mark = std::fs::read_to_string(path("out/unit.json")).unwrap();
    let mut mark: serde_json::Value = serde_json::from_str(&mark).unwrap();
    mark.as_object_mut().unwrap().remove("files");
    std::fs::write(path("out/unit.json"), mark.to_string()).unwrap();
    assert!(fit().contains("complete, nothing to do"));
    std::fs::remove_file(path("out/scene.ply")).unwrap();
    assert!(fit().contains("is made again") && scene(folder.path(), "out") == before);
}

/// A unit that is complete prints the same JSON as when it was made.
///
/// Promise (files): a unit that is complete prints the same JSON as when it was made, also where it was made without
/// `--json`.
#[test]
fn complete_units_print_their_figures_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    capture::colmap(&path("capture"), 6);
    let fit = || quick(&path("capture"), &path("fit"), &["--json"]).fine();
    let made = fit();
    assert!(made.stdout.contains("\"psnr\""), "{}", made.stdout);
    let again = fit();
    assert!(again.stderr.contains("nothing to do") && again.stdout == made.stdout, "{}", again.stdout);
    let images = path("capture/images");
    let infer = |more: &[&str]| {
        let out = path("infer");
        let words = ["--cameras", "predicted", "--no-html", "--if-complete", "skip"];
        let mut line: Vec<&dyn AsRef<std::ffi::OsStr>> = vec![&"infer", &images, &"-o", &out];
        words.iter().chain(more).for_each(|word| line.push(word));
        splatweaver(&line).fine()
    };
    // Made without `--json`.
    infer(&[]);
    let again = infer(&["--json"]);
    let figures: serde_json::Value = serde_json::from_str(&again.stdout).unwrap();
    assert!(again.stderr.contains("nothing to do") && figures["gaussians"].as_u64().unwrap() > 0, "{figures}");
}

/// A fit that was made for other reasons is not taken for a unit's, and stays.
///
/// Promise (files): a fit that was no unit of work is not taken for one, and stays.
#[test]
fn a_unit_takes_no_other_fit_for_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    capture::colmap(&path("capture"), 6);
    let words = ["--steps", "4", "--gaussians", "200", "--init", "random", "--no-html"];
    let (capture, out) = (path("capture"), path("out"));
    let mut line: Vec<&dyn AsRef<std::ffi::OsStr>> = vec![&"fit", &capture, &"-o", &out];
    words.iter().for_each(|word| line.push(word));
    splatweaver(&line).fine();
    for _ in 0..2 {
        quick(&capture, &out, &[]).refused(2, &["a run exists there already"]);
    }
    assert!(!path("out/unit.json").exists());
}

/// Files of settings and of a start affect a unit's results, as the capture does.
///
/// Promise of `inputs_are_compared_by_their_files`.
#[test]
fn a_unit_is_of_all_that_it_reads() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    capture::colmap(&path("capture"), 6);
    let config = path("fit.toml");
    std::fs::write(&config, "sh_degree = 1\n").unwrap();
    let more = ["--config", config.to_str().unwrap()];
    quick(&path("capture"), &path("out"), &more).fine();
    assert!(quick(&path("capture"), &path("out"), &more).fine().stderr.contains("nothing to do"));
    std::fs::write(&config, "sh_degree = 0\n").unwrap();
    quick(&path("capture"), &path("out"), &more).refused(2, &["of other inputs or settings"]);
}

/// A name with a line break makes no line of its own in a list of commands, where a line is a unit of work.
///
/// Promise (files): names with line breaks make no commands of their own in `plan` and `split`.
#[cfg(unix)]
#[test]
fn names_with_line_breaks_make_no_commands() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let hostile = "a\ntouch PWNED #";
    for name in [hostile, "b", "c\u{1b}[2J"] {
        capture::transforms(&path("captures").join(name), 6);
    }
    let list = |inputs: &str| {
        let text = format!("[[work]]\ncommand = \"reconstruct\"\ninputs = [{inputs:?}]\nout = \"scenes\"\n");
        std::fs::write(path("list.toml"), text).unwrap();
        splatweaver(&[&"plan", &path("list.toml")])
    };
    let planned = list(&path("captures/*").display().to_string()).fine();
    assert_eq!(planned.stdout.lines().count(), 1, "{}", planned.stdout);
    assert!(planned.stdout.contains("captures/b "), "{}", planned.stdout);
    assert_eq!(planned.stderr.matches("left out: ").count(), 2, "{}", planned.stderr);
    assert!(planned.stderr.contains(r"a\ntouch PWNED") && !planned.stderr.contains('\u{1b}'), "{}", planned.stderr);
    let named = path("captures").join(hostile).display().to_string();
    list(&named).refused(2, &["work.0: expected words without line breaks", r"a\ntouch PWNED"]);
    splatweaver(&[&"split", &path("captures/b"), &"--blocks", &"2", &"-o", &path("x\ny")])
        .refused(2, &["--out: expected a name of UTF-8 without line breaks"]);
    assert!(!path("x\ny").exists());
}

/// A folder that `*` stands for and that is no capture is left out with a line.
///
/// Promise (files): a folder that `*` of a list stands for and that is no capture is left out with a line.
#[cfg(unix)]
#[test]
fn folders_that_are_no_captures_are_left_out() {
    use std::os::unix::ffi::OsStrExt;
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    capture::transforms(&path("captures/fine"), 6);
    std::fs::create_dir(path("captures/.thumbs")).unwrap();
    capture::transforms(&path("captures").join(std::ffi::OsStr::from_bytes(b"b\xff")), 6);
    for command in ["fit", "reconstruct", "cameras"] {
        let inputs = path("captures/*").display().to_string();
        let text = format!("[[work]]\ncommand = \"{command}\"\ninputs = [{inputs:?}]\nout = \"scenes\"\n");
        std::fs::write(path("list.toml"), text).unwrap();
        let planned = splatweaver(&[&"plan", &path("list.toml")]).fine();
        assert_eq!(planned.stdout.lines().count(), 1, "{command}: {}", planned.stdout);
        assert!(planned.stdout.contains("captures/fine -o scenes/fine"), "{command}: {}", planned.stdout);
        let said = planned.stderr;
        assert!(said.contains(".thumbs\": no capture") && said.contains("is no UTF-8"), "{command}: {said}");
    }
}
