//! Photos of pages.

use crate::server::{get, here, scene_page};
use std::path::Path;
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_io::{Image, Transforms};
use weaver_scene::Frame;
use weaver_view_run::{ScenePage, Server};

/// A transforms.json with a camera for each of these photos.
fn transforms(folder: &Path, names: &[&str]) -> std::path::PathBuf {
    let intrinsics = Intrinsics { fx: 12.0, fy: 12.0, cx: 8.0, cy: 6.0 };
    let camera = Camera { pose: Pose::IDENTITY, intrinsics, width: 16, height: 12 };
    let file = folder.join("transforms.json");
    let frames = names.iter().map(|name| Frame::new(*name, camera)).collect();
    Transforms { frames, ..Default::default() }.write(&file).unwrap();
    file
}

fn photo(path: &Path, color: [f32; 3]) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    Image::filled(16, 12, color).write_png(path).unwrap();
}

/// A pipe in the place of a photo or of the report is no photo and no report, and no request waits for its end.
///
/// Promise (servers): a pipe as a photo blocks no one.
#[cfg(unix)]
#[test]
fn a_pipe_as_a_photo_holds_nobody() {
    let folder = tempfile::tempdir().unwrap();
    let file = transforms(folder.path(), &["a.png", "b.png"]);
    photo(&folder.path().join("b.png"), [0.2, 0.5, 0.3]);
    for pipe in ["a.png", "report.html"] {
        assert!(std::process::Command::new("mkfifo").arg(folder.path().join(pipe)).status().unwrap().success());
    }
    let shown = scene_page(None).with_cameras(&file, None).unwrap();
    let shown = ScenePage { report: Some(folder.path().join("report.html")), ..shown };
    assert_eq!([0, 1].map(|i| shown.has_photo(i)), [false, true]);
    let server = Server::new(&shown, None, here()).unwrap();
    server.during(|| {
        let statuses = ["/photo/0", "/photo/1", "/report"].map(|path| get(&server, path).0);
        assert_eq!(statuses, [404, 200, 404]);
    });
}

/// Photos of one name in two folders are distinguished by their folders, and without the folders nothing is shown.
///
/// Promise (servers): photos of one name are distinguished by their folders.
#[test]
fn photos_of_one_name_are_told_by_their_folders() {
    let folder = tempfile::tempdir().unwrap();
    let file = transforms(folder.path(), &["a/1.png", "b/1.png"]);
    let photos = folder.path().join("photos");
    photo(&photos.join("a/1.png"), [0.9, 0.1, 0.1]);
    photo(&photos.join("b/1.png"), [0.1, 0.1, 0.9]);
    let shown = scene_page(None).with_cameras(&file, Some(&photos)).unwrap();
    let [a, b] = [0, 1].map(|i| shown.photo(i).unwrap());
    assert!(a != b);
    std::fs::remove_file(photos.join("b/1.png")).unwrap();
    let shown = scene_page(None).with_cameras(&file, Some(&photos)).unwrap();
    assert_eq!([0, 1].map(|i| shown.photo(i)), [Some(a), None]);
    photo(&photos.join("1.png"), [0.1, 0.9, 0.1]);
    std::fs::remove_file(photos.join("a/1.png")).unwrap();
    let error = scene_page(None).with_cameras(&file, Some(&photos)).unwrap_err().to_string().replace('\\', "/");
    for part in ["a/1.png and ", "b/1.png: expected a file for each of them, found ", "photos/1.png for both"] {
        assert!(error.contains(part), "{part}: {error}");
    }
}
