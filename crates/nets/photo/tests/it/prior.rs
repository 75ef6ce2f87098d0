//! Filled maps and the network's input.

use crate::Drawn;
use proptest::prelude::*;
use weaver_geometry::glam::DVec2;
use weaver_kernels::random::Stream;
use weaver_photo::{CHANNELS, Comparison, PATCH, Prior, filled};

proptest! {
    /// Known pixels keep their values, others are between the known ones, and confidence says which is which.
    #[test]
    fn filled_pixels_lie_between_known_ones(v in 1..3usize, h in 1..20usize, w in 1..20usize, seed in any::<u64>()) {
        let stream = Stream::new(seed, 0, "filled");
        let values: Vec<f32> = (0..v * h * w).map(|i| stream.normal(i as u64)).collect();
        let known: Vec<bool> = (0..v * h * w).map(|i| stream.fork(1).uniform::<f64>(i as u64) < 0.2).collect();
        let map = filled(&values, &known, [h, w], 7.0);
        for view in 0..v {
            let of = view * h * w..(view + 1) * h * w;
            let told: Vec<f32> = of.clone().filter(|i| known[*i]).map(|i| values[i]).collect();
            let (low, high) = told.iter().fold((f32::MAX, f32::MIN), |(a, b), x| (a.min(*x), b.max(*x)));
            for i in of {
                match (told.is_empty(), known[i]) {
                    (true, _) => prop_assert_eq!([map.values[i], map.confidence[i]], [7.0, 0.0]),
                    (_, true) => prop_assert_eq!([map.values[i], map.confidence[i]], [values[i], 1.0]),
                    _ => {
                        prop_assert!(map.values[i] >= low - 1e-4 && map.values[i] <= high + 1e-4);
                        prop_assert!(map.confidence[i] > 0.0 && map.confidence[i] < 1.0);
                    }
                }
            }
        }
    }

    /// The input beside a slow twin: every channel of every pixel, found anew from the cameras.
    #[test]
    fn the_input_is_photos_depth_neighbors_and_rays(h in 9..40usize, w in 9..40usize, seed in 0..50u64) {
        let drawn = Drawn::new(seed, [h, w], 3);
        let comparison = Comparison::simulated(drawn.photos(), &drawn.cameras, &drawn.depth, Stream::new(seed, 0, ""));
        let prior = Prior::new(drawn.photos(), &drawn.cameras, &comparison);
        let [rows, columns] = [h, w].map(|n| n.div_ceil(PATCH) * PATCH);
        prop_assert_eq!(prior.input.len(), 3 * CHANNELS * rows * columns);
        let mirrored = |at: usize, n: usize| if at < n { at } else { 2 * (n - 1) - at };
        for view in 0..3 {
            let at = |channel: usize, y: usize, x: usize| {
                prior.input[((view * CHANNELS + channel) * rows + y) * columns + x]
            };
            for (y, x) in (0..rows).flat_map(|y| (0..columns).map(move |x| (y, x))) {
                let (row, column) = (mirrored(y, h), mirrored(x, w));
                let pixel = row * w + column;
                for c in 0..3 {
                    prop_assert_eq!(at(c, y, x), drawn.planes[(3 * view + c) * h * w + pixel]);
                }
                let l = prior.log_depth[view * h * w + pixel];
                prop_assert_eq!([at(3, y, x), at(4, y, x)], [l, prior.confidence[view * h * w + pixel]]);
                let center = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
                let ray = drawn.cameras[view].intrinsics.unproject(center, 1.0);
                prop_assert!((f64::from(at(15, y, x)) - ray.x).abs() + (f64::from(at(16, y, x)) - ray.y).abs() < 1e-6);
                // A neighbor's color lies between those of its pixels around the point.
                let world = prior.cameras[view].pose.inverse().apply(ray * f64::from(l).exp());
                let inside = |other: usize| {
                    let local = prior.cameras[other].pose.apply(world);
                    let p = drawn.cameras[other].intrinsics.project(local);
                    let near = |n: f64, side: usize| n > 1e-6 && n < side as f64 - 1e-6;
                    (local.z > 0.0 && near(p.x, w) && near(p.y, h)).then_some(p)
                };
                for slot in 0..2 {
                    let seen = at(5 + 5 * slot + 4, y, x);
                    prop_assert!(seen == 0.0 || seen == 1.0);
                    if seen > 0.0 {
                        let shown = [0, 1, 2].map(|c| at(5 + 5 * slot + c, y, x));
                        let fits = (0..3).filter(|other| *other != view).any(|other| {
                            inside(other).is_none_or(|p| (0..3).all(|c| {
                                let plane = &drawn.planes[(3 * other + c) * h * w..][..h * w];
                                let split = |x: f64, n: usize| {
                                    let x = (x - 0.5).clamp(0.0, n as f64 - 1.0);
                                    (x.floor() as usize, x.ceil() as usize)
                                };
                                let ((l, r), (t, b)) = (split(p.x, w), split(p.y, h));
                                let around = [t * w + l, t * w + r, b * w + l, b * w + r].map(|i| plane[i]);
                                let low = around.iter().fold(f32::MAX, |a, x| a.min(*x));
                                let high = around.iter().fold(f32::MIN, |a, x| a.max(*x));
                                (low - 1e-3..=high + 1e-3).contains(&shown[c])
                            }))
                        });
                        prop_assert!(fits, "view {}, pixel {}, slot {}", view, pixel, slot);
                    }
                }
            }
        }
    }
}

/// Where photos overlap, their colors on the right depth are alike.
#[test]
fn neighbors_look_alike() {
    let drawn = Drawn::new(4, [48, 64], 3);
    let comparison = Comparison { depth: drawn.depth.clone() };
    let prior = Prior::new(drawn.photos(), &drawn.cameras, &comparison);
    let plane = |channel: usize| &prior.input[channel * 48 * 64..][..48 * 64];
    let seen: Vec<usize> = (0..48 * 64).filter(|at| plane(9)[*at] > 0.0 && drawn.depth[*at] > 0.0).collect();
    let difference = seen.iter().map(|at| plane(8)[*at]).sum::<f32>() / seen.len() as f32;
    assert!(seen.len() > 500 && difference < 0.06, "{} pixels, difference {difference}", seen.len());
}

/// Lengths are in units of the median depth: the same scene in other units is the same input.
#[test]
fn units_do_not_matter() {
    let drawn = Drawn::new(4, [24, 40], 3);
    let comparison = Comparison::simulated(drawn.photos(), &drawn.cameras, &drawn.depth, Stream::new(0, 0, ""));
    let prior = Prior::new(drawn.photos(), &drawn.cameras, &comparison);
    let larger: Vec<_> = drawn
        .cameras
        .iter()
        .map(|camera| weaver_geometry::Camera { pose: camera.pose.scaled(8.0), ..*camera })
        .collect();
    let depth = comparison.depth.iter().map(|z| 8.0 * z).collect();
    let other = Prior::new(drawn.photos(), &larger, &Comparison { depth });
    assert_eq!(other.scale, 8.0 * prior.scale);
    assert!(other.input.iter().zip(&prior.input).all(|(a, b)| (a - b).abs() < 1e-5));
}
