//! Tiles and lists against a dense loop.

use crate::scene::{camera, draw, poses, shell, sight};
use proptest::prelude::*;
use weaver_kernels::Real;
use weaver_surfel::reference;

/// The largest difference relative to 1 + |expected|.
fn difference<T: Real>(found: &[T], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let pairs = found.iter().zip(expected);
    pairs.map(|(a, b)| (a.to_f64() - b).abs() / (1.0 + b.abs())).fold(0.0, f64::max)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 10))]

    #[test]
    fn images_are_those_of_the_twin(
        seed in 0_u64..1000, n in 0_usize..60, width in 1_usize..70, height in 1_usize..40, spherical: bool, views in 1_usize..3,
    ) {
        let (surfels, camera) = (shell::<f64>(seed, n, 0.4), camera(spherical, [width, height]));
        let poses = poses(seed, views);
        let sight = sight(&surfels, &camera, &poses);
        let (mut workspace, images) = draw(&sight);
        let expected = reference::draw(&sight);
        let (mut median, mut distortion) = (expected.median.clone(), expected.distortion.clone());
        workspace.ranges(&sight, &mut median, &mut distortion);
        for (found, expected) in [
            (&images.range, &expected.images.range),
            (&images.opacity, &expected.images.opacity),
            (&images.normal, &expected.images.normal),
            (&median, &expected.median),
            (&distortion, &expected.distortion),
        ] {
            let difference = difference(found, expected);
            prop_assert!(difference < 1e-9, "{difference}");
        }
    }
}

#[test]
fn single_precision_is_near() {
    for (spherical, seed) in [(true, 1), (true, 2), (false, 3)] {
        let (surfels, single) = (shell::<f64>(seed, 200, 0.3), shell::<f32>(seed, 200, 0.3));
        let (camera, poses) = (camera(spherical, [128, 64]), poses(seed, 1));
        let expected = reference::draw(&sight(&surfels, &camera, &poses)).images;
        let (_, images) = draw(&sight(&single, &camera, &poses));
        let far = images.opacity.iter().zip(&expected.opacity).filter(|(a, b)| (a.to_f64() - *b).abs() > 1e-3).count();
        assert!(far <= expected.opacity.len() / 500, "{far} pixels differ");
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let (surfels, camera, poses) = (shell::<f32>(5, 3000, 0.1), camera(true, [256, 64]), poses(5, 1));
    let sight = sight(&surfels, &camera, &poses);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let (mut workspace, images) = draw(&sight);
            let (mut gradients, mut pose) = (Default::default(), [[0.0; 6]]);
            let cotangents = weaver_surfel::RangeCotangents {
                range: Some(&images.opacity),
                opacity: Some(&images.range),
                normal: Some(&images.normal),
            };
            workspace.backward(&sight, &cotangents, &mut gradients, Some(&mut pose));
            (images, gradients, pose)
        })
    };
    assert_eq!(run(1), run(3));
}
