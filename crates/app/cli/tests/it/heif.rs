//! HEIC photos in place of others: programs that decode them, and the messages without one.

#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output};
use weaver_io::{PhotoFile, Transforms, focal_35mm};
use weaver_procedural::{ProceduralOptions, scene};

const BINARY: &str = env!("CARGO_BIN_EXE_splatweaver");
/// The container of a phone's photo of 96 x 128 pixels, stored on its side.
const CONTAINER: &[u8] = include_bytes!("../../../../../tests/fixtures/heic/tiles.heic");
const COUNT: usize = 5;
/// A decoder of the photos that [`photos`] writes: the last byte of each says which picture it is.
const DECODE: &str = "cp \"$(dirname \"$0\")/../$(tail -c 1 \"$1\").png\" \"$2\"";

/// HEIC photos in `photos`, and the pictures that a decoder makes of them.
fn photos(folder: &Path) {
    let scene = scene(3, &ProceduralOptions { width: 96, height: 128, views: 8 });
    for name in ["photos", "bin"] {
        fs::create_dir(folder.join(name)).unwrap();
    }
    for (i, view) in scene.views.iter().take(COUNT).enumerate() {
        view.image.write_png(folder.join(format!("{i}.png"))).unwrap();
        // A box of free space, which readers skip.
        let marked = [CONTAINER, b"\0\0\0\x09free", i.to_string().as_bytes()].concat();
        fs::write(folder.join(format!("photos/IMG_{i}.HEIC")), marked).unwrap();
    }
}

/// A program in `bin` that runs this script.
fn script(folder: &Path, name: &str, script: &str) {
    let program = folder.join("bin").join(name);
    fs::write(&program, format!("#!/bin/sh\nPATH=/usr/bin:/bin\n{script}\n")).unwrap();
    fs::set_permissions(program, PermissionsExt::from_mode(0o755)).unwrap();
}

/// Runs the binary where `bin` is all of the PATH.
fn run(folder: &Path, line: &str) -> Output {
    let mut command = Command::new(BINARY);
    command.current_dir(folder).env("PATH", folder.join("bin")).args(line.split(' ')).output().unwrap()
}

fn said(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Promise (photos): HEIC photos of phones get cameras as other photos do; upright JPEGs of them, with their focal
/// length, lie beside the cameras.
#[test]
fn photos_of_phones_get_cameras() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    photos(folder);
    script(folder, "heif-convert", DECODE);
    let line = "cameras photos -o found --focal 0.87";
    let output = run(folder, line);
    assert!(output.status.success(), "{}", said(&output));
    assert!(said(&output).contains("photos: 5 of HEIC or AVIF converted, in found/converted"), "{}", said(&output));
    let frames = Transforms::read(folder.join("found/transforms.json")).unwrap().frames;
    assert_eq!((frames.len(), frames[1].name.as_str()), (COUNT, "converted/IMG_1.jpg"));
    for frame in &frames {
        assert_eq!((frame.camera.width, frame.camera.height), (96, 128));
        let photo = PhotoFile::at(folder.join("found").join(&frame.name)).unwrap();
        assert_eq!((photo.size(), photo.stored_size()), ((96, 128), (96, 128)));
        assert_eq!(focal_35mm(photo.path()).unwrap(), Some(26.0));
    }
    // Photos that are not chosen again do not stay.
    fs::remove_file(folder.join("photos/IMG_4.HEIC")).unwrap();
    assert!(run(folder, line).status.success());
    assert_eq!(names(&folder.join("found/converted")), [0, 1, 2, 3].map(|i| format!("IMG_{i}.jpg")));
    // Masks are beside the photos that were given, under their names.
    fs::create_dir(folder.join("photos/masks")).unwrap();
    for i in 0..4 {
        fs::copy(folder.join("0.png"), folder.join(format!("photos/masks/IMG_{i}.png"))).unwrap();
    }
    let output = run(folder, "cameras photos -o masked --focal 0.87 --masks");
    assert!(output.status.success(), "{}", said(&output));
    let frames = Transforms::read(folder.join("masked/transforms.json")).unwrap().frames;
    assert_eq!(frames[0].mask.as_deref(), Some(Path::new("../photos/masks/IMG_0.png")));
}

/// Promise (photos): a program that decodes a tile of a HEIC, or fails, gives way to the next one.
#[test]
fn the_next_program_takes_over() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    photos(folder);
    weaver_io::Image::filled(64, 64, [0.5; 3]).write_png(folder.join("tile.png")).unwrap();
    script(folder, "heif-convert", "echo no codec >&2; exit 3");
    script(folder, "magick", "cp \"$(dirname \"$0\")/../tile.png\" \"$2\"");
    let output = run(folder, "cameras photos -o found --focal 0.87");
    let text = said(&output);
    assert!(output.status.code() == Some(1) && !folder.join("found").exists(), "{text}");
    for part in ["5 of 5 cannot be decoded", "IMG_0.HEIC", "heif-convert: exit status: 3; no codec", "found 64x64"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    // Its input comes behind -i and its output last.
    let last = "while [ \"$1\" != -i ]; do shift; done; IN=\"$2\"; for OUT in \"$@\"; do :; done";
    script(folder, "ffmpeg", &format!("{last}\n{}", DECODE.replace("$1", "$IN").replace("$2", "$OUT")));
    let output = run(folder, "cameras photos -o found --focal 0.87");
    assert!(output.status.success(), "{}", said(&output));
    assert_eq!(names(&folder.join("found/converted")).len(), COUNT);
}

/// Promise (photos): without a program that decodes HEIC, the error says how to install one; a few damaged HEIC are
/// left out.
#[test]
fn heic_that_cannot_be_decoded_is_named() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    photos(folder);
    for line in ["cameras photos -o found", "reconstruct photos -o found --quality draft"] {
        let output = run(folder, line);
        let text = said(&output);
        assert_eq!(output.status.code(), Some(1), "{text}");
        for part in ["photos: 5 of 5 cannot be read: HEIC: convert it to JPEG", "IMG_0.HEIC", "done for you"] {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(!folder.join("found").exists(), "{line}");
    }
    // Older versions of ffmpeg decode no photos in tiles, whose message would help nobody.
    script(folder, "ffmpeg", "echo moov atom not found >&2; exit 1");
    let text = said(&run(folder, "cameras photos -o found"));
    assert!(text.contains("HEIC: convert it to JPEG") && !text.contains("moov"), "{text}");
    script(folder, "heif-convert", DECODE);
    fs::write(folder.join("photos/IMG_2.HEIC"), &CONTAINER[..600]).unwrap();
    let output = run(folder, "cameras photos -o found --focal 0.87");
    let text = said(&output);
    assert!(output.status.success(), "{text}");
    for part in ["warning: 1 of 5 photos cannot be decoded", "IMG_2.HEIC", "copied whole"] {
        assert!(text.contains(part), "{part}: {text}");
    }
}
