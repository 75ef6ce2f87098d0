//! Captures in which some photos see no points.

use crate::{PixelCnnRecipe, config};
use std::path::Path;
use weaver_io::Image;
use weaver_trainer::{Config, Session};

/// A capture of ten photos on a line and two points, which the first `blind` photos do not see. If no photo sees them
/// they lie behind all cameras, since points without observations count as seen by every camera in front of them.
pub fn captured(folder: &Path, blind: usize) -> Config<PixelCnnRecipe> {
    let (images, model) = (folder.join("images"), folder.join("sparse/0"));
    std::fs::create_dir_all(&images).unwrap();
    std::fs::create_dir_all(&model).unwrap();
    let mut records = String::new();
    for i in 0..10 {
        let pixels = (0..768).map(|p| ((p + i) % 7) as f32 / 7.0).collect();
        Image { width: 16, height: 16, pixels }.write_png(images.join(format!("{i}.png"))).unwrap();
        let seen = if i < blind { "" } else { "8 8 1 9 9 2" };
        records.push_str(&format!("{} 1 0 0 0 {} 0 0 1 {i}.png\n{seen}\n", i + 1, -0.1 * i as f64));
    }
    std::fs::write(model.join("images.txt"), records).unwrap();
    std::fs::write(model.join("cameras.txt"), "1 PINHOLE 16 16 16 16 8 8\n").unwrap();
    let z = if blind == 10 { -3 } else { 3 };
    let points = format!("1 0.4 0 {z} 9 9 9 0 9 0\n2 0.5 0.1 {z} 9 9 9 0 9 1\n");
    std::fs::write(model.join("points3D.txt"), points).unwrap();
    let mut config = config(4);
    config.data.folders = vec![folder.to_path_buf()];
    (config.data.context_views, config.data.pool) = (2, 3);
    config
}

/// Tuples that see no points are left out and their photos named.
///
/// Promise (results): photos that see no points are named before training, and no tuple consists of them alone.
#[test]
fn tuples_without_points_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = Session::new(captured(folder.path(), 5)).unwrap();
    let plan = session.plan();
    let named = plan.contains("4 of 8 training photos see no points: 1.png, 2.png, 3.png, 4.png; tuples");
    assert!(named, "{plan}");
    assert!(!plan.contains("7.png"), "{plan}");
    while session.advance().unwrap().is_some() {}
    assert_eq!(session.steps(), (4, 4));
}

/// A capture none of whose photos sees points is refused at once.
///
/// Promise of `tuples_without_points_are_left_out`.
#[test]
fn captures_without_seen_points_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let message = Session::new(captured(folder.path(), 10)).expect_err("an error").to_string();
    assert!(message.contains("scene_scale"), "{message}");
}

#[test]
fn a_capture_that_all_photos_see_has_no_remark() {
    let folder = tempfile::tempdir().unwrap();
    assert!(!Session::new(captured(folder.path(), 0)).unwrap().plan().contains("warning"));
}
