//! Folders of pictures: results, and going on to the same bits.

use crate::command::{refused, told, told_by, wave};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use weaver_command::Interrupt;

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("in")).unwrap();
    for (name, size, phase) in [("a", 60, 0.0), ("b", 44, 1.0), ("c", 52, 2.0)] {
        wave(size, 40, phase).write_png(folder.path().join(format!("in/{name}.png"))).unwrap();
    }
    folder
}

fn bytes(folder: &Path, name: &str) -> Vec<u8> {
    std::fs::read(folder.join(name)).unwrap()
}

#[test]
fn a_folder_of_pictures_becomes_a_folder_of_files() {
    let folder = folder();
    let here = folder.path();
    let line = told(here, "fit @in -o @out --gaussians 30 --steps 40");
    assert!(line.contains("3 pictures, "), "{line}");
    for name in ["a", "b", "c"] {
        let out = here.join(format!("{name}.wgi")).display().to_string();
        told(here, &format!("fit @in/{name}.png -o {out} --gaussians 30 --steps 40"));
        assert_eq!(bytes(here, &format!("out/{name}.wgi")), bytes(here, &format!("{name}.wgi")));
    }
    let page = String::from_utf8(bytes(here, "out/report.html")).unwrap();
    assert!(page.contains(">b</h2>") && page.contains("MS-SSIM"));
    let summary = String::from_utf8(bytes(here, "out/summary.json")).unwrap();
    assert_eq!(summary.matches("\"psnr\"").count(), 3);
    assert!(!here.join("out/checkpoint.safetensors").exists());
    refused(here, "fit @in -o @out", "a run exists there already");
    refused(here, "fit --resume @out", "the run is complete");
}

#[test]
fn a_stopped_run_goes_on_to_the_same_bits() {
    let folder = folder();
    let here = folder.path();
    told(here, "fit @in -o @whole --gaussians 30 --steps 300");
    let mut words = "fit @in -o @parts --gaussians 30 --steps 300";
    let mut stops = 0;
    // Interrupted before the first step, and then at later ones.
    loop {
        let interrupt = Arc::new(Interrupt::new());
        interrupt.watch();
        let other = interrupt.clone();
        let pause = Duration::from_millis(if stops == 0 { 0 } else { 60 });
        let thread = std::thread::spawn(move || {
            std::thread::sleep(pause);
            other.request();
        });
        if stops == 0 {
            interrupt.request();
        }
        let line = told_by(here, words, &interrupt).unwrap();
        thread.join().unwrap();
        if !line.contains("to go on: splatweaver image fit --resume ") {
            break;
        }
        (words, stops) = ("fit --resume @parts", stops + 1);
    }
    println!("stopped {stops} times");
    for name in ["a.wgi", "b.wgi", "c.wgi"] {
        assert_eq!(bytes(here, &format!("parts/{name}")), bytes(here, &format!("whole/{name}")));
    }
}

#[test]
fn a_picture_that_changed_is_not_gone_on_with() {
    let folder = folder();
    let here = folder.path();
    let interrupt = Interrupt::new();
    interrupt.watch();
    interrupt.request();
    told_by(here, "fit @in -o @out --gaussians 30 --steps 40", &interrupt).unwrap();
    wave(60, 40, 0.5).write_png(here.join("in/a.png")).unwrap();
    refused(here, "fit --resume @out", "expected the picture that the run began with, found another");
}

#[test]
fn what_makes_no_run_is_refused() {
    let folder = folder();
    let here = folder.path();
    std::fs::create_dir(here.join("empty")).unwrap();
    refused(here, "fit @empty -o @out", "expected pictures, found none");
    refused(here, "fit @in -o @out --bytes 500", "expected one picture and a file to write");
    std::fs::copy(here.join("in/a.png"), here.join("a.png")).unwrap();
    refused(here, "fit @in @a.png -o @out", "expected a name of its own");
    std::fs::copy(here.join("in/a.png"), here.join("A.png")).unwrap();
    refused(here, "fit @in @A.png -o @out", "expected a name of its own");
    refused(here, "fit --resume @in", "in/run.json");
    refused(here, "fit --resume @out --steps 3", "cannot be used with");
}

/// A stopped fit of one file keeps the existing file, says that it ended early, and does not blame the picture.
///
/// Promise (files): a stopped fit of one picture keeps the existing file, reports that it ended early, and does not
/// blame the picture.
#[test]
fn a_stopped_fit_keeps_the_finished_file() {
    let folder = folder();
    let here = folder.path();
    told(here, "fit @in/a.png -o @a.wgi --gaussians 30 --steps 40");
    let before = bytes(here, "a.wgi");
    let stopped = Interrupt::new();
    stopped.watch();
    stopped.request();
    for goal in ["--gaussians 900", "--bytes 1000", "--psnr 20"] {
        let words = format!("fit @in/a.png -o @a.wgi --steps 4000 {goal}");
        let failure = told_by(here, &words, &stopped).unwrap_err();
        let line = failure.line().unwrap();
        assert!(line.contains("stopped at step 1 of 4000") && failure.exit_code() == 1, "{goal}: {line}");
        assert_eq!(bytes(here, "a.wgi"), before, "{goal}");
    }
    let line = told_by(here, "fit @in/a.png -o @b.wgi --gaussians 900 --steps 4000", &stopped).unwrap();
    assert!(line.contains("stopped at step 1 of 4000, the fit so far is written"), "{line}");
    assert!(!line.contains("there is no more to show") && here.join("b.wgi").exists(), "{line}");
    let words = "fit @in/a.png -o @c.wgi --psnr 90 --steps 4000";
    let line = told_by(here, words, &stopped).unwrap_err().line().unwrap();
    assert!(line.contains("stopped at step 1") && !here.join("c.wgi").exists(), "{line}");
    // A stop in the last step is a normal end.
    told_by(here, "fit @in/a.png -o @a.wgi --gaussians 30 --steps 1", &stopped).unwrap();
    assert_ne!(bytes(here, "a.wgi"), before);
}

/// A .wgi file is described by its size and its Gaussians.
///
/// Promise of `runs_of_every_command_are_described`.
#[test]
fn a_file_is_described() {
    let folder = folder();
    let here = folder.path();
    told(here, "fit @in/a.png -o @a.wgi --gaussians 30 --steps 4");
    let text = weaver_image::command::info(&here.join("a.wgi")).unwrap();
    assert!(text.starts_with("picture of 60x40 pixels, 30 Gaussians, "), "{text}");
    assert!(weaver_image::command::info(&here.join("in/a.png")).is_err());
}
