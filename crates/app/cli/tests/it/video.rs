//! Videos by an ffmpeg that works, that is missing, and that fails. A script stands for ffmpeg in these tests.

#![cfg(unix)]

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output};
use weaver_scene::Gaussians;

/// Renders an orbit of three pictures in `folder`, where `bin` is all of the PATH.
fn render(folder: &Path, bin: &Path, more: &[&str]) -> Output {
    let splats = Gaussians {
        means: vec![[0.0; 3]],
        log_scales: vec![[-1.0; 3]],
        quats: vec![[1.0, 0.0, 0.0, 0.0]],
        opacity_logits: vec![8.0],
        sh: vec![1.7, -1.7, -1.7],
        degree: 0,
    };
    weaver_io::write_gaussians(folder.join("scene.ply"), &splats).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_splatweaver"));
    command.current_dir(folder).env("PATH", bin).args(["render", "scene.ply", "--orbit", "3"]).args(more);
    command.output().unwrap()
}

/// A folder with an ffmpeg that runs this script; `$out` is the file it is to write.
fn ffmpeg(script: &str) -> tempfile::TempDir {
    let bin = tempfile::tempdir().unwrap();
    let path = bin.path().join("ffmpeg");
    let text =
        format!("#!/bin/sh\nPATH=/usr/bin:/bin\nfor out in \"$@\"; do :; done\necho \"$@\" > arguments\n{script}\n");
    std::fs::write(&path, text).unwrap();
    std::fs::set_permissions(&path, PermissionsExt::from_mode(0o755)).unwrap();
    bin
}

/// Names of the files in the folder.
fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

const SIZE: [&str; 4] = ["--width", "16", "--height", "11"];

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn a_video_alone_or_with_pictures() {
    let (folder, bin) = (tempfile::tempdir().unwrap(), ffmpeg("cat > \"$out\""));
    let folder = folder.path();
    let more = ["--video", "turn.mp4", "--fps", "12.5", "-o", "turn"];
    let done = render(folder, bin.path(), &[&more[..], &SIZE].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    assert!(text(&done.stdout).contains("pictures: 3 of 1 Gaussians, in turn and turn.mp4"), "{}", text(&done.stdout));
    assert_eq!(names(folder), ["arguments", "scene.ply", "turn", "turn.mp4"]);
    let arguments = std::fs::read_to_string(folder.join("arguments")).unwrap();
    assert!(arguments.contains("-video_size 16x11 -framerate 12.5"), "{arguments}");
    // The very bytes of the pictures, in order.
    let picture = |i: usize| {
        let path = folder.join(format!("turn/000{i}.png"));
        weaver_io::Image::read(path, weaver_io::Background::Black).unwrap().to_bytes()
    };
    assert_eq!(std::fs::read(folder.join("turn.mp4")).unwrap(), (0..3).flat_map(picture).collect::<Vec<_>>());
    let before = std::fs::read(folder.join("turn.mp4")).unwrap();
    std::fs::remove_dir_all(folder.join("turn")).unwrap();
    let done = render(folder, bin.path(), &[&["--video", "turn.mp4"], &SIZE[..]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    assert_eq!(names(folder), ["arguments", "scene.ply", "turn.mp4"]);
    assert_eq!(std::fs::read(folder.join("turn.mp4")).unwrap(), before);
}

#[test]
fn without_ffmpeg_the_error_says_what_is_missing() {
    let (folder, bin) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let done = render(folder.path(), bin.path(), &["--video", "turn.mp4", "-o", "turn"]);
    assert_eq!(done.status.code(), Some(1));
    let stderr = text(&done.stderr);
    assert!(stderr.starts_with("error: --video needs the program ffmpeg") && stderr.lines().count() == 1, "{stderr}");
    assert_eq!(names(folder.path()), ["scene.ply"]);
}

/// An ffmpeg that fails at once, or after it read everything, is quoted, and an older video stays as it was.
#[test]
fn a_failure_leaves_the_old_video() {
    for script in ["echo no encoder >&2; exit 3", "cat > \"$out\"; echo no encoder >&2; exit 3"] {
        let (folder, bin) = (tempfile::tempdir().unwrap(), ffmpeg(script));
        let folder = folder.path();
        std::fs::write(folder.join("turn.mp4"), "old").unwrap();
        let done = render(folder, bin.path(), &[&["--video", "turn.mp4"], &SIZE[..]].concat());
        assert_eq!(done.status.code(), Some(1));
        let stderr = text(&done.stderr);
        assert!(stderr.contains("turn.mp4") && stderr.contains("no encoder") && stderr.contains('3'), "{stderr}");
        assert_eq!(std::fs::read_to_string(folder.join("turn.mp4")).unwrap(), "old");
        assert_eq!(names(folder), ["arguments", "scene.ply", "turn.mp4"]);
    }
}

#[test]
fn a_rate_needs_a_video_and_a_sensible_number() {
    let (folder, bin) = (tempfile::tempdir().unwrap(), ffmpeg("cat > \"$out\""));
    for more in [&["-o", "turn", "--fps", "5"][..], &["--video", "turn.mp4", "--fps", "0"], &[]] {
        assert_eq!(render(folder.path(), bin.path(), more).status.code(), Some(2), "{more:?}");
    }
}

/// A disk that is full while ffmpeg writes is reported as the machine's fault, also where ffmpeg reports another, and
/// an older video stays.
///
/// Promise of `an_encoder_does_not_hide_a_full_disk`.
#[test]
fn a_full_disk_is_told_from_other_failures() {
    let complaint = "cat > \"$out\"; echo 'Error writing trailer: No space left on device' >&2";
    for (script, code) in
        [(format!("{complaint}; exit 228"), 75), (format!("{complaint}; exit 0"), 75), ("exit 228".into(), 1)]
    {
        let (folder, bin) = (tempfile::tempdir().unwrap(), ffmpeg(&script));
        std::fs::write(folder.path().join("turn.mp4"), "old").unwrap();
        let done = render(folder.path(), bin.path(), &[&["--video", "turn.mp4"], &SIZE[..]].concat());
        let stderr = text(&done.stderr);
        assert!(done.status.code() == Some(code) && stderr.starts_with("error: turn.mp4: ffmpeg: "), "{stderr}");
        assert_eq!(std::fs::read_to_string(folder.path().join("turn.mp4")).unwrap(), "old");
        assert!(!names(folder.path()).iter().any(|name| name.starts_with('.')), "{:?}", names(folder.path()));
    }
}
