//! Principal components and clusters against scikit-learn's and hdbscan's of the same points.

use proptest::prelude::*;
use std::collections::BTreeMap;
use weaver_fixtures::Fixture;
use weaver_kernels::random::Stream;
use weaver_lift::{ClusterOptions, HdbscanOptions, Pca, cluster, hdbscan};

/// True if two labelings are equal up to the numbers of clusters.
fn same(a: &[Option<u32>], b: &[Option<u32>]) -> bool {
    let pairs = |a: &[Option<u32>], b: &[Option<u32>]| {
        let mut names = BTreeMap::new();
        a.iter().zip(b).all(|(a, b)| a.is_none() == b.is_none() && *names.entry(*a).or_insert(*b) == *b)
    };
    a.len() == b.len() && pairs(a, b) && pairs(b, a)
}

#[test]
fn components_are_those_of_scikit_learn() {
    let file = Fixture::open("clusters.safetensors");
    let points = file.f64("in.points");
    let pca = Pca::of(&points, 12, 5);
    assert_eq!(pca.components(), 5);
    let close = |found: &[f64], key: &str, bar: f64| {
        let expected = file.f64(key);
        assert_eq!(found.len(), expected.len(), "{key}");
        let worst = found.iter().zip(expected).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())).fold(0.0, f64::max);
        assert!(worst < bar, "{key}: {worst}");
    };
    close(&pca.mean, "out.pca.mean", 1e-6);
    close(&pca.variances, "out.pca.variances", 1e-6);
    close(&pca.axes, "out.pca.axes", 1e-5);
    close(&pca.project(&points), "out.pca.projected", 1e-5);
    // In single precision, too.
    let single: Vec<f32> = points.iter().map(|x| *x as f32).collect();
    close(&Pca::of(&single, 12, 5).axes, "out.pca.axes", 1e-5);
}

/// A set of points, their dimensions, and smallest clusters with numbers of samples.
type Case = (&'static str, usize, &'static [(usize, usize)]);

#[test]
fn clusters_are_those_of_hdbscan() {
    let file = Fixture::open("clusters.safetensors");
    let cases: [Case; 3] = [
        ("points", 12, &[(10, 10), (25, 10)]),
        ("moons", 2, &[(8, 5), (10, 10), (25, 10), (40, 3)]),
        ("rings", 3, &[(10, 10), (25, 10), (40, 3)]),
    ];
    for (set, dimensions, options) in cases {
        let points = file.f64(&format!("in.{set}"));
        for &(smallest, samples) in options {
            let expected: Vec<Option<u32>> = file
                .f64(&format!("out.labels.{set}.{smallest}.{samples}"))
                .iter()
                .map(|x| (*x >= 0.0).then_some(*x as u32))
                .collect();
            let found = hdbscan(&points, dimensions, &HdbscanOptions { smallest, samples, resolution: 0.0 });
            let count = |labels: &[Option<u32>]| labels.iter().flatten().max().map_or(0, |most| most + 1);
            let (ours, theirs) = (count(&found), count(&expected));
            assert!(found == expected, "{set} {smallest} {samples}: {ours} clusters, expected {theirs}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 16, failure_persistence: None, ..Default::default() })]

    /// Neither the order of points nor the number of threads matters.
    #[test]
    fn clusters_do_not_depend_on_the_order(seed: u64, count in 2_usize..120) {
        let stream = Stream::new(seed, 0, "clusters");
        let at = |i: u64| stream.normal::<f64>(i) + 6.0 * (i / 2 % 3) as f64;
        let points: Vec<f64> = (0..2 * count as u64).map(at).collect();
        let options = HdbscanOptions { smallest: 4, samples: 3, resolution: 0.0 };
        let labels = hdbscan(&points, 2, &options);
        let order = stream.fork(1).permutation(count);
        let shuffled: Vec<f64> = order.iter().flat_map(|i| points[2 * i..2 * i + 2].to_vec()).collect();
        let expected: Vec<Option<u32>> = order.iter().map(|i| labels[*i]).collect();
        prop_assert!(same(&hdbscan(&shuffled, 2, &options), &expected));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        prop_assert_eq!(pool.install(|| hdbscan(&points, 2, &options)), labels);
    }

    /// Axes are orthonormal, and variances belong to them.
    #[test]
    fn axes_are_orthonormal_with_their_variances(seed: u64, channels in 1_usize..9) {
        let stream = Stream::new(seed, 0, "pca");
        let points: Vec<f64> = (0..40 * channels as u64).map(|i| stream.normal::<f64>(i) * (1 + i % 3) as f64).collect();
        let pca = Pca::of(&points, channels, 50);
        prop_assert_eq!(pca.components(), channels);
        for (i, a) in pca.axes.chunks_exact(channels).enumerate() {
            for (j, b) in pca.axes.chunks_exact(channels).enumerate() {
                let dot: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
                prop_assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-12);
            }
        }
        prop_assert!(pca.variances.is_sorted_by(|a, b| a >= b));
        let projected = pca.project(&points);
        for (i, variance) in pca.variances.iter().enumerate() {
            let along: f64 = projected.iter().skip(i).step_by(channels).map(|x| x * x).sum();
            prop_assert!((along / 39.0 - variance).abs() < 1e-10 * (1.0 + variance));
        }
    }
}

#[test]
fn few_points_and_equal_points_are_no_trouble() {
    let options = HdbscanOptions { smallest: 3, samples: 10, resolution: 0.0 };
    assert_eq!(hdbscan(&[], 2, &options), []);
    assert_eq!(hdbscan(&[1.0, 2.0], 2, &options), [None]);
    // All in two places: two clusters; all in one: no cluster falls apart from it.
    let two: Vec<f64> = (0..20).map(|i| f64::from(i % 2)).collect();
    let labels = hdbscan(&two, 1, &HdbscanOptions { smallest: 3, samples: 3, resolution: 0.0 });
    assert!((0..20).all(|i| labels[i] == Some(i as u32 % 2)), "{labels:?}");
    assert!(hdbscan(&[4.0; 20], 1, &options).iter().all(Option::is_none));
    assert_eq!(Pca::of::<f32>(&[], 3, 2).variances, [0.0; 2]);
}

/// Points within rounding of each other are no clusters of their own.
#[test]
fn resolution_keeps_rounding_from_making_clusters() {
    // Two places, each with two groups a hair apart.
    let points: Vec<f64> = (0..80).map(|i| f64::from(i % 2) + f64::from(i / 2 % 2) * 1e-7).collect();
    let found = |resolution| {
        let labels = hdbscan(&points, 1, &HdbscanOptions { smallest: 5, samples: 4, resolution });
        labels.iter().flatten().max().map_or(0, |most| most + 1)
    };
    assert_eq!((found(0.0), found(1e-3)), (4, 2));
}

/// Gaussians that no camera sees are no cluster, however many there are.
#[test]
fn unseen_gaussians_are_noise() {
    let stream = Stream::new(2, 0, "unseen");
    let features: Vec<f64> = (0..120)
        .map(|i| if i < 60 { 0.0 } else { f64::from(i % 2) * 9.0 + 0.1 * stream.normal::<f64>(i as u64) })
        .collect();
    let seen: Vec<f64> = (0..120).map(|i| if i < 60 { 0.0 } else { 1.0 }).collect();
    let options = ClusterOptions {
        hdbscan: HdbscanOptions { smallest: 5, samples: 4, resolution: 0.0 },
        ..ClusterOptions::default()
    };
    let labels = cluster(&features, 1, &seen, &options).unwrap();
    assert!(labels[..60].iter().all(Option::is_none));
    assert!(labels[60..].chunks(2).all(|pair| pair == [Some(0), Some(1)]), "{labels:?}");
    assert!(cluster(&features, 2, &seen, &options).is_err());
}
