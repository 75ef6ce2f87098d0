//! Starts of fits: cells of the quadtree, published positions, closed colors.

use crate::random::{error, gaussians, picture};
use proptest::prelude::*;
use weaver_image::{CUT, Picture, Start, Window, quadtree, solve_colors, start};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 16))]

    #[test]
    fn leaves_tile_the_picture(seed: u64, width in 1_usize..40, height in 1_usize..40, count in 1_usize..200) {
        let picture = picture(seed, width, height);
        let leaves = quadtree(&picture, count);
        prop_assert_eq!(leaves.len(), count.min(width * height));
        let mut covered = vec![0; width * height];
        for leaf in &leaves {
            let Window { x, y, width: w, height: h } = leaf.cell;
            let mut mean = [0.0; 3];
            for p in (y..y + h).flat_map(|y| (x..x + w).map(move |x| y * width + x)) {
                covered[p] += 1;
                (0..3).for_each(|c| mean[c] += picture.colors()[3 * p + c] / (w * h) as f32);
            }
            prop_assert!((0..3).all(|c| (mean[c] - leaf.mean[c]).abs() < 1e-4));
        }
        prop_assert!(covered.iter().all(|n| *n == 1));
        let left = |count| quadtree(&picture, count).iter().map(|leaf| leaf.deviation).sum::<f64>();
        prop_assert!(left(count + 1) <= left(count) + 1e-9);
    }

    #[test]
    fn closed_colors_are_least_squares(seed: u64) {
        let picture = picture(seed, 24, 20);
        let mut few = gaussians::<f32>(seed, 5, [24, 20], [2.0, 6.0]);
        let mut before = error(&picture, &few);
        for _ in 0..6 {
            solve_colors(&picture, &mut few, CUT, 1).unwrap();
            let after = error(&picture, &few);
            prop_assert!(after <= before * (1.0 + 1e-5), "{} after {}", after, before);
            before = after;
        }
        // At the minimum no color's change helps.
        solve_colors(&picture, &mut few, CUT, 60).unwrap();
        let least = error(&picture, &few);
        for i in 0..few.colors.len() {
            for change in [-0.01, 0.01] {
                let mut other = few.clone();
                other.colors[i] += change;
                prop_assert!(error(&picture, &other) > least - 1e-8);
            }
        }
    }
}

#[test]
fn a_constant_picture_splits_by_area() {
    let picture = Picture::new(64, 48, vec![0.4; 64 * 48 * 3]).unwrap();
    let areas: Vec<usize> = quadtree(&picture, 100).iter().map(|leaf| leaf.cell.pixels()).collect();
    let (low, high) = (areas.iter().min().unwrap(), areas.iter().max().unwrap());
    assert!(*high <= 2 * low + 2, "{low} {high}");
}

#[test]
fn published_positions_follow_edges() {
    let colors = (0..96 * 96).flat_map(|p| [if p % 96 < 48 { 0.1 } else { 0.9 }; 3]).collect();
    let placed = start(&Picture::new(96, 96, colors).unwrap(), 100, Start::Published, 3);
    assert!(placed.len() <= 100 && placed.len() > 90);
    // The frame does not count as an edge.
    let (mut edge, mut inside) = (0, 0);
    for center in placed.centers.chunks_exact(2).take(70) {
        edge += usize::from((center[0] - 48.0).abs() < 4.0);
        inside += usize::from((center[1] - 48.0).abs() < 40.0);
    }
    assert_eq!(edge, 70);
    assert!(inside > 45, "{inside}");
    assert_eq!(placed.angles[0], std::f32::consts::PI);
    // On either side the median is that side's color.
    let side = placed.centers.chunks_exact(2).zip(placed.colors.chunks_exact(3)).skip(70);
    for (center, color) in side.filter(|(center, _)| (center[0] - 48.0).abs() > 20.0) {
        assert!((color[0] - if center[0] < 48.0 { 0.1 } else { 0.9 }).abs() < 1e-6);
    }
}

#[test]
fn few_gaussians_are_placed_too() {
    let picture = picture(5, 9, 7);
    for kind in [Start::Random, Start::Positions, Start::Scales, Start::Published, Start::Quadtree] {
        for count in 1..6 {
            let placed = start(&picture, count, kind, 0);
            placed.check().unwrap();
            assert!((1..=count).contains(&placed.len()) || count < 2, "{kind:?} {count} {}", placed.len());
        }
    }
}

#[test]
fn a_wide_picture_is_placed_in_parts() {
    let picture = picture(6, 1100, 8);
    let placed = start(&picture, 600, Start::Published, 1);
    placed.check().unwrap();
    let left = placed.centers.chunks_exact(2).filter(|center| center[0] < 76.0).count();
    assert!(left > 0 && left < 60 && placed.len() > 500);
}
