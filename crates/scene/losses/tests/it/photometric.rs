//! The fused photometric loss against the ops on the tape, finite differences, and its known values.

use proptest::prelude::*;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::Input;
use weaver_losses::{Photometric, PhotometricValue, ssim};

fn image(seed: u64, [height, width]: [usize; 2]) -> Vec<f64> {
    Input::uniform(seed, 0.0, 1.0, [height, width, 3]).data
}

fn fused(a: &[f64], b: &[f64], size: [usize; 2], weight: f64) -> (PhotometricValue, Vec<f64>) {
    let mut gradient = vec![f64::NAN; a.len()];
    (Photometric::new().value_and_gradient(a, b, size, weight, &mut gradient), gradient)
}

/// The same of ops on the tape: mean |d|, SSIM and loss, and the gradient of the loss.
fn slow_twin(a: &[f64], b: &[f64], [height, width]: [usize; 2], weight: f64) -> ([f64; 3], Vec<f64>) {
    let tape = Tape::<f64>::new();
    let planes = |image: &[f64]| -> Vec<f64> {
        (0..3).flat_map(|c| image.iter().skip(c).step_by(3).copied().collect::<Vec<_>>()).collect()
    };
    let shape = [1, 3, height, width];
    let (a, b) = (tape.leaf(&planes(a), shape), tape.constant(&planes(b), shape));
    let l1 = (a - b).abs().mean();
    let similarity = (height >= 11 && width >= 11).then(|| ssim(a, b).mean());
    let loss = match similarity {
        Some(similarity) => l1 * (1.0 - weight) + (similarity * -1.0 + 1.0) * weight,
        None => l1,
    };
    loss.backward();
    let by_plane = a.grad().unwrap();
    let gradient = (0..by_plane.len()).map(|i| by_plane[i % 3 * height * width + i / 3]).collect();
    ([l1.item(), similarity.map_or(f64::NAN, |s| s.item()), loss.item()], gradient)
}

fn assert_equals_its_twin(size: [usize; 2], weight: f64, seed: u64) {
    let (a, mut b) = (image(seed, size), image(!seed, size));
    // Also where the images are nearly and where they are quite equal.
    let third = a.len() / 3;
    (0..third).for_each(|i| b[i] = a[i]);
    (third..2 * third).for_each(|i| b[i] = a[i] + 1e-3 * (b[i] - 0.5));
    let (value, gradient) = fused(&a, &b, size, weight);
    let ([l1, similarity, loss], expected) = slow_twin(&a, &b, size, weight);
    assert!((value.l1 - l1).abs() < 1e-13 && (value.loss - loss).abs() < 1e-12, "{size:?}: {value:?}, {loss}");
    match value.ssim {
        Some(value) => assert!((value - similarity).abs() < 1e-12, "{size:?}: {value} against {similarity}"),
        None => assert!(similarity.is_nan(), "{size:?} has windows"),
    }
    let scale = expected.iter().fold(0.0, |m: f64, g| m.max(g.abs()));
    for (i, (g, e)) in gradient.iter().zip(&expected).enumerate() {
        assert!((g - e).abs() <= 1e-10 * scale, "{size:?}, weight {weight}, number {i}: {g} against {e}");
    }
}

#[test]
fn equals_its_slow_twin_at_the_edges() {
    for size in [[11, 11], [11, 12], [12, 11], [10, 30], [30, 10], [1, 1], [11, 200], [140, 11], [64, 16], [65, 17]] {
        for weight in [0.0, 0.2, 1.0] {
            assert_equals_its_twin(size, weight, 5);
        }
    }
    for height in [63, 73, 74, 75, 128, 129, 138, 139] {
        assert_equals_its_twin([height, 13], 0.2, height as u64);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 16))]

    #[test]
    fn equals_its_slow_twin(h in 8..150usize, w in 8..60usize, weight in 0.0..1.0, seed in any::<u64>()) {
        assert_equals_its_twin([h, w], weight, seed);
    }

    #[test]
    fn gradient(h in 9..80usize, w in 9..20usize, weight in 0.0..1.0, seed in any::<u64>()) {
        // Differences are kept away from 0, where |d| has a kink.
        let b = image(!seed, [h, w]);
        let mut a: Vec<f64> = image(seed, [h, w]).iter().zip(&b).map(|(a, b)| b + (a - 0.5) + (a - 0.5).signum() * 0.01).collect();
        let (_, gradient) = fused(&a, &b, [h, w], weight);
        for probe in 0..12 {
            let at = (seed as usize).wrapping_add(probe * 7919) % a.len();
            let (x, step) = (a[at], 1e-5);
            let mut at_step = |step| {
                a[at] = x + step;
                fused(&a, &b, [h, w], weight).0.loss
            };
            let slope = (at_step(step) - at_step(-step)) / (2.0 * step);
            a[at] = x;
            let size = (h * w * 3) as f64;
            prop_assert!((slope - gradient[at]).abs() * size < 1e-5, "{slope} against {}", gradient[at]);
        }
    }
}

#[test]
fn equal_images_have_no_loss_and_no_gradient() {
    let size = [70, 33];
    let photo: Vec<f32> = image(3, size).iter().map(|x| *x as f32).collect();
    let mut gradient = vec![f32::NAN; photo.len()];
    let value = Photometric::new().value_and_gradient(&photo, &photo, size, 0.2, &mut gradient);
    assert_eq!(value, PhotometricValue { l1: 0.0, ssim: Some(1.0), loss: 0.0 });
    assert!(gradient.iter().all(|g| *g == 0.0));
}

#[test]
fn single_precision_is_as_good_near_the_end_of_a_fit() {
    let size = [80, 41];
    let target: Vec<f32> = image(3, size).iter().map(|x| *x as f32).collect();
    let drawn: Vec<f32> = target.iter().zip(image(4, size)).map(|(t, n)| t + 1e-4 * (n as f32 - 0.5)).collect();
    let mut gradient = vec![0.0; drawn.len()];
    let value = Photometric::new().value_and_gradient(&drawn, &target, size, 1.0, &mut gradient);
    let widen = |x: &[f32]| x.iter().map(|x| f64::from(*x)).collect::<Vec<_>>();
    let (expected, exact) = fused(&widen(&drawn), &widen(&target), size, 1.0);
    assert!((value.loss / expected.loss - 1.0).abs() < 1e-4, "{value:?} against {expected:?}");
    let scale = exact.iter().fold(0.0, |m: f64, g| m.max(g.abs()));
    for (g, e) in gradient.iter().zip(&exact) {
        assert!((f64::from(*g) - e).abs() < 1e-5 * scale, "{g} against {e}");
    }
}

#[test]
fn a_broken_image_has_no_number_for_a_loss() {
    for size in [[5, 40], [30, 12], [80, 20]] {
        let target = image(1, size);
        for at in [0, target.len() / 2, target.len() - 1] {
            let mut drawn = image(2, size);
            drawn[at] = f64::NAN;
            for weight in [0.0, 0.2, 1.0] {
                assert!(fused(&drawn, &target, size, weight).0.loss.is_nan());
            }
        }
    }
}

/// Same bits at any number of threads and in used memory.
#[test]
fn same_bits_at_any_threads_and_in_used_memory() {
    let sizes = [[200, 50], [11, 11], [131, 29], [5, 5]];
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut loss = Photometric::new();
        let mut of = |size| {
            let [a, b] = [7, 8].map(|seed| image(seed, size).iter().map(|x| *x as f32).collect::<Vec<_>>());
            let mut gradient = vec![0.0; a.len()];
            let value = pool.install(|| loss.value_and_gradient(&a, &b, size, 0.2, &mut gradient));
            (value, gradient.iter().map(|g| g.to_bits()).collect::<Vec<_>>())
        };
        [sizes.map(&mut of), sizes.map(&mut of)]
    };
    let one = run(1);
    assert_eq!(one[0], one[1]);
    assert!(run(2) == one && run(3) == one);
}

#[test]
fn a_repeated_call_allocates_nothing() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let (a, b) = (image(1, [150, 40]), image(2, [150, 40]));
    let mut gradient = vec![0.0; a.len()];
    let mut loss = Photometric::new();
    let count = pool.install(|| {
        let mut call = || loss.value_and_gradient(&a, &b, [150, 40], 0.2, &mut gradient);
        call();
        allocation_counter::measure(|| {
            call();
        })
        .count_total
    });
    assert_eq!(count, 0);
}
