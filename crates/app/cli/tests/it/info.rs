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
///
/// Promise (options): `info` describes run folders and each of their files, and cameras whose photos are missing.
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
///
/// Promise of `a_run_is_described_by_any_of_its_files`.
#[test]
fn cameras_without_photos_are_described() {
    let folder = tempfile::tempdir().unwrap();
    let transforms = capture::transforms(folder.path(), 2);
    std::fs::remove_dir_all(folder.path().join("images")).unwrap();
    let done = splatweaver(&[&"info", &transforms]).fine();
    assert!(done.stdout.contains("transforms.json, 2 frames"), "{}", done.stdout);
}

/// Formats follow from file names, in any order of conversions.
#[test]
fn a_scene_is_written_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let named = |name: &str| folder.path().join(name);
    weaver_io::write_gaussians(named("scene.ply"), &splats()).unwrap();
    let mut from = named("scene.ply");
    for format in weaver_io::SCENE_FORMATS.into_iter().filter(|format| format.is_written()) {
        let place = if format.writes_one_file() { "other" } else { "other/" };
        let to = named(&format!("{place}{}", format.file_name_end()));
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
        .refused(1, &["scene.obj", "expected .ply, .compressed.ply, .splat, .spz, .v4.spz, .sog, meta.json, lod-meta.json, .glb, .gltf, .usda, .usdz, .ksplat or .wsz, found .obj"]);
    splatweaver(&[&"convert", &named("nothing.ply"), &named("a.spz")]).refused(1, &["nothing.ply"]);
    std::fs::write(named("bad.spz"), "x").unwrap();
    splatweaver(&[&"convert", &named("bad.spz"), &named("a.spz")]).refused(1, &["bad.spz"]);
    assert!(!named("a.spz").exists());
}

/// A run of any command is described by its folder: its settings, its progress, its output.
///
/// Promise (files): `info` describes runs of every command, scans, pictures of Gaussians, clips, arrays, JSON of
/// results and folders; its errors are true.
#[test]
fn runs_of_every_command_are_described() {
    let folder = tempfile::tempdir().unwrap();
    for command in ["fit", "lidar", "image fit", "dynamic", "vad", "bench compress"] {
        let path = folder.path().join(command);
        let out = weaver_io::OutputFolder::claim(&path, command, [""; 0]).unwrap();
        let write = |name: &str, text: &str| weaver_io::write_text(out.file(name).unwrap(), text).unwrap();
        write("run.json", "{\"seed\": 7, \"nothing\": null, \"scans\": \"street\", \"fit\": {\"a\": 1, \"b\": 2}}");
        let described = splatweaver(&[&"info", &path]).fine().stdout;
        for part in
            [&*format!("run of `{command}`"), "seed: 7", "scans: \"street\"", "fit: 2 keys", "no step logged yet"]
        {
            assert!(described.contains(part), "{command}: {part}: {described}");
        }
        assert!(!described.contains("nothing") && !described.contains("summary"), "{described}");
        write("metrics.jsonl", "{\"step\": 1, \"loss\": 2.0}\n{\"step\": 20, \"loss\": 1.0}\n");
        write("trajectory.txt", "");
        // The summary of `image fit` is a list.
        write("summary.json", "[{\"psnr\": 31.5}]");
        let described = splatweaver(&[&"info", &path]).fine().stdout;
        for part in ["20 steps logged, no checkpoint", "files: trajectory.txt", "summary.json\n{\"psnr\":31.5}"] {
            assert!(described.contains(part), "{command}: {part}: {described}");
        }
    }
}

/// Scans, pictures of Gaussians and JSON of results are described, and errors state the expected kind of file or
/// folder.
///
/// Promise of `runs_of_every_command_are_described`.
#[test]
fn scans_pictures_and_results_are_described() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    weaver_io::write_lidar_scan(path("1.bin"), &[[1.0, 2.0, 3.0]]).unwrap();
    let says = |name: &str| splatweaver(&[&"info", &path(name)]).fine().stdout;
    assert!(says("1.bin").starts_with("scan of a lidar, 1 points"), "{}", says("1.bin"));
    std::fs::write(path("2.bin"), [1; 13]).unwrap();
    splatweaver(&[&"info", &path("2.bin")]).refused(1, &["2.bin", "PyTorch", "or a scan of a lidar", "13 bytes"]);
    std::fs::write(path("cameras.json"), "{\"confidence\": \"good\", \"points\": 5}").unwrap();
    assert!(says("cameras.json").contains("confidence: \"good\"\npoints: 5"), "{}", says("cameras.json"));
    std::fs::write(path("bad.json"), "{").unwrap();
    splatweaver(&[&"info", &path("bad.json")]).refused(1, &["bad.json", "JSON"]);
    let image = weaver_io::Image::filled(32, 24, [0.2, 0.4, 0.6]);
    std::fs::create_dir(path("photos")).unwrap();
    image.write_png(path("photos/a.png")).unwrap();
    assert!(says("photos").starts_with("1 photos"), "{}", says("photos"));
    splatweaver(&[&"image", &"fit", &path("photos/a.png"), &"-o", &path("a.wgi"), &"--steps", &"1"]).fine();
    assert!(says("a.wgi").starts_with("picture of 32x24 pixels, "), "{}", says("a.wgi"));
    std::fs::create_dir(path("nothing")).unwrap();
    splatweaver(&[&"info", &path("nothing")]).refused(1, &["nothing: folder: expected a run, a COLMAP model"]);
}

/// Names of files reach the terminal without control characters, in results, notes and errors.
///
/// Promise of `names_do_not_steer_the_terminal`.
#[cfg(unix)]
#[test]
fn names_of_files_do_not_steer_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a\u{1b}[31m\u{7}.ply");
    let missing = splatweaver(&[&"info", &path]).refused(1, &[r"a\u001b[31m\u0007.ply"]);
    weaver_io::write_gaussians(&path, &splats()).unwrap();
    let said = splatweaver(&[&"convert", &path, &folder.path().join("b\u{1b}c.splat")]).fine();
    let all = [missing.stderr, said.stdout, said.stderr].concat();
    assert!(all.contains(r"b\u001bc.splat") && !all.contains(['\u{1b}', '\u{7}']), "{all:?}");
}

#[test]
fn a_report_names_the_machine() {
    let lines = splatweaver(&[&"info", &"--report"]).fine().stdout;
    for name in ["splatweaver", "system", "processor", "cores", "instructions", "memory", "arithmetic", "drawings"] {
        assert!(lines.lines().any(|line| line.starts_with(name)), "{name}: {lines}");
    }
    assert!(lines.contains(env!("CARGO_PKG_VERSION")), "{lines}");
    for wrong in [&[&"info" as &dyn AsRef<std::ffi::OsStr>, &"--report", &"x.ply"][..], &[&"info", &"--json"]] {
        assert_eq!(splatweaver(wrong).code, 2);
    }
}
