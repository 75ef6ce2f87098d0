//! Varied scenes: every variation occurs, every view shows something, and exact data are exact.

use crate::quality::{mean_color, nearest_copied};
use std::sync::LazyLock;
use weaver_data::procedural::{ProceduralOptions, varied_scene, varied_unseen_set};
use weaver_data::{Scene, View};
use weaver_geometry::glam::{DVec2, DVec3};

const OPTIONS: ProceduralOptions = ProceduralOptions { width: 32, height: 24, views: 8 };

static SCENES: LazyLock<Vec<Scene>> = LazyLock::new(|| (0..200).map(|seed| varied_scene(seed, &OPTIONS)).collect());

/// The values at a tenth, a half and nine tenths of a sorted list.
fn tenths(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    [1, 5, 9].map(|tenth| values[values.len() * tenth / 10])
}

#[test]
fn lenses_paths_and_places_vary() {
    let (mut fov, mut spread, mut roll, mut parallel, mut rooms) = (vec![], vec![], vec![], 0, 0);
    for scene in &*SCENES {
        let [first, last] = [&scene.views[0].camera, &scene.views[7].camera];
        fov.push(2.0 * (first.width as f64 / 2.0 / first.intrinsics.fx).atan().to_degrees());
        // As seen from where the middle camera looks, at the depth in the middle of its photo.
        let view = &scene.views[4];
        let depth = view.depth.as_ref().unwrap()[OPTIONS.width * OPTIONS.height / 2 + OPTIONS.width / 2];
        let aim = view.camera.pose.inverse().apply(DVec3::Z * f64::from(depth));
        let [a, b] = [first, last].map(|camera| camera.pose.center() - aim);
        if depth > 0.0 {
            spread.push(a.angle_between(b).to_degrees());
        }
        let moved = a.distance(b) / (a.length() + b.length());
        parallel += usize::from(moved > 0.05 && first.pose.angle_to(&last.pose) < moved);
        for view in &scene.views {
            // The image's horizontal direction and the world's.
            let right = view.camera.pose.rotation.transpose() * DVec3::X;
            roll.push(right.z.asin().to_degrees());
        }
        rooms += usize::from(scene.views.iter().all(|view| sky(view) == 0.0));
    }
    let [fov, spread, roll] = [fov, spread, roll].map(tenths);
    println!("tenths: view angle {fov:.1?}, spread {spread:.1?}, roll {roll:.1?}");
    println!("of 200: {parallel} straight ahead, {rooms} without any sky");
    assert!(fov[0] < 37.0 && (47.0..58.0).contains(&fov[1]) && fov[2] > 68.0, "{fov:?}");
    assert!(spread[0] < 15.0 && (20.0..50.0).contains(&spread[1]) && spread[2] > 50.0, "{spread:?}");
    assert!(roll[0] < -5.0 && roll[1].abs() < 3.0 && roll[2] > 5.0, "{roll:?}");
    assert!((30..90).contains(&parallel), "{parallel} straight ahead");
    assert!((80..150).contains(&rooms), "{rooms} without sky");
}

fn sky(view: &View) -> f64 {
    let depth = view.depth.as_ref().unwrap();
    depth.iter().filter(|z| **z == 0.0).count() as f64 / depth.len() as f64
}

#[test]
fn every_view_shows_something() {
    let (mut contrast, mut brightness, mut depths) = (vec![], vec![], vec![]);
    for scene in &*SCENES {
        for view in &scene.views {
            let what = || format!("{}, view {}", scene.name, view.name);
            assert!(sky(view) < 0.75, "{}: {:.2} sky", what(), sky(view));
            let values: Vec<f64> = view.image.pixels.iter().map(|value| f64::from(*value)).collect();
            assert!(values.iter().all(|value| (0.0..=1.0).contains(value)), "{}", what());
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            let deviation = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt();
            assert!(deviation > 0.02 && (0.05..0.95).contains(&mean), "{}: {mean:.3} +- {deviation:.3}", what());
            contrast.push(deviation);
            brightness.push(mean);
            let seen = || view.depth.iter().flatten().map(|z| f64::from(*z)).filter(|z| *z > 0.0);
            let (near, far) = seen().fold((f64::MAX, 0.0), |(a, b), z| (z.min(a), z.max(b)));
            assert!(near > 0.1, "{}: something at {near:.3}", what());
            depths.push(far / near);
        }
        assert!(scene.points.len() > 40, "{}: {} points", scene.name, scene.points.len());
    }
    let [contrast, brightness, depths] = [contrast, brightness, depths].map(tenths);
    println!("tenths: contrast {contrast:.3?}, brightness {brightness:.2?}, far over near {depths:.1?}");
    assert!(contrast[0] > 0.05 && brightness[0] < 0.45 && brightness[2] > 0.5 && depths[2] > 5.0);
}

/// A point lies at the depth that its view has there.
#[test]
fn points_lie_on_depth() {
    for (seed, scene) in SCENES.iter().enumerate().take(40) {
        for (view, visible) in scene.views.iter().zip(&scene.visible) {
            let mut own = 0;
            for &point in visible {
                let local = view.camera.pose.apply(scene.points[point as usize]);
                let pixel = view.camera.intrinsics.project(local);
                let cell = pixel.floor();
                // Only the points sampled for this view lie at a pixel's center.
                if pixel.distance(cell + DVec2::splat(0.5)) < 1e-5 {
                    let depth = view.depth.as_ref().unwrap()[cell.y as usize * OPTIONS.width + cell.x as usize];
                    assert!((f64::from(depth) / local.z - 1.0).abs() < 1e-6, "seed {seed}: {depth} and {}", local.z);
                    own += 1;
                }
            }
            assert!(own > 0 || sky(view) > 0.3, "seed {seed}: view {} has no points", view.name);
        }
    }
}

#[test]
fn the_unseen_set_is_neither_trivial_nor_hopeless() {
    let set = varied_unseen_set(64, 48);
    assert_eq!((set.len(), set[0].held_out_views().len()), (8, 6));
    let (copied, color) = (nearest_copied(&set), mean_color(&set));
    println!("varied set: nearest view {copied:.2} dB, mean color {color:.2} dB");
    assert!((14.0..21.0).contains(&copied));
}
