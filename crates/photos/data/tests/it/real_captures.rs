//! Real captures, where there are any: baselines known from an independent implementation.

use crate::quality::{mean_color, nearest_copied};
use std::path::{Path, PathBuf};
use weaver_data::Scene;
use weaver_data::capture::{CaptureOptions, load};

/// The folder of captures: `$WEAVER_SHARED/data`, or `shared/data` beside any folder above this crate.
fn data() -> Option<PathBuf> {
    let shared = std::env::var_os("WEAVER_SHARED").map(PathBuf::from).or_else(|| {
        let above = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors();
        above.map(|folder| folder.join("shared")).find(|shared| shared.join("fixtures").is_dir())
    });
    let data = shared.map(|shared| shared.join("data")).filter(|data| data.is_dir());
    if data.is_none() {
        println!("skipped: no data (captures)");
    }
    data
}

fn load_all(folder: &Path, names: &[&str]) -> Vec<Scene> {
    let options = CaptureOptions::default();
    names.iter().map(|name| load(folder.join(name), &options).unwrap_or_else(|e| panic!("{e}"))).collect()
}

#[test]
fn the_protocol_gives_the_known_baselines() {
    let Some(data) = data() else { return };
    let names = ["fox", "bonsai", "kitchen", "plush", "fern", "workshop", "castle-p30", "fountain-p11"];
    let scenes = load_all(&data, &names);
    assert_eq!(scenes.iter().map(|s| s.held_out_views().len()).sum::<usize>(), 37);
    for scene in &scenes {
        scene.check_training(4).unwrap();
        scene.check_evaluation(4).unwrap();
    }
    let (color, copied) = (mean_color(&scenes), nearest_copied(&scenes));
    println!("mean color {color:.3} dB, nearest view {copied:.3} dB");
    assert!((color - 14.16).abs() < 0.05);
    assert!((copied - 16.65).abs() < 0.05);
    let unseen = load_all(&data, &["ramen", "banana", "entry-p10"]);
    for (scene, known) in unseen.iter().zip([15.32, 20.39, 15.95]) {
        let copied = nearest_copied(std::slice::from_ref(scene));
        println!("{}: nearest view {copied:.2} dB", scene.name);
        assert!((copied - known).abs() < 0.05);
    }
}

#[test]
fn sparse_points_give_depth_and_scale() {
    let Some(data) = data() else { return };
    let fox = &load_all(&data, &["fox"])[0];
    assert_eq!((fox.views.len(), fox.points.len()), (50, 12741));
    let tuple = &weaver_data::evaluation_tuples(fox, 0, 4)[0];
    let posed = fox.normalized(tuple).unwrap();
    // Depths of the points range from 2.5 to 7.7 around 4.9, so must the unit.
    assert!((1.0 / 7.7..1.0 / 2.5).contains(&posed.scale));
    for (view, visible) in fox.views.iter().zip(&fox.visible) {
        let known = view.depth.as_ref().unwrap().iter().filter(|z| **z > 0.0).count();
        assert!(known > 0 && known <= visible.len());
    }
}

#[test]
fn transparent_photos_lie_on_white_and_need_a_scale() {
    let Some(data) = data() else { return };
    let lego = &load_all(&data, &["lego-synthetic"])[0];
    assert_eq!((lego.training_views().len(), lego.held_out_views().len()), (100, 25));
    assert_eq!(lego.views[0].image.pixels[..3], [1.0; 3]);
    let k = lego.views[0].camera.intrinsics;
    assert!((k.fx - 355.5555 / 4.0).abs() < 1e-3 && (k.cx, k.cy) == (32.0, 24.0));
    assert!(lego.views.iter().all(|view| (view.camera.pose.center().length() - 4.031).abs() < 1e-3));
    assert!(lego.normalized(&weaver_data::evaluation_tuples(lego, 0, 4)[0]).is_err());
}
