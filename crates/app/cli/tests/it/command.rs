//! The binary as a user calls it: a line of arguments in a folder.

use crate::in_process::with_slashes;
use std::path::Path;
use std::process::{Command, Output};
use weaver_io::Transforms;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::Frame;

pub const BINARY: &str = env!("CARGO_BIN_EXE_splatweaver");

pub fn splatweaver(folder: &Path, line: &str) -> Output {
    Command::new(BINARY).current_dir(folder).args(line.split_whitespace()).output().unwrap()
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs a command that succeeds and returns its output.
pub fn printed(folder: &Path, line: &str) -> String {
    let done = splatweaver(folder, line);
    assert!(done.status.success(), "{line}: {}", text(&done.stderr));
    text(&done.stdout)
}

/// The message of a command that fails with this exit code.
pub fn refused(folder: &Path, line: &str, code: i32) -> String {
    let done = splatweaver(folder, line);
    assert_eq!(done.status.code(), Some(code), "{line}: {}", text(&done.stdout));
    with_slashes(&text(&done.stderr))
}

/// Writes a small capture to `capture/`.
pub fn capture(folder: &Path) {
    let scene = scene(3, &ProceduralOptions { width: 40, height: 32, views: 10 });
    let images = folder.join("capture/images");
    std::fs::create_dir_all(&images).unwrap();
    let frame = |(i, view): (usize, &weaver_data::View)| {
        view.image.write_png(images.join(format!("{i:02}.png"))).unwrap();
        Frame::new(format!("images/{i:02}.png"), view.camera)
    };
    let frames = scene.views.iter().enumerate().map(frame).collect();
    Transforms { frames, ..Transforms::default() }.write(folder.join("capture/transforms.json")).unwrap();
}
