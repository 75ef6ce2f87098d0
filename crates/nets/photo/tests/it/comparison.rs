//! Comparison of photos, and how it is simulated.

use crate::Drawn;
use weaver_kernels::random::Stream;
use weaver_photo::Comparison;

/// Errors of log depth, sorted, and the part of the pixels of known truth that are found.
fn judged(found: &Comparison, truth: &[f32]) -> (Vec<f32>, f64) {
    let pairs = found.depth.iter().zip(truth).filter(|(z, truth)| **z > 0.0 && z.is_finite() && **truth > 0.0);
    let mut errors: Vec<f32> = pairs.map(|(z, truth)| (z / truth).ln().abs()).collect();
    errors.sort_by(f32::total_cmp);
    let known = truth.iter().filter(|z| **z > 0.0).count();
    let part = errors.len() as f64 / known as f64;
    (errors, part)
}

/// Over drawn scenes, simulated comparison finds about as much as the real one, and is as exact.
///
/// Promise (results): the comparison that the photo network is trained on stands for the real one: coverage within a
/// factor of 1.6, median error within a factor of 3.
#[test]
fn simulated_comparison_stands_for_the_real_one() {
    let (mut real, mut drawn) = ((Vec::new(), 0.0), (Vec::new(), 0.0));
    let scenes = 6;
    for seed in 0..scenes {
        let scene = Drawn::new(seed, [72, 96], 4);
        let points = scene.scene.points_seen(&[0, 1, 2, 3], 1.0);
        let found = Comparison::of(scene.photos(), &scene.cameras, &points).unwrap();
        let simulated =
            Comparison::simulated(scene.photos(), &scene.cameras, &scene.depth, Stream::new(seed, 0, "test"));
        for (sum, found) in [(&mut real, found), (&mut drawn, simulated)] {
            let (errors, part) = judged(&found, &scene.depth);
            sum.0.extend(errors);
            sum.1 += part / scenes as f64;
        }
    }
    let median = |errors: &mut Vec<f32>| {
        errors.sort_by(f32::total_cmp);
        f64::from(errors[errors.len() / 2])
    };
    let [of_real, of_drawn] = [&mut real.0, &mut drawn.0].map(median);
    println!("coverage {:.2} and {:.2}, median errors {of_real:.5} and {of_drawn:.5}", real.1, drawn.1);
    assert!((1.0 / 1.6..1.6).contains(&(drawn.1 / real.1)), "{} and {}", real.1, drawn.1);
    assert!((1.0 / 3.0..3.0).contains(&(of_drawn / of_real)), "{of_real} and {of_drawn}");
}

/// Two photos have no third to agree with: only points are known of them.
#[test]
fn two_photos_have_points_alone() {
    let scene = Drawn::new(2, [48, 64], 2);
    let points = scene.scene.points_seen(&[0, 1], 1.0);
    let real = Comparison::of(scene.photos(), &scene.cameras, &points).unwrap();
    let seen: usize = points.visible.iter().map(Vec::len).sum();
    let known = real.depth.iter().filter(|z| **z > 0.0).count();
    assert!(known > 0 && known <= seen, "{known} of {seen}");
    let simulated = Comparison::simulated(scene.photos(), &scene.cameras, &scene.depth, Stream::new(0, 0, ""));
    assert!(simulated.coverage() < 0.02, "{}", simulated.coverage());
}

/// The same stream draws the same comparison at any number of threads, another one another.
#[test]
fn a_stream_draws_one_comparison() {
    let scene = Drawn::new(5, [36, 48], 3);
    let draw = |seed, threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let stream = Stream::new(seed, 0, "");
        pool.install(|| Comparison::simulated(scene.photos(), &scene.cameras, &scene.depth, stream))
    };
    assert!(draw(1, 1) == draw(1, 3));
    assert!(draw(1, 1) != draw(2, 1));
    assert_eq!(scene.pixels(), 36 * 48);
}
