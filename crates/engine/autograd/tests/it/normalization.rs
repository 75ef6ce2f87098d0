//! Softmax, layer and root-mean-square normalization.

use crate::strategies::{cases, length, shape_and_axis};
use proptest::prelude::*;
use weaver_autograd::Tape;
use weaver_autograd::gradcheck::{Input, gradcheck};

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn softmax((shape, axis) in shape_and_axis(), seed: u64) {
        gradcheck(&[Input::normal(seed, shape)], |x| vec![x[0].softmax(axis), x[0].log_softmax(axis)]);
        let tape = Tape::<f64>::new();
        let x = tape.constant(&Input::normal(seed, shape).data, shape);
        for sum in x.softmax(axis).sum_axis(axis).to_vec() {
            prop_assert!(shape[axis] == 0 || (sum - 1.0).abs() < 1e-14);
        }
        for (log, y) in x.log_softmax(axis).to_vec().into_iter().zip(x.softmax(axis).to_vec()) {
            prop_assert!((log - y.ln()).abs() < 1e-13);
        }
    }

    #[test]
    fn layer_norm(rows in 0usize..4, width in length(), seed: u64) {
        let inputs = [Input::normal(seed, [rows, 1, width]), Input::normal(seed ^ 1, [width]), Input::normal(seed ^ 2, [width])];
        gradcheck(&inputs, |x| vec![x[0].layer_norm(Some((x[1], x[2])), 0.1), x[0].layer_norm(None, 0.1)]);
        let tape = Tape::<f64>::new();
        let y = tape.constant(&inputs[0].data, inputs[0].shape).layer_norm(None, 0.1).to_vec();
        for (x, y) in inputs[0].data.chunks(width).zip(y.chunks(width)) {
            let moments = |row: &[f64]| {
                let mean = row.iter().sum::<f64>() / width as f64;
                (mean, row.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / width as f64)
            };
            let ((_, before), (mean, after)) = (moments(x), moments(y));
            prop_assert!(mean.abs() < 1e-12 && (after - before / (before + 0.1)).abs() < 1e-12);
        }
    }

    #[test]
    fn rms_norm(rows in 0usize..4, width in length(), seed: u64) {
        let inputs = [Input::normal(seed, [rows, 1, width]), Input::normal(seed ^ 1, [width])];
        gradcheck(&inputs, |x| vec![x[0].rms_norm(x[1], 0.1)]);
        let tape = Tape::<f64>::new();
        let [x, w] = [0, 1].map(|i| tape.constant(&inputs[i].data, inputs[i].shape));
        for (x, y) in inputs[0].data.chunks(width).zip(x.rms_norm(w, 0.1).to_vec().chunks(width)) {
            let root = (x.iter().map(|x| x * x).sum::<f64>() / width as f64 + 0.1).sqrt();
            for ((x, y), w) in x.iter().zip(y).zip(&inputs[1].data) {
                prop_assert!((x / root * w - y).abs() < 1e-12);
            }
        }
    }
}

/// The weights' gradient is summed in parts.
#[test]
fn rms_norm_of_many_rows() {
    let inputs = [Input::normal(3, [700, 5]), Input::normal(4, [5])];
    gradcheck(&inputs, |x| vec![x[0].rms_norm(x[1], 1e-5)]);
}

#[test]
fn softmax_of_extremes() {
    let tape = Tape::<f32>::new();
    let x = tape.constant(&[1000.0, 0.0, -1000.0], [3]);
    assert_eq!(x.softmax(0).to_vec(), [1.0, 0.0, 0.0]);
    assert_eq!(x.log_softmax(0).to_vec(), [0.0, -1000.0, -2000.0]);
}
