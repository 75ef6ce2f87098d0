//! One feature per cluster: kept masks, by hand.

use weaver_lift::{AggregateOptions, Dense, Mask, aggregate, label_maps, metrics};

/// Three Gaussians side by side in one row of twelve pixels, in two views; the last pixel is empty.
fn row() -> Dense<f64> {
    let mut weights = vec![0.0; 2 * 12 * 3];
    for pixel in (0..24).filter(|pixel| pixel % 12 < 11) {
        weights[3 * pixel + pixel % 12 / 4] = 0.9;
    }
    Dense::new(weights, 3, 2).unwrap()
}

fn mask(view: usize, pixels: std::ops::Range<u32>, feature: [f64; 2]) -> Mask<f64> {
    Mask { view, pixels: pixels.collect(), feature: feature.to_vec() }
}

#[test]
fn labels_are_drawn() {
    for block in [1, 2, 64] {
        let maps = label_maps(&mut row(), &[Some(1), None, Some(0)], block).unwrap();
        assert_eq!(maps[0], [2, 2, 2, 2, 0, 0, 0, 0, 1, 1, 1, 0]);
        assert_eq!(maps[0], maps[1]);
    }
    assert!(label_maps(&mut row(), &[None], 1).is_err());
}

/// Masks that agree with a cluster give it their feature.
#[test]
fn masks_give_clusters_their_feature() {
    let labels = [Some(1), None, Some(0)];
    let mut features = vec![3.0, 4.0, 0.0, 2.0, 5.0, 0.0];
    let masks = [
        mask(0, 0..4, [1.0, 0.0]),  // the whole of cluster 1
        mask(1, 0..5, [0.0, 1.0]),  // 4 of 5: an overlap of 0.8 is not above it
        mask(1, 1..4, [0.0, 1.0]),  // 3 of 4
        mask(0, 4..8, [9.0, 9.0]),  // noise
        mask(1, 0..4, [1.0, 1.0]),  // the whole of it, from another view
        mask(0, 0..12, [7.0, 7.0]), // everything
    ];
    let done = aggregate(&mut row(), &labels, &masks, &mut features, &AggregateOptions::default()).unwrap();
    assert_eq!(done.kept, [true, false, false, false, true, false]);
    assert_eq!((done.clusters, done.without), (2, 1));
    let length = 1.0_f64.hypot(0.5);
    let expected = [1.0 / length, 0.5 / length, 0.0, 1.0, 1.0, 0.0];
    assert!(features.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{features:?}");

    let beyond = [mask(0, 11..13, [1.0, 0.0])];
    assert!(aggregate(&mut row(), &labels, &beyond, &mut features, &AggregateOptions::default()).is_err());
    let nowhere = [mask(2, 0..1, [1.0, 0.0])];
    assert!(aggregate(&mut row(), &labels, &nowhere, &mut features, &AggregateOptions::default()).is_err());
}

/// A mask shifted by d columns has the overlap counted by hand.
#[test]
fn figures_are_those_counted_by_hand() {
    let (width, height, left, right) = (20, 9, 5, 13);
    let box_at = |shift: usize| -> Vec<u32> {
        (0..width * height).map(|i| u32::from((left + shift..right + shift).contains(&(i % width)))).collect()
    };
    let truth = box_at(0);
    assert_eq!(metrics::mean_iou(&truth, &truth, 8), Some(1.0));
    assert_eq!(metrics::accuracy(&truth, &truth), 1.0);
    for shift in 1..5 {
        let (wide, shift_) = ((right - left) as f64, shift as f64);
        let inside = (wide - shift_) / (wide + shift_);
        let outside = (width as f64 - wide - shift_) / (width as f64 - wide + shift_);
        let found = metrics::mean_iou(&box_at(shift), &truth, 8).unwrap();
        assert!((found - (inside + outside) / 2.0).abs() < 1e-12, "{shift}: {found}");
        assert!((metrics::accuracy(&box_at(shift), &truth) - (1.0 - 2.0 * shift_ / width as f64)).abs() < 1e-12);
    }
    // Small classes do not count, and a class that is only predicted is none.
    assert_eq!(metrics::mean_iou(&[1, 1, 2, 3], &[1, 1, 2, 2], 2), Some(0.75));
    assert_eq!(metrics::mean_iou(&[0], &[0], 8), None);
    assert_eq!(metrics::cosine(&[1.0, 0.0], &[0.0, 0.0]), 0.0);
    assert!((metrics::cosine(&[1.0, 1.0], &[0.0, 2.0]) - 0.5_f64.sqrt()).abs() < 1e-12);
}
