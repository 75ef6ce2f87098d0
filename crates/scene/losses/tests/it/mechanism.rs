//! Properties that pin the losses to the method.

use weaver_autograd::gradcheck::Input;
use weaver_autograd::{Pool, Tape};
use weaver_kernels::order::quantile;
use weaver_losses::*;

const QUANTILES: [f64; 3] = [0.76, 0.96, 0.98];

fn classes(energy: &[f64]) -> Vec<u32> {
    let mut classes = vec![9; energy.len()];
    frequency_targets(energy, &QUANTILES, &Pool::new(), &mut classes);
    classes
}

/// Ranking targets of a random map are 76 20 2 2 percent.
#[test]
fn ranking_targets_of_a_random_map() {
    let energy = Input::uniform(3, 0.0, 1.0, [10_000]).data;
    let classes = classes(&energy);
    let share = |class| classes.iter().filter(|c| **c == class).count();
    assert_eq!([share(0), share(1), share(2), share(3)], [7600, 2000, 200, 200]);
    let least = |class| energy.iter().zip(&classes).filter(|(_, c)| **c == class).fold(1.0, |m: f64, (e, _)| m.min(*e));
    assert!(least(0) < least(1) && least(1) < least(2) && least(2) < least(3), "more energy, higher class");
}

/// An energy at a threshold belongs to the upper class.
#[test]
fn an_energy_at_a_threshold_is_of_the_upper_class() {
    // Of 26 numbers, the 0.76 and 0.96 quantiles are the numbers 19 and 24 themselves, the 0.98 quantile is 24.5.
    let energy: Vec<f64> = (0..26).map(f64::from).collect();
    let found = classes(&energy);
    assert_eq!((found[18], found[19], found[23], found[24], found[25]), (0, 1, 1, 2, 3));
    assert_eq!(classes(&[1.0; 5]), [3; 5], "all alike: all at every threshold");
    assert!(classes(&[]).is_empty());
}

#[test]
fn pose_losses_have_the_values_of_their_formulas() {
    let tape = Tape::<f64>::new();
    let rotation = |scale: f64| {
        let rows: Vec<f64> = (0..9).map(|i| if i % 4 == 0 { scale } else { 0.0 }).collect();
        tape.constant(&rows, [1, 3, 3])
    };
    let center = |x: f64| tape.constant(&[x, 2.0 * x, 3.0 * x], [1, 3]);
    let loss = absolute_pose(&[rotation(2.0), rotation(1.0)], &[center(1.0), center(-1.0)], rotation(0.0), center(0.0));
    assert!((loss.item() - (0.6 * (2.0 / 3.0 + 2.0) + (1.0 / 3.0 + 2.0)) / 2.0).abs() < 1e-12);
    let [identity, quarter] = [[1.0, 0.0, 0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 1.0, 0.0, 0.0]]
        .map(|two| tape.constant(&[&two[..], &[0.0, 0.0, 1.0]].concat(), [1, 9]));
    assert!((rotation_angles(identity, quarter).item() - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    let [found, truth] = [[6.0, 5.0, 0.0, 0.0], [5.0, 3.0, 9.0, 9.0]].map(|k| tape.constant(&k, [1, 4]));
    assert!((focal_error(found, truth, 10).item() - (0.01 + 0.04) / 2.0).abs() < 1e-12);
}

#[test]
fn quantiles_interpolate() {
    assert_eq!(quantile(&mut [3.0, 1.0, 2.0], 0.25), 1.5);
    assert_eq!(
        (quantile(&mut [3.0, 1.0], 0.0), quantile(&mut [3.0, 1.0], 1.0), quantile(&mut [7.0], 0.3)),
        (1.0, 3.0, 7.0)
    );
    assert_eq!(quantile(&mut [f64::INFINITY, 1.0, 2.0], 0.5), 2.0, "a neighbor without weight");
}

/// Quantiles of equal numbers lead back to the earlier.
#[test]
fn quantiles_of_equal_numbers_take_the_earlier() {
    let tape = Tape::<f64>::new();
    let x = tape.leaf(&[2.0, 1.0, 2.0, 2.0, 1.0], [5]);
    quantiles(x, &[0.0, 0.5, 0.875]).backward_with(&[1.0, 10.0, 100.0]);
    assert_eq!(x.grad().unwrap(), [10.0, 1.0, 50.0, 50.0, 0.0]);
}

#[test]
fn label_smoothing_aims_at_0_925_and_0_025() {
    let tape = Tape::<f64>::new();
    let logits = tape.leaf(&[0.0; 100 * 4], [100, 4]);
    let energy: Vec<f64> = (0..100).map(f64::from).collect();
    ranking_cross_entropy(logits, tape.constant(&energy, [100]), &QUANTILES, 0.1).backward();
    let gradient = logits.grad().unwrap();
    for (row, class) in gradient.chunks(4).zip(classes(&energy)) {
        for (e, g) in row.iter().enumerate() {
            // The gradient of the mean is (softmax - target) / rows, and the softmax of zeros is 1/4.
            let target = 0.25 - 100.0 * g;
            let expected = if e == class as usize { 0.925 } else { 0.025 };
            assert!((target - expected).abs() < 1e-12, "{target}");
        }
    }
}

#[test]
fn the_budget_pushes_shares_towards_their_targets() {
    let tape = Tape::<f64>::new();
    // Shares 0.25, 0.5, 0.25, 0 of the experts 0 to 3.
    let choice = tape.leaf(&[1., 0., 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0.], [4, 4]);
    let loss = share_budget(choice, &[0.2, 0.02, 0.02]);
    assert!((loss.item() - 5.0 * (0.3f64.powi(2) + 0.23f64.powi(2) + 0.02f64.powi(2))).abs() < 1e-12);
    loss.backward();
    for row in choice.grad().unwrap().chunks(4) {
        assert!(row[0] == 0.0 && row[1] > 0.0 && row[2] > 0.0 && row[3] < 0.0, "{row:?}");
    }
}

/// The global budget acts above tau alone and by the count.
#[test]
fn the_global_budget_acts_above_tau() {
    let gradient = |tau| {
        let tape = Tape::<f64>::new();
        let choice = tape.leaf(&[1., 0., 0., 0., 0., 0., 1., 0.], [2, 4]);
        let loss = global_budget(choice, tau);
        loss.backward();
        (loss.item(), choice.grad().unwrap())
    };
    assert_eq!(gradient(1.5), (0.0, vec![0.0; 8]));
    let (loss, slope) = gradient(0.5);
    assert_eq!(loss, 0.25);
    assert_eq!(slope, [0.0, 0.5, 1.0, 1.5, 0.0, 0.5, 1.0, 1.5]);
}

#[test]
fn iterations_weigh_more_the_later_they_come() {
    let weights: Vec<f64> = iteration_weights(4).collect();
    for (weight, expected) in weights.iter().zip([0.054, 0.09, 0.15, 0.25]) {
        assert!((weight - expected).abs() < 1e-15);
    }
}

#[test]
fn confidence_is_compared_view_by_view_and_strictly() {
    let tape = Tape::<f64>::new();
    // In the second view nothing is above its quantile.
    let confidence = tape.constant(&[1.0, 2.0, 3.0, 4.0, 5.0, 5.0, 5.0, 5.0], [2, 2, 2]);
    let depth = tape.leaf(&[9.0, 2.0, 2.0, 2.0, f64::NAN, 1.0, 1.0, 1.0], [2, 2, 2]);
    let target = tape.constant(&[1.0; 8], [2, 2, 2]);
    let loss = masked_depth_mse(depth, target, confidence, 0.3);
    loss.backward();
    assert_eq!(loss.item(), 1.0);
    let two_thirds = 2.0 / 3.0;
    for (g, expected) in depth.grad().unwrap().iter().zip([0.0, two_thirds, two_thirds, two_thirds, 0.0, 0.0, 0.0, 0.0])
    {
        assert!((g - expected).abs() < 1e-12);
    }
    let nothing = masked_depth_mse(depth, target, tape.constant(&[1.0; 8], [2, 2, 2]), 0.3);
    assert_eq!(nothing.item(), 0.0);
}

#[test]
fn sparse_depth_divides_by_one_more_than_it_knows() {
    let tape = Tape::<f64>::new();
    let log_depth = tape.leaf(&[1.0, 2.0, f64::NAN, 0.5], [1, 2, 2]);
    let target = tape.constant(&[1.0, 0.5 * std::f64::consts::E, 0.0, 0.0], [1, 2, 2]);
    let loss = sparse_log_depth_l1(log_depth, target, 2.0);
    let expected = ((1.0 - 2.0f64.ln()).abs() + 1.0) / 3.0;
    assert!((loss.item() - expected).abs() < 1e-12);
    loss.backward();
    assert_eq!(log_depth.grad().unwrap(), [1.0 / 3.0, 1.0 / 3.0, 0.0, 0.0]);
}

/// Error targets are centered logarithms of smoothed errors.
#[test]
fn error_targets_are_centered_logarithms() {
    let mut target = [0.0; 6];
    // A 2 x 3 view: the mean of the corner's neighborhood runs over the four pixels inside the image.
    error_target(&[0.4, 0.0, 0.0, 0.0, 0.0, 0.0], [2, 3], &mut target);
    let log = |e: f64| 0.5 * (e + 1e-4).ln();
    let raw = [log(0.1), log(0.4 / 6.0), log(0.0), log(0.1), log(0.4 / 6.0), log(0.0)];
    let mean = raw.iter().sum::<f64>() / 6.0;
    for (t, r) in target.iter().zip(raw) {
        assert!((t - (r - mean)).abs() < 1e-12);
    }
    // Centered over the views of a scene together, not one by one.
    for size in [[1, 2], [2, 1]] {
        let mut both = [0.0_f64; 4];
        error_target(&[1.0, 1.0, 0.0, 0.0], size, &mut both);
        assert!(both[0] > 2.0 && (both[0] + both[2]).abs() < 1e-12);
    }
}

#[test]
fn errors_of_some_pixels_teach_these_alone() {
    let tape = Tape::<f64>::new();
    let score: Vec<f64> = (0..16).map(|i| f64::from(i) * 0.1).collect();
    let error = |outside: f64| -> Vec<f64> {
        (0..16).map(|i| if i % 4 < 1 { 0.01 * f64::from(i + 1) } else { outside }).collect()
    };
    let among: Vec<u32> = (0..16).filter(|i| i % 4 < 1).collect();
    let score = tape.leaf(&score, [1, 4, 4]);
    let loss = error_regression(score, tape.constant(&error(0.0), [1, 4, 4]), Some(&among));
    loss.backward();
    let gradient = score.grad().unwrap();
    assert!((0..16).all(|i| (gradient[i] != 0.0) == (i % 4 < 1)), "{gradient:?}");
    // A score that is the target up to its mean over these pixels costs nothing but that mean.
    let mut target = vec![0.0; 16];
    error_target(&error(0.0), [4, 4], &mut target);
    let center = among.iter().map(|p| target[*p as usize]).sum::<f64>() / 4.0;
    let met = tape.constant(&target.iter().map(|t| t - center).collect::<Vec<_>>(), [1, 4, 4]);
    let loss = error_regression(met, tape.constant(&error(0.0), [1, 4, 4]), Some(&among));
    assert!(loss.item() < 1e-20);
}
