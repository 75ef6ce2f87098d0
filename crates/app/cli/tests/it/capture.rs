//! Small captures on disk, photographed in the procedural scenes.

use std::path::{Path, PathBuf};
use weaver_data::Scene;
use weaver_geometry::Camera;
use weaver_io::Transforms;
use weaver_io::colmap::{CameraModel, ImageRecord, Model, Point};
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::Frame;

/// Enough for a context of two out of a pool of four, with two views held out.
pub const VIEWS: usize = 10;

fn photographed(views: usize) -> Scene {
    scene(5, &ProceduralOptions { width: 40, height: 32, views })
}

/// The photos of a scene in `folder`, by name relative to it.
fn write_photos(folder: &Path, scene: &Scene) -> Vec<String> {
    std::fs::create_dir_all(folder.join("images")).unwrap();
    let names: Vec<String> = (0..scene.views.len()).map(|i| format!("images/{i:02}.png")).collect();
    for (name, view) in names.iter().zip(&scene.views) {
        view.image.write_png(folder.join(name)).unwrap();
    }
    names
}

/// A capture with a transforms.json and nothing else; its size in the world is not known.
pub fn transforms(folder: &Path, views: usize) -> PathBuf {
    let scene = photographed(views);
    let names = write_photos(folder, &scene);
    let frame = |(name, view): (&String, &weaver_data::View)| Frame::new(name, view.camera);
    let frames = names.iter().zip(&scene.views).map(frame).collect();
    let path = folder.join("transforms.json");
    Transforms { frames, ..Transforms::default() }.write(&path).unwrap();
    path
}

/// A capture with a COLMAP model, points included.
pub fn colmap(folder: &Path, views: usize) -> PathBuf {
    let scene = photographed(views);
    let names = write_photos(folder, &scene);
    let mut model = Model::default();
    for (id, (name, view)) in (1..).zip(names.iter().zip(&scene.views)) {
        let Camera { pose, intrinsics, width, height } = view.camera;
        model.cameras.insert(id, CameraModel { width, height, intrinsics, distortion: None });
        let seen = scene.visible[id as usize - 1].iter().map(|&p| {
            let pixel = intrinsics.project(pose.apply(scene.points[p as usize]));
            (pixel.x, pixel.y, Some(u64::from(p)))
        });
        let name = name.trim_start_matches("images/").to_string();
        model.images.push(ImageRecord { id, name, camera_id: id, pose, points: seen.collect() });
    }
    for (id, point) in scene.points.iter().enumerate() {
        model.points.push(Point { id: id as u64, xyz: point.to_array(), rgb: [128; 3], error: 0.5, track: Vec::new() });
    }
    let sparse = folder.join("sparse/0");
    std::fs::create_dir_all(&sparse).unwrap();
    model.write_binary(&sparse).unwrap();
    sparse
}

/// Changes a file's text.
pub fn edit(path: &Path, change: impl FnOnce(String) -> String) {
    let text = std::fs::read_to_string(path).unwrap();
    let changed = change(text.clone());
    assert_ne!(changed, text, "{} was meant to change", path.display());
    std::fs::write(path, changed).unwrap();
}

/// Cuts a file short.
pub fn halve(path: &Path) {
    let bytes = std::fs::read(path).unwrap();
    std::fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
}
