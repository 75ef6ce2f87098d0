//! Clips in place of photos: the choice of frames, and the messages where there are none.

#![cfg(unix)]

use std::fs;
use std::io::{Read, Write};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use weaver_io::{PhotoFile, Transforms};
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::Frame;

const BINARY: &str = env!("CARGO_BIN_EXE_splatweaver");
const SIZE: (usize, usize) = (192, 144);
/// Flags with which matching takes hardly any time.
const QUICK: &str = "--focal 0.87 --match-size 64";

/// True if an ffmpeg is installed; says so where there is none.
fn has_ffmpeg(test: &str) -> bool {
    let found = Command::new("ffmpeg").arg("-version").output().is_ok();
    if !found {
        println!("skipped: no ffmpeg ({test})");
    }
    found
}

fn run(folder: &Path, line: &str) -> Output {
    Command::new(BINARY).current_dir(folder).args(line.split(' ')).output().unwrap()
}

fn said(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

/// Runs the installed ffmpeg on `input`, with the arguments of `line`.
fn ffmpeg(folder: &Path, line: &str, input: &[u8]) {
    let mut command = Command::new("ffmpeg");
    command.current_dir(folder).args(["-loglevel", "error", "-y"]).args(line.split(' '));
    let mut child = command.stdin(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(input).unwrap();
    assert!(child.wait().unwrap().success(), "ffmpeg {line}");
}

/// Encodes `views` views of a built-in scene, in order, as `clip.mp4`, and writes the true cameras of all frames to
/// `truth/transforms.json`.
fn clip(folder: &Path, views: usize) {
    let (width, height) = SIZE;
    let scene = scene(3, &ProceduralOptions { width, height, views });
    let pictures: Vec<u8> = scene.views.iter().flat_map(|view| view.image.to_bytes()).collect();
    let coded = "-c:v mpeg4 -q:v 2 clip.mp4";
    ffmpeg(
        folder,
        &format!("-f rawvideo -pixel_format rgb24 -video_size {width}x{height} -i pipe:0 {coded}"),
        &pictures,
    );
    fs::create_dir_all(folder.join("truth")).unwrap();
    let frame = |(i, view): (usize, &weaver_data::View)| Frame::new(format!("frames/{i:06}.jpg"), view.camera);
    let frames = scene.views.iter().enumerate().map(frame).collect();
    Transforms { frames, ..Transforms::default() }.write(folder.join("truth/transforms.json")).unwrap();
}

/// The names of the files in a folder.
fn names(folder: impl AsRef<Path>) -> Vec<String> {
    let names = fs::read_dir(folder.as_ref()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

/// Promise (photos): a clip becomes a capture, in every command whose cameras are estimated, beside other clips and
/// photos; another choice of frames takes the place of the first.
#[test]
fn a_clip_becomes_a_capture() {
    if !has_ffmpeg("a_clip_becomes_a_capture") {
        return;
    }
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    clip(folder, 20);
    let output = run(folder, "cameras clip.mp4 -o found --frames 10 --compare truth/transforms.json");
    let text = said(&output);
    assert!(output.status.success() && text.contains("clip: 10 of 20 frames of clip.mp4"), "{text}");
    assert!(text.contains("10 of 10 photos placed"), "{text}");
    let degrees: f64 = text.split("rotation ").nth(1).and_then(|t| t.split(' ').next()).unwrap().parse().unwrap();
    assert!(degrees < 1.5, "{text}");
    let frames = names(folder.join("found/frames"));
    assert!(frames.len() == 10 && frames.iter().all(|name| name.len() == "000000.jpg".len()), "{frames:?}");
    let capture = weaver_data::posed::load(folder.join("found"), &Default::default()).unwrap();
    assert_eq!(capture.photos.len(), 10);
    assert_eq!(PhotoFile::at(folder.join("found/frames").join(&frames[3])).unwrap().size(), SIZE);

    // Another choice takes the place of the first, and foreign files stay.
    fs::write(folder.join("found/frames/mine.txt"), "mine").unwrap();
    let output = run(folder, "cameras clip.mp4 -o found --frames 6");
    assert!(output.status.success(), "{}", said(&output));
    assert_eq!(names(folder.join("found/frames")).len(), 7, "{:?}", names(folder.join("found/frames")));
    let written = Transforms::read(folder.join("found/transforms.json")).unwrap().frames;
    assert!(written.iter().all(|frame| folder.join("found").join(&frame.name).is_file()), "{written:?}");
    fs::remove_dir_all(folder.join("found/frames")).unwrap();
    fs::create_dir(folder.join("found/frames")).unwrap();
    let foreign: Vec<_> = (0..20).map(|i| folder.join(format!("other/frames/{i:06}.jpg"))).collect();
    fs::create_dir_all(folder.join("other/frames")).unwrap();
    foreign.iter().for_each(|path| fs::write(path, "mine").unwrap());
    let refused = run(folder, "cameras clip.mp4 -o other");
    assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
    assert!(foreign.iter().all(|path| fs::read(path).unwrap() == b"mine"));
}

/// Earlier cameras keep their frames until there are new ones.
#[test]
fn earlier_cameras_keep_their_frames() {
    if !has_ffmpeg("earlier_cameras_keep_their_frames") {
        return;
    }
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    clip(folder, 12);
    let output = run(folder, "cameras clip.mp4 -o found --frames 8");
    assert!(output.status.success(), "{}", said(&output));
    let frames = || -> Vec<(String, Vec<u8>)> {
        let transforms = Transforms::read(folder.join("found/transforms.json")).unwrap();
        let bytes = |name: &str| fs::read(folder.join("found").join(name)).unwrap();
        transforms.frames.into_iter().map(|frame| (frame.name.clone(), bytes(&frame.name))).collect()
    };
    let before = frames();
    // Another clip of that name, in which nothing is found again, and frames of the same numbers.
    fs::rename(folder.join("clip.mp4"), folder.join("first.mp4")).unwrap();
    let (width, height) = SIZE;
    let mut state = 1_u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    let pictures: Vec<u8> = (0..6 * 3 * width * height).map(|_| noise()).collect();
    let raw = format!("-f rawvideo -pixel_format rgb24 -video_size {width}x{height} -i pipe:0");
    ffmpeg(folder, &format!("{raw} -c:v mpeg4 -q:v 2 clip.mp4"), &pictures);
    let failed = run(folder, "cameras clip.mp4 -o found --frames 6");
    assert!(failed.status.code() == Some(1) && said(&failed).contains("matching "), "{}", said(&failed));
    let left = names(folder.join("found/frames"));
    assert!(left.iter().any(|name| name.ends_with("-2.jpg")), "{left:?}");
    assert_eq!(frames(), before, "what is left of the first clip's cameras");
    // Frames of an estimate that succeeds take their place.
    let output = run(folder, "cameras first.mp4 -o found --frames 4");
    assert!(output.status.success(), "{}", said(&output));
    let left = names(folder.join("found/frames"));
    assert_eq!(left.len(), 4, "{left:?}");
    assert!(frames().iter().all(|(name, _)| name.starts_with("frames/")));
}

/// Every command whose cameras are estimated takes a clip.
///
/// Promise of `a_clip_becomes_a_capture`.
#[test]
fn every_estimating_command_takes_a_clip() {
    if !has_ffmpeg("every_estimating_command_takes_a_clip") {
        return;
    }
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    clip(folder, 7);
    for line in [
        "reconstruct clip.mp4 -o scene --minutes 0.05 --gaussians 300 --hold-out listed --frames 6",
        "fit clip.mp4 --cameras estimated --steps 5 --gaussians 300 -o fitted",
        "infer clip.mp4 -o inferred",
    ] {
        let output = run(folder, line);
        assert!(output.status.success(), "{line}: {}", said(&output));
        let out = folder.join(line.split("-o ").nth(1).unwrap().split(' ').next().unwrap());
        assert!(out.join("scene.ply").is_file() && out.join("cameras/points.png").is_file(), "{line}");
        assert!(names(out.join("frames")).len() >= 4, "{line}: {:?}", names(out.join("frames")));
    }
    // With another clip, and with photos.
    fs::copy(folder.join("clip.mp4"), folder.join("again.mov")).unwrap();
    fs::copy(folder.join("scene/frames").join(&names(folder.join("scene/frames"))[2]), folder.join("a.jpg")).unwrap();
    let output = run(folder, &format!("cameras clip.mp4 a.jpg again.mov -o both --frames 3 {QUICK}"));
    assert!(said(&output).contains("matching 7 photos"), "{}", said(&output));
    assert_eq!((names(folder.join("both/frames/1")).len(), names(folder.join("both/frames/2")).len()), (3, 3));
}

/// Promise (photos): frames are upright, with square pixels, and those that were chosen, whatever the rate.
#[test]
fn frames_are_as_a_player_shows_them() {
    if !has_ffmpeg("frames_are_as_a_player_shows_them") {
        return;
    }
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    clip(folder, 8);
    let [plain, turned, wide] = [SIZE, (SIZE.1, SIZE.0), (2 * SIZE.0, SIZE.1)];
    ffmpeg(folder, "-i clip.mp4 -c:v mpeg4 -q:v 2 -vf setsar=2 wide.mp4", &[]);
    ffmpeg(folder, "-i clip.mp4 -c copy -metadata:s:v rotate=90 turned.mp4", &[]);
    // Times that are far from even: a second after every third frame.
    ffmpeg(folder, "-i clip.mp4 -c:v mpeg4 -q:v 2 -vf setpts=N/25/TB+floor(N/3)/TB -vsync vfr uneven.mkv", &[]);
    for (name, size) in [("clip.mp4", plain), ("wide.mp4", wide), ("turned.mp4", turned), ("uneven.mkv", plain)] {
        // Whether cameras are found of so little does not matter here.
        let output = run(folder, &format!("cameras {name} -o out-{name} --frames 99 {QUICK}"));
        assert!(said(&output).contains(&format!("clip: 8 of 8 frames of {name}")), "{name}: {}", said(&output));
        let frame = folder.join(format!("out-{name}/frames/000005.jpg"));
        let found = PhotoFile::at(&frame).unwrap().size();
        if name == "turned.mp4" && found == plain {
            println!("skipped: no ffmpeg that writes rotations ({name})");
            continue;
        }
        assert_eq!(found, size, "{name}");
        // The frame of that number, and no neighbor.
        let small = |path: &Path| PhotoFile::at(path).unwrap().resize_whole(24, 18).unwrap().pixels;
        let seen = small(&frame);
        let off = |number: usize| -> u32 {
            let beside = small(&folder.join(format!("out-clip.mp4/frames/{number:06}.jpg")));
            beside.iter().zip(&seen).map(|(a, b)| u32::from(a.abs_diff(*b))).sum()
        };
        if size != turned {
            assert!((0..8).all(|number| number == 5 || off(number) > 2 * off(5)), "{name}: {:?}", [4, 5, 6].map(off));
        }
    }
}

/// Promise (photos): clips without a moving camera (one frame, standing still, sound alone, cut off, no clip, a list
/// of others) are refused with the reason, and leave nothing behind.
#[test]
fn what_is_no_clip_of_a_moving_camera_is_refused() {
    if !has_ffmpeg("what_is_no_clip_of_a_moving_camera_is_refused") {
        return;
    }
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    clip(folder, 8);
    ffmpeg(folder, "-i clip.mp4 -c copy -frames:v 1 one.mp4", &[]);
    ffmpeg(folder, "-i clip.mp4 -vf select=eq(n\\,0),loop=40:1 -c:v mpeg4 still.mp4", &[]);
    ffmpeg(folder, "-f lavfi -i sine=d=1 sound.mp4", &[]);
    let whole = fs::read(folder.join("clip.mp4")).unwrap();
    fs::write(folder.join("cut.mp4"), &whole[..whole.len() / 2]).unwrap();
    fs::write(folder.join("text.mp4"), "This is no clip at all.").unwrap();
    fs::write(folder.join("list.mp4"), "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\nhttp://localhost/a.ts\n")
        .unwrap();
    for (name, found) in [
        ("one.mp4", "found a single picture"),
        ("still.mp4", "found one that stands still"),
        ("sound.mp4", "found no pictures in it; ffmpeg: "),
        ("cut.mp4", "moov atom not found"),
        ("text.mp4", "found another file; ffmpeg: "),
        ("list.mp4", "found a list of other files"),
    ] {
        for command in ["cameras", "reconstruct"] {
            let output = run(folder, &format!("{command} {name} -o out"));
            let text = said(&output);
            assert_eq!(output.status.code(), Some(1), "{command} {name}: {text}");
            let error = text.lines().last().unwrap();
            assert!(
                error.starts_with(&format!("error: {name}: ")) && error.contains(found),
                "{command} {name}: {text}"
            );
            assert!(!folder.join("out").exists(), "{command} {name} left something behind");
        }
    }
    // The remainder of a clip that was cut off is taken, with a warning.
    ffmpeg(folder, "-i clip.mp4 -c copy whole.mkv", &[]);
    let whole = fs::read(folder.join("whole.mkv")).unwrap();
    fs::write(folder.join("cut.mkv"), &whole[..whole.len() * 6 / 10]).unwrap();
    let text = said(&run(folder, &format!("cameras cut.mkv -o out --frames 3 {QUICK}")));
    assert!(text.contains("warning: cut.mkv: ffmpeg: ") && text.contains("frames of cut.mkv"), "{text}");
}

/// Promise (photos): names of clips may be anything.
#[test]
fn names_of_clips_may_be_anything() {
    if !has_ffmpeg("names_of_clips_may_be_anything") {
        return;
    }
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    clip(folder, 6);
    let odd = [&b"-a b.mp4"[..], b"http:c%03d.mp4", b"without an extension", b"b\xff.MP4"];
    for (number, name) in odd.into_iter().map(std::ffi::OsStr::from_bytes).enumerate() {
        if fs::copy(folder.join("clip.mp4"), folder.join(name)).is_err() {
            println!("skipped: no names that are not UTF-8");
            continue;
        }
        let mut command = Command::new(BINARY);
        let flags = format!("cameras --frames 2 {QUICK} -o out{number} --");
        command.current_dir(folder).args(flags.split(' ')).arg(name);
        let text = said(&command.output().unwrap());
        assert!(text.contains("matching 2 photos"), "{name:?}: {text}");
    }
}

/// Promise of `what_is_no_clip_of_a_moving_camera_is_refused`.
/// Promise (photos): a missing ffmpeg gets the command that installs it, a failing one is quoted, and Ctrl-C ends it.
#[test]
fn what_does_not_fit_is_refused_before_any_work() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    fs::write(folder.join("clip.mp4"), "").unwrap();
    fs::write(folder.join("a.jpg"), "").unwrap();
    for (line, code, message) in [
        ("cameras clip.mp4 -o out", 1, "clip.mp4: expected a clip of a camera that moves, found an empty file"),
        ("cameras nothing.mp4 -o out", 1, "nothing.mp4: No such file"),
        ("cameras clip.mp4 -o out --frames 1", 2, "--frames"),
        ("cameras nowhere -o out", 1, "nowhere: no such file or folder"),
        ("cameras a.jpg -o out --frames 9", 2, "--frames: expected a clip, found photos"),
        ("reconstruct a.jpg -o out --frames 9", 2, "--frames: expected a clip, found photos"),
        ("cameras clip.mp4 -o clip.mp4", 2, "expected a place apart from what is read"),
        ("reconstruct clip.mp4 -o clip.mp4/x", 2, "expected a place apart from what is read"),
    ] {
        let output = run(folder, line);
        assert_eq!(output.status.code(), Some(code), "{line}: {}", said(&output));
        assert!(said(&output).contains(message), "{line}: {}", said(&output));
        assert_eq!(names(folder), ["a.jpg", "clip.mp4"], "{line}");
    }
    // No program is there.
    fs::write(folder.join("clip.mp4"), "something").unwrap();
    for command in ["cameras", "reconstruct"] {
        let mut line = Command::new(BINARY);
        let output =
            line.current_dir(folder).env("PATH", folder).args([command, "clip.mp4", "-o", "out"]).output().unwrap();
        let text = said(&output);
        assert!(output.status.code() == Some(1) && text.lines().count() == 1, "{text}");
        assert!(
            text.contains("clip.mp4: reading a clip needs the program ffmpeg") && text.contains("to install it"),
            "{text}"
        );
        assert_eq!(names(folder), ["a.jpg", "clip.mp4"], "{command}");
    }
}

/// A folder with a clip and an `ffmpeg` that runs this script.
fn scripted(script: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("clip.mp4"), "a clip").unwrap();
    fs::create_dir(folder.path().join("bin")).unwrap();
    let program = folder.path().join("bin/ffmpeg");
    fs::write(&program, format!("#!/bin/sh\nPATH=/usr/bin:/bin\n{script}\n")).unwrap();
    fs::set_permissions(program, PermissionsExt::from_mode(0o755)).unwrap();
    folder
}

/// The binary where `bin` is all of the PATH.
fn with_script(folder: &Path) -> Command {
    let mut command = Command::new(BINARY);
    command.current_dir(folder).env("PATH", folder.join("bin")).args(["cameras", "clip.mp4", "-o", "out"]);
    command
}

/// Promise of `what_does_not_fit_is_refused_before_any_work`.
#[test]
fn a_decoder_that_fails_is_quoted() {
    for (script, message) in [
        ("echo broken header >&2; exit 3", "ffmpeg: exit status: 3; broken header"),
        ("printf 'P5\\n1 1\\n255\\na'; echo lost its way >&2; exit 4", "ffmpeg: exit status: 4; lost its way"),
        ("echo something else", "expected pictures in the formats PGM and PPM"),
        ("yes oh no | head -n 100000 >&2; exit 5", "exit status: 5; oh no; oh no; oh no; oh no; ..."),
    ] {
        let folder = scripted(script);
        let output = with_script(folder.path()).output().unwrap();
        let text = said(&output);
        assert!(output.status.code() == Some(1) && text.lines().count() == 1, "{script}: {text}");
        assert!(text.starts_with("error: clip.mp4: ") && text.contains(message), "{script}: {text}");
        assert!(!folder.path().join("out").exists(), "{script}");
    }
}

/// Promise of `what_does_not_fit_is_refused_before_any_work`.
#[test]
fn ctrl_c_ends_the_decoder_too() {
    // Neither reads nor writes, so that no broken pipe ends it.
    let folder = scripted("case \"$*\" in *pipe:1*) echo $$ > id; exec sleep 100;; esac");
    let mut child = with_script(folder.path()).stderr(Stdio::piped()).spawn().unwrap();
    let id = loop {
        match fs::read_to_string(folder.path().join("id")) {
            Ok(id) if id.ends_with('\n') => break id.trim().to_string(),
            _ => std::thread::sleep(Duration::from_millis(5)),
        }
        assert!(child.try_wait().unwrap().is_none(), "ended early");
    };
    let signal = |kind: &str, id: &str| {
        let mut command = Command::new("kill");
        command.args([kind, id]).stderr(Stdio::null()).status().unwrap().success()
    };
    assert!(signal("-0", &id), "the decoder runs");
    assert!(signal("-INT", &child.id().to_string()));
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let mut text = String::new();
    child.stderr.take().unwrap().read_to_string(&mut text).unwrap();
    let until = Instant::now() + Duration::from_secs(10);
    // Its parent has ended: until another process adopts and reaps it, it is a zombie.
    let runs =
        || signal("-0", &id) && !fs::read_to_string(format!("/proc/{id}/stat")).is_ok_and(|s| s.contains(") Z "));
    while runs() {
        assert!(Instant::now() < until, "the decoder still runs: {text}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// No frame is taken of a clip that a manifest with the name of a clip refers to.
///
/// Promise (files): a manifest or playlist that is called a clip is not followed.
#[test]
fn a_manifest_is_not_followed() {
    if !has_ffmpeg("a_manifest_is_not_followed") {
        return;
    }
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    clip(folder, 6);
    let dash = "<?xml version=\"1.0\"?>\n<MPD xmlns=\"urn:mpeg:dash:schema:mpd:2011\" type=\"static\" \
        mediaPresentationDuration=\"PT1S\" profiles=\"urn:mpeg:dash:profile:isoff-on-demand:2011\"><Period><AdaptationSet \
        mimeType=\"video/mp4\" contentType=\"video\"><Representation id=\"0\" bandwidth=\"100000\" width=\"192\" height=\"144\">\
        <BaseURL>clip.mp4</BaseURL></Representation></AdaptationSet></Period></MPD>";
    let list = "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nclip.mp4\n#EXT-X-ENDLIST\n";
    for (name, content) in [
        ("dash.mp4", dash),
        ("dash.mkv", dash),
        ("hls.mp4", list),
        ("blank.mp4", &format!("\n{list}")),
        ("concat.mp4", "ffconcat version 1.0\nfile clip.mp4\n"),
        ("web.mp4", "WEBVTT\n"),
    ] {
        fs::write(folder.join(name), content).unwrap();
        let output = run(folder, &format!("cameras {name} -o out --frames 2 {QUICK}"));
        let text = said(&output);
        assert_eq!(output.status.code(), Some(1), "{name}: {text}");
        assert!(
            !text.contains("matching") && text.contains(&format!("error: {name}: expected a clip")),
            "{name}: {text}"
        );
        assert!(!folder.join("out").exists(), "{name}");
    }
}

/// A network gets at most `--frames` frames of a clip; without a clip the flag is refused.
///
/// Promise (files): `infer` takes at most so many frames of a clip.
/// Promise of `runs_of_every_command_are_described`.
#[test]
fn a_network_is_given_so_many_frames() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    if has_ffmpeg("a_network_is_given_so_many_frames") {
        clip(folder, 30);
        let done = run(folder, "infer clip.mp4 -o result --cameras predicted --frames 3 --no-html");
        assert!(done.status.success(), "{}", said(&done));
        let count = fs::read_dir(folder.join("result/frames")).unwrap().count();
        assert!((2..=3).contains(&count), "{count} frames");
        let text = said(&run(folder, "info clip.mp4"));
        assert!(text.starts_with("clip of 192x144 pixels, about 30 pictures"), "{text}");
    }
    let photo = weaver_io::Image::filled(32, 32, [0.5; 3]);
    photo.write_png(folder.join("a.png")).unwrap();
    let done = run(folder, "infer a.png -o other --cameras predicted --frames 3");
    let text = said(&done);
    assert!(done.status.code() == Some(2) && text.contains("--frames: expected a clip, found photos"), "{text}");
}
