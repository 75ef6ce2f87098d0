//! `splatweaver image`: files of Gaussians from pictures and back.

use std::path::Path;
use std::process::{Command, Output};
use weaver_io::{Background, Image};

fn splatweaver(folder: &Path, arguments: &str) -> Output {
    let words = arguments.split_whitespace();
    Command::new(env!("CARGO_BIN_EXE_splatweaver")).current_dir(folder).args(words).output().unwrap()
}

fn fine(folder: &Path, arguments: &str) -> String {
    let done = splatweaver(folder, arguments);
    assert!(done.status.success(), "{arguments}: {}", String::from_utf8_lossy(&done.stderr));
    String::from_utf8(done.stdout).unwrap()
}

fn refused(folder: &Path, arguments: &str, code: i32, expected: &str) {
    let done = splatweaver(folder, arguments);
    let message = String::from_utf8_lossy(&done.stderr).into_owned();
    assert_eq!(done.status.code(), Some(code), "{arguments}: {message}");
    assert!(message.contains(expected), "{arguments}: {message}");
}

/// A folder with a soft picture of 80 x 60.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let wave = |p: usize, c: usize| 0.5 + 0.3 * ((p % 80) as f32 * 0.1 + (p / 80 * (c + 1)) as f32 * 0.05).sin();
    let pixels = (0..80 * 60).flat_map(|p| [0, 1, 2].map(|c| wave(p, c))).collect();
    Image { width: 80, height: 60, pixels }.write_png(folder.path().join("p.png")).unwrap();
    folder
}

#[test]
fn a_picture_is_fitted_and_drawn() {
    let folder = folder();
    let here = folder.path();
    let line = fine(here, "image fit p.png -o p.wgi --gaussians 60 --steps 120");
    assert!(line.starts_with("60 Gaussians, ") && line.ends_with("dB: p.wgi\n"), "{line}");
    fine(here, "image fit p.png -o again.wgi --gaussians 60 --steps 120 --threads 1");
    let read = |name: &str| std::fs::read(here.join(name)).unwrap();
    assert_eq!(read("p.wgi"), read("again.wgi"));
    fine(here, "image draw p.wgi -o whole.png");
    fine(here, "image draw p.wgi -o part.png --region 16,8,30,20");
    let image = |name: &str| Image::read(here.join(name), Background::Black).unwrap();
    assert_eq!(image("part.png"), image("whole.png").crop(16, 8, 30, 20));
    let apart = image("whole.png").pixels.iter().zip(&image("p.png").pixels).map(|(a, b)| (a - b).abs()).sum::<f32>();
    assert!(apart / (80.0 * 60.0 * 3.0) < 0.02, "{apart}");
    fine(here, "image draw p.wgi -o small.png --scale 0.5");
    assert_eq!((image("small.png").width, image("small.png").height), (40, 30));
    let bench = fine(here, "image bench p.png --steps 20");
    assert_eq!(bench.lines().count(), 7, "{bench}");
}

#[test]
fn bytes_and_decibels_are_kept() {
    let folder = folder();
    let here = folder.path();
    fine(here, "image fit p.png -o p.wgi --bytes 400 --steps 60");
    assert!(std::fs::metadata(here.join("p.wgi")).unwrap().len() <= 400);
    let line = fine(here, "image fit p.png -o q.wgi --psnr 30 --steps 60");
    let decibels: f64 = line.split(", ").last().unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!(decibels >= 30.0, "{line}");
    refused(here, "image fit p.png -o q.wgi --psnr 90 --steps 2", 1, "expected a fit that reaches it");
}

#[test]
fn what_cannot_be_is_refused() {
    let folder = folder();
    let here = folder.path();
    refused(here, "image fit p.png -o p.png", 2, "what is read");
    refused(here, "image fit p.png -o p.wgi --ratio 0", 2, "--ratio: expected a number above 0");
    refused(here, "image fit p.png -o p.wgi --gaussians 4801", 1, "expected 1 to 4800");
    refused(here, "image fit p.png -o p.wgi --bytes 500 --psnr 3", 2, "cannot be used with");
    refused(here, "image draw p.png -o o.png", 1, "p.png: byte 0: expected");
    fine(here, "image fit p.png -o p.wgi --gaussians 5 --steps 1 --published");
    refused(here, "image draw p.wgi -o o.png --region 70,0,11,5", 2, "--region: expected pixels of 80 x 60");
    refused(here, "image draw p.wgi -o o.png --region 70,0,11", 2, "X,Y,W,H");
    refused(here, "image draw p.wgi -o o.png --scale 0", 2, "--scale: expected a number above 0");
    let bytes = std::fs::read(here.join("p.wgi")).unwrap();
    std::fs::write(here.join("cut.wgi"), &bytes[..bytes.len() - 3]).unwrap();
    refused(here, "image draw cut.wgi -o o.png", 1, "cut.wgi: ");
    assert!(!here.join("o.png").exists());
}
