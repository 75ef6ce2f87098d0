//! Structural similarity: gradient, slow twin, and its known values.

use proptest::prelude::*;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, Options, gradcheck_with};
use weaver_losses::{Covariance, metrics, ssim, ssim_with, ssim_zero_padded};

/// One window after the other, means first and then centered variances.
fn slow_twin(a: &[f64], b: &[f64], [height, width]: [usize; 2], correction: f64) -> f64 {
    let gauss = |d: usize| (-(d as f64 - 5.0).powi(2) / (2.0 * 1.5 * 1.5)).exp();
    let total: f64 = (0..121).map(|i| gauss(i / 11) * gauss(i % 11)).sum();
    let mut sum = 0.0;
    for (y, x) in (0..height - 10).flat_map(|y| (0..width - 10).map(move |x| (y, x))) {
        let window = || (0..121).map(|i| (gauss(i / 11) * gauss(i % 11) / total, (y + i / 11) * width + x + i % 11));
        let mean = |image: &[f64]| window().map(|(w, at)| w * image[at]).sum::<f64>();
        let (ma, mb) = (mean(a), mean(b));
        let moment = |p: &[f64], mp: f64, q: &[f64], mq: f64| -> f64 {
            correction * window().map(|(w, at)| w * (p[at] - mp) * (q[at] - mq)).sum::<f64>()
        };
        let (va, vb, cab) = (moment(a, ma, a, ma), moment(b, mb, b, mb), moment(a, ma, b, mb));
        sum += (2.0 * ma * mb + 1e-4) * (2.0 * cab + 9e-4) / ((ma * ma + mb * mb + 1e-4) * (va + vb + 9e-4));
    }
    sum / ((height - 10) * (width - 10)) as f64
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 32))]

    #[test]
    fn gradient(n in 1..3usize, h in 11..15usize, w in 11..15usize, sample in any::<bool>(), seed in any::<u64>()) {
        let covariance = if sample { Covariance::Sample } else { Covariance::Population };
        let images = [Input::uniform(seed, 0.0, 1.0, [n, 2, h, w]), Input::uniform(!seed, 0.0, 1.0, [n, 2, h, w])];
        let options = Options { tolerance: 1e-7, ..Options::default() };
        gradcheck_with(options, &images, |x| vec![ssim_with(x[0], x[1], covariance)]);
    }

    #[test]
    fn equals_its_slow_twin(h in 11..20usize, w in 11..20usize, seed in any::<u64>()) {
        let (a, b) = (Input::uniform(seed, 0.0, 1.0, [1, 1, h, w]), Input::uniform(!seed, 0.0, 1.0, [1, 1, h, w]));
        let tape = Tape::<f64>::new();
        let fast = ssim(tape.constant(&a.data, a.shape), tape.constant(&b.data, b.shape)).item();
        prop_assert!((fast - slow_twin(&a.data, &b.data, [h, w], 1.0)).abs() < 1e-12);
        let metric = metrics::ssim(&a.data, &b.data, [1, h, w]);
        prop_assert!((metric - slow_twin(&a.data, &b.data, [h, w], 121.0 / 120.0)).abs() < 1e-12);
    }
}

/// Windows around every pixel are those inside the image with five zeros on each side.
#[test]
fn zero_padding_is_what_it_says() {
    let (h, w) = (4, 7);
    let [a, b] = [1, 2].map(|seed| Input::uniform(seed, 0.0, 1.0, [1, 1, h, w]));
    let larger = |image: &Input| -> Vec<f64> {
        let inside = |i: usize| {
            let (y, x) = ((i / (w + 10)).wrapping_sub(5), (i % (w + 10)).wrapping_sub(5));
            if y < h && x < w { image.data[y * w + x] } else { 0.0 }
        };
        (0..(h + 10) * (w + 10)).map(inside).collect()
    };
    let tape = Tape::<f64>::new();
    let [x, y] = [&a, &b].map(|image| tape.constant(&image.data, image.shape));
    let expected = slow_twin(&larger(&a), &larger(&b), [h + 10, w + 10], 1.0);
    assert!((ssim_zero_padded(x, y).item() - expected).abs() < 1e-12);
    let images = [a, b];
    let options = Options { tolerance: 1e-7, ..Options::default() };
    gradcheck_with(options, &images, |x| vec![ssim_zero_padded(x[0], x[1])]);
}

/// Equal images are one and each image counts for itself.
#[test]
fn equal_images_have_a_similarity_of_one() {
    let image = Input::uniform(1, 0.0, 1.0, [2, 3, 16, 17]);
    let mut other = image.data.clone();
    other[..3 * 16 * 17].iter_mut().for_each(|x| *x = 1.0 - *x);
    let tape = Tape::<f64>::new();
    let both = ssim(tape.constant(&image.data, image.shape), tape.constant(&other, image.shape)).to_vec();
    assert!(both[0] < 0.5 && (both[1] - 1.0).abs() < 1e-12, "{both:?}");
}

#[test]
fn many_planes_are_worked_on_in_groups() {
    let (a, b) = (Input::uniform(1, 0.0, 1.0, [7, 3, 12, 12]), Input::uniform(2, 0.0, 1.0, [7, 3, 12, 12]));
    let tape = Tape::<f64>::new();
    let all = ssim(tape.constant(&a.data, a.shape), tape.constant(&b.data, b.shape)).to_vec();
    for (i, (a, b)) in a.data.chunks(3 * 144).zip(b.data.chunks(3 * 144)).enumerate() {
        let one = ssim(tape.constant(a, [1, 3, 12, 12]), tape.constant(b, [1, 3, 12, 12])).item();
        assert_eq!(all[i], one);
    }
}

#[test]
#[should_panic(expected = "ssim: expected two batches of images [N, C, H, W] of one shape, at least 11 x 11")]
fn small_images_are_refused() {
    let tape = Tape::<f64>::new();
    let x = tape.constant(&[0.0; 300], [1, 3, 10, 10]);
    ssim(x, x);
}
