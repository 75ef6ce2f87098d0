//! `info` on each kind of file.

use crate::capture;
use crate::command::splatweaver;
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
    weaver_io::write_ply(&ply, &splats()).unwrap();
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
