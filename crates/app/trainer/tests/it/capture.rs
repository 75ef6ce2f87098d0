//! Captures on disk in the place of the built-in scenes, whose 384 photos each session would draw anew.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use weaver_data::Scene;
use weaver_io::Transforms;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::{Frame, PointCloud};

/// Writes a scene as photos with cameras and points.
pub fn write(scene: &Scene, folder: &Path) {
    std::fs::create_dir_all(folder.join("images")).unwrap();
    let mut frames = Vec::new();
    for (i, view) in scene.views.iter().enumerate() {
        let name = format!("images/{i}.png");
        view.image.write_png(folder.join(&name)).unwrap();
        frames.push(Frame::new(name, view.camera));
    }
    let positions: Vec<[f32; 3]> = scene.points.iter().map(|p| p.as_vec3().to_array()).collect();
    let cloud = PointCloud { colors: vec![[9; 3]; positions.len()], positions };
    weaver_io::ply::write_points(folder.join("points3D.ply"), &cloud).unwrap();
    Transforms { frames, ..Transforms::default() }.write(folder.join("transforms.json")).unwrap();
}

/// Two captures, so that a run draws scenes as well as views. They lie in cargo's folder for files of tests; each
/// process writes the same bytes there, a file at a time.
static FOLDERS: LazyLock<[PathBuf; 2]> = LazyLock::new(|| {
    [3, 4].map(|seed| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("micro-capture-{seed}"));
        write(&scene(seed, &ProceduralOptions { width: 32, height: 32, views: 9 }), &folder);
        folder
    })
});

/// The captures' folders, for `data.folders`.
pub fn folders() -> Vec<PathBuf> {
    FOLDERS.to_vec()
}
