//! Commands that the program prints for pasting.

#![cfg(unix)]

use crate::capture;
use crate::in_process::Outcome;
use std::path::Path;
use std::process::Command;
use weaver_cli::{Console, Interrupt};

const BINARY: &str = env!("CARGO_BIN_EXE_splatweaver");
/// A folder whose name shells take apart.
const NAME: &str = "sp ace/it's $(mine)";

/// Runs a command that is stopped as soon as it can be.
fn stopped(words: &[&str]) -> Outcome {
    let interrupt = Interrupt::new();
    interrupt.watch();
    interrupt.request();
    let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
    let mut console = Console::new(&mut stdout, &mut stderr, false);
    let line = std::iter::once(&"splatweaver").chain(words).map(Into::into);
    let code = weaver_cli::run(line, &mut console, &interrupt);
    let text = |bytes| String::from_utf8(bytes).unwrap();
    Outcome { code, stdout: text(stdout), stderr: text(stderr) }
}

/// The command that something printed names to go on with.
fn to_go_on(done: &Outcome) -> String {
    let said = format!("{}{}", done.stderr, done.stdout);
    let (_, command) = said.split_once("to go on: ").unwrap_or_else(|| panic!("{said}"));
    command.lines().next().unwrap().to_string()
}

/// Runs a line by a shell that finds the program.
fn pasted(line: &str) -> String {
    let folder = Path::new(BINARY).parent().unwrap().display();
    let path = format!("{folder}:{}", std::env::var("PATH").unwrap_or_default());
    let done = Command::new("sh").args(["-c", line]).env("PATH", path).output().unwrap();
    assert!(done.status.success(), "{line}: {}", String::from_utf8_lossy(&done.stderr));
    String::from_utf8_lossy(&done.stderr).into_owned()
}

/// A command to go on with does so when it is pasted into a shell, also with a folder name that shells take apart.
///
/// Promise (files): a command to go on with does so when it is pasted; none is printed without quotes.
#[test]
fn commands_to_go_on_can_be_pasted() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    capture::transforms(&folder.path().join("capture"), 6);
    let (capture, images) = (path("capture"), path("capture/images"));
    let place = |kind: &str| path(&format!("{NAME}/{kind}"));
    let fit = ["--steps", "3", "--gaussians", "100", "--init", "random", "--no-html"];
    let runs: [(&str, Vec<&str>); 5] = [
        ("fit", [&["fit", &capture][..], &fit].concat()),
        ("image", vec!["image", "fit", &images, "--gaussians", "20", "--steps", "2"]),
        ("vad", vec!["vad", "train", "--steps", "3"]),
        ("film", vec!["dynamic", "train", "--shots", "2x4", "--long-side", "16", "--gaussians", "40", "--steps", "2"]),
        ("net", vec!["train", "--preset", "micro", "--steps", "2"]),
    ];
    for (kind, words) in runs {
        let out = place(kind);
        let done = stopped(&[&words[..], &["--out", &out]].concat());
        assert_eq!(done.code, 0, "{kind}: {}", done.stderr);
        let command = to_go_on(&done);
        assert!(command.starts_with("splatweaver ") && command.contains(r"sp ace/it'\''s $(mine)"), "{command}");
        if kind == "fit" {
            pasted(&command);
            assert!(Path::new(&out).join("summary.json").exists());
        }
    }
    // A reconstruction that finds a fit which was begun.
    let begun = stopped(&[&["fit", &capture][..], &fit, &["--out", &place("begun")]].concat());
    assert_eq!(begun.code, 0, "{}", begun.stderr);
    let again = stopped(&["reconstruct", &capture, "-o", &place("begun"), "--minutes", "0.05"]);
    assert_eq!((again.code, to_go_on(&again)), (2, to_go_on(&begun)));
}
