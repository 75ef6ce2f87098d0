//! Losses: gradients against differences, and terms without effect.

use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_vad::losses::{
    bag_loss, class_loss, curve_loss, deepmil_loss, magnitude_bag_loss, magnitude_loss, smoothness, snippet_loss,
    sparsity,
};
use weaver_vad::{Rule, Splatting};

fn scores(seed: u64) -> Input {
    Input::uniform(seed, 0.05, 0.95, [4, 18])
}

#[test]
fn gradients_equal_differences() {
    for seed in 0..4 {
        let labels: Vec<f64> = Input::uniform(!seed, 0.0, 1.0, [2 * 18]).data;
        gradcheck(&[scores(seed)], |s| {
            vec![
                bag_loss(s[0]),
                smoothness(s[0]),
                sparsity(s[0]),
                deepmil_loss(s[0]),
                curve_loss(s[0], Some(&labels)),
                curve_loss(s[0], None),
            ]
        });
        gradcheck(&[Input::uniform(seed, 0.05, 0.95, [2, 18, 3])], |s| {
            vec![class_loss(s[0], s[0].tape().constant(&[0.0, 0.0, 0.0, 1.0, 0.0, 1.0], [2, 3]))]
        });
        gradcheck(&[Input::normal(seed, [4, 6, 3])], |f| vec![magnitude_loss(f[0])]);
        let features = Input::normal(!seed, [4, 18, 3]).constant();
        gradcheck(&[scores(seed), features], |x| vec![magnitude_bag_loss(x[0], x[1])]);
    }
}

#[test]
fn videos_without_labels_add_nothing() {
    let tape = Tape::<f64>::new();
    let s = tape.leaf(&[0.3, 0.6, 0.2, 0.9], [2, 2]);
    assert_eq!(snippet_loss(s, &[0.0; 4]).item(), 0.0);
    let one = snippet_loss(s, &[0.0, 0.0, 0.0, 1.0]).item();
    let alone = tape.constant(&[0.2, 0.9], [1, 2]);
    assert_eq!(one, snippet_loss(alone, &[0.0, 1.0]).item());
}

/// The gradient of the loss treats labels as constants.
#[test]
fn labels_carry_no_gradient() {
    let curve = [0.1, 0.1, 0.2, 0.5, 0.9, 0.6, 0.3, 0.1, 0.1, 0.1];
    let labels = Splatting::with(Rule::Time).labels(&curve);
    let tape = Tape::<f64>::new();
    let s = tape.leaf(&curve, [1, 10]);
    snippet_loss(s, &labels).backward();
    let expected = curve.iter().zip(&labels).map(|(s, y)| (s - y) / (s * (1.0 - s)) / 10.0);
    assert!(s.grad().unwrap().iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12));
}
