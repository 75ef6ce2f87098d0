//! Every op against finite differences, and the straight-through choice against the softmax it stands for.

use proptest::prelude::*;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_kernels::random::Stream;
use weaver_router::{gate, gumbel_softmax_straight_through};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 20))]

    #[test]
    fn gated_rows(rows in 0..5usize, width in 1..6usize, expert in 0..3usize, seed in 0..1000u64) {
        let order = Stream::new(seed, 0, "pixels").permutation(6);
        let pixels: Vec<u32> = order[..rows].iter().map(|&p| p as u32).collect();
        let inputs = [Input::normal(seed, [rows, width]), Input::normal(seed + 1, [6, 3])];
        gradcheck(&inputs, |x| vec![gate(x[0], x[1], &pixels, expert)]);
    }

    /// The choice is one hot and has the gradient of the softmax.
    #[test]
    fn hard_choices_have_soft_gradients(
        pixels in 0..6usize, experts in 1..5usize, temperature in 0.2..2.0f64, noisy: bool, seed in 0..1000u64
    ) {
        let shape = [pixels, experts];
        let (logits, noise, cotangent) =
            (Input::normal(seed, shape), Input::normal(seed + 1, shape), Input::normal(seed + 2, shape));
        let tape = Tape::<f64>::new();
        let g = tape.constant(&noise.data, shape);
        let hard_logits = tape.leaf(&logits.data, shape);
        let choice = gumbel_softmax_straight_through(hard_logits, noisy.then_some(g), temperature);
        let soft_logits = tape.leaf(&logits.data, shape);
        let sum = if noisy { soft_logits + g } else { soft_logits };
        let soft = (sum * (1.0 / temperature)).softmax(1);
        for (choice, soft) in choice.to_vec().chunks(experts).zip(soft.to_vec().chunks(experts)) {
            let ones = choice.iter().filter(|&&c| c == 1.0).count();
            let zeros = choice.iter().filter(|&&c| c == 0.0).count();
            prop_assert_eq!((ones, zeros), (1, experts - 1));
            let largest = soft.iter().cloned().fold(0.0, f64::max);
            prop_assert!(choice.iter().zip(soft).all(|(c, s)| *c == 0.0 || *s == largest));
        }
        choice.backward_with(&cotangent.data);
        soft.backward_with(&cotangent.data);
        for (hard, soft) in hard_logits.grad().unwrap().iter().zip(soft_logits.grad().unwrap()) {
            prop_assert!((hard - soft).abs() < 1e-12, "{} against {}", hard, soft);
        }
    }
}

/// Logits that the exponential of none would fit into a number.
#[test]
fn large_logits_have_gradients() {
    let gradient = |by: f64| {
        let tape = Tape::<f64>::new();
        let logits = tape.leaf(&[by + 1.0, by, by - 0.5], [1, 3]);
        gumbel_softmax_straight_through(logits, None, 0.5).backward_with(&[1.0, -2.0, 0.5]);
        logits.grad().unwrap().to_vec()
    };
    let (small, large) = (gradient(0.0), gradient(800.0));
    assert!(small.iter().zip(&large).all(|(a, b)| (a - b).abs() < 1e-9 && *a != 0.0), "{small:?} {large:?}");
}

#[test]
#[should_panic(expected = "of pixel 3")]
fn a_choice_without_the_last_pixel_is_refused() {
    let tape = Tape::<f64>::new();
    gate(tape.constant(&[1.0], [1, 1]), tape.constant(&[1.0; 4], [2, 2]), &[2], 1);
}
