//! Which pixels get Gaussians where several photos show a place.

use crate::Drawn;
use weaver_geometry::glam::DVec2;
use weaver_photo::DepthMaps;

/// With true depth, every place that photos show is kept in some photo, and most are kept once.
///
/// Promise (results): places that several photos show are given Gaussians once, and no place is lost by that.
#[test]
fn places_are_kept_once() {
    for seed in [0, 1, 4] {
        let drawn = Drawn::new(seed, [36, 48], 4);
        let log_depth: Vec<f32> = drawn.depth.iter().map(|z| if *z > 0.0 { z.ln() } else { 3.0 }).collect();
        let log_spread = vec![0.01_f32.ln(); log_depth.len()];
        let maps = DepthMaps { log_depth: &log_depth, log_spread: &log_spread, cameras: &drawn.cameras, inside: None };
        let kept = maps.kept();
        let (pixels, [height, width]) = (drawn.pixels(), drawn.size);
        let (mut lost, mut places) = (0, 0);
        for at in (0..log_depth.len()).filter(|at| drawn.depth[*at] > 0.0 && !kept[*at]) {
            let camera = &drawn.cameras[at / pixels];
            let center = DVec2::new((at % width) as f64 + 0.5, (at / width % height) as f64 + 0.5);
            let world = camera.unproject(center, f64::from(drawn.depth[at]));
            // Around where another photo shows the place, a pixel of about its depth is kept.
            let found = (0..4).filter(|other| *other != at / pixels).any(|other| {
                let local = drawn.cameras[other].pose.apply(world);
                let p = drawn.cameras[other].intrinsics.project(local);
                let [x, y] = [p.x.floor() as isize, p.y.floor() as isize];
                (-2..=2).flat_map(|dy| (-2..=2).map(move |dx| (x + dx, y + dy))).any(|(x, y)| {
                    let inside = local.z > 0.0 && x >= 0 && y >= 0 && (x as usize) < width && (y as usize) < height;
                    inside && {
                        let there = other * pixels + y as usize * width + x as usize;
                        kept[there] && (f64::from(drawn.depth[there]) / local.z).ln().abs() < 0.1
                    }
                })
            });
            places += 1;
            lost += usize::from(!found);
        }
        assert!(places > 500, "seed {seed}: only {places} pixels are left out");
        assert!(lost * 50 < places, "seed {seed}: {lost} of {places} places that are left out are nowhere");
    }
}

/// A surface that two photos see through is given up where its depth is less sure than theirs.
#[test]
fn what_photos_see_through_is_given_up() {
    let drawn = Drawn::new(1, [36, 48], 4);
    let mut log_depth: Vec<f32> = drawn.depth.iter().map(|z| if *z > 0.0 { z.ln() } else { 3.0 }).collect();
    let mut log_spread = vec![0.01_f32.ln(); log_depth.len()];
    // A quarter of the first photo is said to be half as far as it is, and not to be sure of that.
    let wrong: Vec<usize> = (0..drawn.pixels()).filter(|at| at % 48 < 24 && at / 48 < 18).collect();
    wrong.iter().for_each(|at| (log_depth[*at], log_spread[*at]) = (log_depth[*at] - 0.7, 0.05_f32.ln()));
    let inside = vec![true; log_depth.len()];
    let maps = |inside| DepthMaps { log_depth: &log_depth, log_spread: &log_spread, cameras: &drawn.cameras, inside };
    let kept = maps(None).kept();
    assert_eq!(kept, maps(Some(&inside)).kept());
    let left = wrong.iter().filter(|at| kept[**at]).count();
    assert!(left * 2 < wrong.len(), "{left} of {} are left", wrong.len());
    // Masked pixels are never kept, and count for nothing.
    let alone: Vec<bool> = (0..log_depth.len()).map(|at| at < drawn.pixels()).collect();
    assert_eq!(maps(Some(&alone)).kept(), alone);
}
