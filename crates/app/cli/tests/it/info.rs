//! `info` on each kind of file.

use crate::capture;
use crate::in_process::splatweaver;
use crate::render::splats;
use crate::run::Run;
use weaver_geometry::Pose;
use weaver_io::realestate::{Clip, ClipFrame};

#[test]
fn every_kind_of_file_is_described() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let transforms = capture::transforms(folder, 2);
    let sparse = capture::colmap(folder, 2);
    let (ply, clip) = (folder.join("scene.ply"), folder.join("clip.txt"));
    weaver_io::write_gaussians(&ply, &splats()).unwrap();
    let frame = ClipFrame { timestamp: 5, normalized: [1.0, 1.0, 0.5, 0.5], pose: Pose::IDENTITY };
    Clip { url: "http://example.org".into(), frames: vec![frame] }.write(&clip).unwrap();
    let kinds = [
        (folder.join("images/00.png"), "image, 40x32"),
        (ply, "Gaussians, 2"),
        (Run::shared().path().join("checkpoint.safetensors"), "preset: micro"),
        (transforms, "transforms.json, 2 frames"),
        (folder.to_path_buf(), "COLMAP model"),
        (sparse.join("cameras.bin"), "COLMAP cameras, 2"),
        (sparse.join("images.bin"), "COLMAP images, 2"),
        (sparse.join("points3D.bin"), "COLMAP points"),
        (clip, "RealEstate10K, 1 cameras"),
        (
            concat!(env!("CARGO_MANIFEST_DIR"), "/../../../tests/fixtures/torch_checkpoint.ckpt").into(),
            "PyTorch checkpoint, ",
        ),
    ];
    for (path, says) in kinds {
        let done = splatweaver(&[&"info", &path]).fine();
        assert!(done.stdout.contains(says), "{}: {}", path.display(), done.stdout);
    }
}

#[test]
fn other_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("notes.md");
    splatweaver(&[&"info", &path]).refused(1, &["notes.md"]);
    std::fs::write(&path, "x").unwrap();
    splatweaver(&[&"info", &path]).refused(1, &["notes.md", "known extension"]);
}

/// A run is described by its folder and by each of its files.
#[test]
fn a_run_is_described_by_any_of_its_files() {
    let run = Run::shared().path();
    for (name, parts) in [
        ("", &["run of splatweaver, preset micro", "4 of 4 steps", "checksum of the weights", "PSNR"][..]),
        ("summary.json", &["4 of 4 steps, seed 0", "checksum of the weights", "PSNR"]),
        ("config.toml", &["TOML", "preset: \"micro\"", "stages: 2 tables", "optimizer: 7 keys"]),
    ] {
        let done = splatweaver(&[&"info", &run.join(name)]).fine();
        assert!(parts.iter().all(|part| done.stdout.contains(part)), "{name}: {}", done.stdout);
    }
    let started = Run::shared().copy();
    let done = splatweaver(&[&"info", &started.path()]).fine();
    assert!(done.stdout.contains("4 of 4 steps") && !done.stdout.contains("summary"), "{}", done.stdout);
}

/// Broken summaries and configurations are refused by name.
#[test]
fn broken_summaries_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in [("summary.json", "{"), ("mine.toml", "a = "), ("model.ckpt", "no archive")] {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        splatweaver(&[&"info", &path]).refused(1, &[name]);
    }
    let path = folder.path().join("summary.json");
    std::fs::write(&path, "{\"near\": 0.5}").unwrap();
    assert!(splatweaver(&[&"info", &path]).fine().stdout.contains("near: 0.5"));
}

/// Cameras are described where their photos are missing.
#[test]
fn cameras_without_photos_are_described() {
    let folder = tempfile::tempdir().unwrap();
    let transforms = capture::transforms(folder.path(), 2);
    std::fs::remove_dir_all(folder.path().join("images")).unwrap();
    let done = splatweaver(&[&"info", &transforms]).fine();
    assert!(done.stdout.contains("transforms.json, 2 frames"), "{}", done.stdout);
}

/// Formats are told by names, in whichever order a file passes through them.
#[test]
fn a_scene_is_written_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let named = |name: &str| folder.path().join(name);
    weaver_io::write_gaussians(named("scene.ply"), &splats()).unwrap();
    let mut from = named("scene.ply");
    for format in weaver_io::SCENE_FORMATS.into_iter().filter(|format| format.is_written()) {
        let to = named(&format!("other{}", format.file_name_end().replace("meta", "/meta")));
        let done = splatweaver(&[&"convert", &from, &to]).fine();
        assert!(done.stdout.starts_with("2 Gaussians, ") && done.stdout.contains(format.keeps), "{}", done.stdout);
        let back = weaver_io::read_gaussians(&to).unwrap();
        assert_eq!(back.len(), 2);
        if format.name == "ply" {
            assert_eq!(back, splats());
        }
        from = to;
    }
    let help = splatweaver(&[&"convert", &"--help"]).fine().stdout;
    assert!(weaver_io::SCENE_FORMATS.iter().all(|format| help.contains(format.keeps)), "{help}");
    let scene = named("scene.ply");
    splatweaver(&[&"convert", &scene, &scene]).refused(2, &["scene.ply", "what is read"]);
    splatweaver(&[&"convert", &scene, &named("scene.obj")])
        .refused(1, &["scene.obj", "expected .ply, .compressed.ply, .splat, .spz, .v4.spz, .sog, meta.json, .glb, .gltf, .ksplat or .wsz, found .obj"]);
    splatweaver(&[&"convert", &named("nothing.ply"), &named("a.spz")]).refused(1, &["nothing.ply"]);
    std::fs::write(named("bad.spz"), "x").unwrap();
    splatweaver(&[&"convert", &named("bad.spz"), &named("a.spz")]).refused(1, &["bad.spz"]);
    assert!(!named("a.spz").exists());
}
