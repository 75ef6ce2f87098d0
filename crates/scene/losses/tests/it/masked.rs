//! Masked losses: gradients, slow twins, and no influence of pixels outside.

use proptest::prelude::*;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, Options, gradcheck_with};
use weaver_losses::{masked_mse, masked_ssim, mse, ssim};

/// A mask with about one in `rare` pixels outside.
fn mask(seed: u64, pixels: usize, rare: f64) -> Vec<bool> {
    Input::uniform(seed, 0.0, rare, [pixels]).data.iter().map(|x| *x > 1.0).collect()
}

/// SSIM of one image over its whole windows, one window after the other; 1 without any.
fn ssim_twin(a: &[f64], b: &[f64], [channels, height, width]: [usize; 3], inside: &[bool]) -> f64 {
    let gauss = |d: usize| (-(d as f64 - 5.0).powi(2) / (2.0 * 1.5 * 1.5)).exp();
    let total: f64 = (0..121).map(|i| gauss(i / 11) * gauss(i % 11)).sum();
    let (mut sum, mut count) = (0.0, 0);
    for (y, x) in (0..height - 10).flat_map(|y| (0..width - 10).map(move |x| (y, x))) {
        let at = |i: usize| (y + i / 11) * width + x + i % 11;
        if !(0..121).all(|i| inside[at(i)]) {
            continue;
        }
        for c in 0..channels {
            let mean = |f: &dyn Fn(usize) -> f64| -> f64 {
                (0..121).map(|i| gauss(i / 11) * gauss(i % 11) / total * f(c * height * width + at(i))).sum()
            };
            let (ma, mb) = (mean(&|i| a[i]), mean(&|i| b[i]));
            let va = mean(&|i| (a[i] - ma).powi(2)) + mean(&|i| (b[i] - mb).powi(2));
            let cab = mean(&|i| (a[i] - ma) * (b[i] - mb));
            sum += (2.0 * ma * mb + 1e-4) * (2.0 * cab + 9e-4) / ((ma * ma + mb * mb + 1e-4) * (va + 9e-4));
            count += 1;
        }
    }
    if count == 0 { 1.0 } else { sum / f64::from(count) }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 32))]

    #[test]
    fn gradients(n in 1..3usize, h in 11..15usize, w in 11..15usize, seed in any::<u64>()) {
        let images = [Input::uniform(seed, 0.0, 1.0, [n, 2, h, w]), Input::uniform(!seed, 0.0, 1.0, [n, 2, h, w])];
        let (holes, rare) = (mask(seed, n * h * w, 3.0), mask(seed, n * h * w, 200.0));
        let options = Options { tolerance: 1e-7, ..Options::default() };
        gradcheck_with(options, &images, |x| vec![masked_mse(x[0], x[1], &holes)]);
        gradcheck_with(options, &images, |x| vec![masked_ssim(x[0], x[1], &rare)]);
    }

    #[test]
    fn equal_their_twins(n in 1..3usize, h in 11..16usize, w in 11..16usize, seed in any::<u64>()) {
        let (a, b) = (Input::uniform(seed, 0.0, 1.0, [n, 3, h, w]), Input::uniform(!seed, 0.0, 1.0, [n, 3, h, w]));
        let inside = mask(seed ^ 1, n * h * w, 300.0);
        let tape = Tape::<f64>::new();
        let [x, y] = [&a, &b].map(|image| tape.constant(&image.data, image.shape));
        let counted = |i: usize| inside[i / (3 * h * w) * h * w + i % (h * w)];
        let pairs = a.data.iter().zip(&b.data).enumerate().filter(|(i, _)| counted(*i));
        let sum: f64 = pairs.map(|(_, (a, b))| (a - b).powi(2)).sum();
        prop_assert!((masked_mse(x, y, &inside).item() - sum / a.data.len() as f64).abs() < 1e-12);
        let found = masked_ssim(x, y, &inside).to_vec();
        for (i, found) in found.into_iter().enumerate() {
            let [a, b] = [&a, &b].map(|image| &image.data[i * 3 * h * w..][..3 * h * w]);
            let expected = ssim_twin(a, b, [3, h, w], &inside[i * h * w..][..h * w]);
            prop_assert!((found - expected).abs() < 1e-12, "{} {}", found, expected);
        }
    }
}

#[test]
fn a_mask_that_is_true_everywhere_changes_no_bit() {
    let [a, b] = [1, 2].map(|seed| Input::uniform(seed, 0.0, 1.0, [2, 3, 17, 14]));
    let tape = Tape::<f32>::new();
    let leaf = |image: &Input| tape.leaf(&image.data.iter().map(|x| *x as f32).collect::<Vec<_>>(), image.shape);
    let all = vec![true; 2 * 17 * 14];
    let [plain, masked] = [false, true].map(|masked| {
        let (x, y) = (leaf(&a), leaf(&b));
        let loss = if masked {
            masked_mse(x, y, &all) + masked_ssim(x, y, &all).mean()
        } else {
            mse(x, y) + ssim(x, y).mean()
        };
        loss.backward();
        (loss.item(), x.grad(), y.grad())
    });
    assert_eq!(plain, masked);
}

/// Promise (results): masked pixels have no influence on a loss and no gradient.
#[test]
fn what_lies_outside_has_no_influence_and_no_gradient() {
    let (h, w) = (16, 15);
    let image = Input::uniform(5, 0.0, 1.0, [1, 3, h, w]);
    let other = Input::uniform(6, 0.0, 1.0, [1, 3, h, w]);
    let outside = |i: usize| i % (h * w) / w < 3;
    let inside: Vec<bool> = (0..h * w).map(|i| !outside(i)).collect();
    let run = |fill: f64| {
        let tape = Tape::<f64>::new();
        let filled = |image: &Input| -> Vec<f64> {
            image.data.iter().enumerate().map(|(i, x)| if outside(i) { fill } else { *x }).collect()
        };
        let (a, b) = (tape.leaf(&filled(&image), image.shape), tape.constant(&filled(&other), image.shape));
        let loss = masked_mse(a, b, &inside) + masked_ssim(a, b, &inside).mean();
        loss.backward();
        (loss.item(), a.grad().unwrap())
    };
    let (zero, broken) = (run(0.0), run(f64::NAN));
    assert_eq!(zero, broken);
    assert!(zero.0.is_finite() && zero.1.iter().enumerate().all(|(i, g)| !outside(i) || *g == 0.0));
    assert!(zero.1.iter().enumerate().any(|(i, g)| !outside(i) && *g != 0.0));
}

#[test]
fn of_nothing_the_loss_is_nothing() {
    let tape = Tape::<f32>::new();
    let a = tape.leaf(&[f32::NAN; 3 * 144], [1, 3, 12, 12]);
    let b = tape.constant(&[0.5; 3 * 144], [1, 3, 12, 12]);
    let nothing = [false; 144];
    let loss = masked_mse(a, b, &nothing) + (masked_ssim(a, b, &nothing).mean() * -1.0 + 1.0);
    loss.backward();
    assert_eq!(loss.item(), 0.0);
    assert!(a.grad().unwrap().iter().all(|g| *g == 0.0));
}

#[test]
#[should_panic(expected = "inside_of")]
fn a_mask_of_another_size_is_refused() {
    let tape = Tape::<f32>::new();
    let a = tape.constant(&[0.5; 12], [1, 3, 2, 2]);
    masked_mse(a, a, &[true; 5]);
}
