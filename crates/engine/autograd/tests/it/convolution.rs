//! Convolutions against the definition.

use crate::strategies::cases;
use proptest::prelude::*;
use weaver_autograd::gradcheck::{Input, gradcheck};
use weaver_autograd::ops::{conv_transpose2d, conv1d, conv2d};
use weaver_autograd::{Shape, Tape};

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn convolution(n in 0usize..3, c in 1usize..3, o in 1usize..4, h in 1usize..6, w in 1usize..6,
                   kh in 1usize..4, kw in 1usize..4, stride in 1usize..4, padding in 0usize..3, bias: bool, seed: u64) {
        let mut inputs = vec![Input::normal(seed, [n, c, h, w]), Input::normal(seed ^ 1, [o, c, kh, kw])];
        if bias {
            inputs.push(Input::normal(seed ^ 2, [o]));
        }
        gradcheck(&inputs, |x| vec![conv2d(x[0], x[1], x.get(2).copied(), stride, padding)]);

        let tape = Tape::<f64>::new();
        let x: Vec<_> = inputs.iter().map(|x| tape.constant(&x.data, x.shape)).collect();
        let y = conv2d(x[0], x[1], x.get(2).copied(), stride, padding);
        let along = |n: usize, k: usize| if n + 2 * padding < k { 0 } else { (n + 2 * padding - k) / stride + 1 };
        let (hh, ww) = (along(h, kh), along(w, kw));
        prop_assert_eq!(y.shape(), Shape::from([n, o, hh, ww]));
        for (at, y) in y.to_vec().into_iter().enumerate() {
            let (image, channel, i, j) = (at / (o * hh * ww), at / (hh * ww) % o, at / ww % hh, at % ww);
            let mut sum = if bias { inputs[2].data[channel] } else { 0.0 };
            for (ci, p, q) in (0..c).flat_map(|ci| (0..kh).flat_map(move |p| (0..kw).map(move |q| (ci, p, q)))) {
                let (row, column) = ((i * stride + p).wrapping_sub(padding), (j * stride + q).wrapping_sub(padding));
                if row < h && column < w {
                    let weight = inputs[1].data[((channel * c + ci) * kh + p) * kw + q];
                    sum += weight * inputs[0].data[((image * c + ci) * h + row) * w + column];
                }
            }
            prop_assert!((y - sum).abs() < 1e-12);
        }
    }

    /// The transposed convolution is the gradient of the convolution.
    #[test]
    fn transposed_convolution(n in 0usize..3, i in 1usize..3, o in 1usize..4, h in 1usize..4, w in 1usize..4,
                              k in 1usize..4, stride in 1usize..4, bias: bool, seed: u64) {
        let mut inputs = vec![Input::normal(seed, [n, i, h, w]), Input::normal(seed ^ 1, [i, o, k, k])];
        if bias {
            inputs.push(Input::normal(seed ^ 2, [o]));
        }
        gradcheck(&inputs, |x| vec![conv_transpose2d(x[0], x[1], x.get(2).copied(), stride)]);

        let tape = Tape::<f64>::new();
        let x: Vec<_> = inputs.iter().map(|x| tape.constant(&x.data, x.shape)).collect();
        let y = conv_transpose2d(x[0], x[1], x.get(2).copied(), stride);
        let (hh, ww) = ((h - 1) * stride + k, (w - 1) * stride + k);
        prop_assert_eq!(y.shape(), Shape::from([n, o, hh, ww]));
        if n > 0 {
            let source = tape.leaf(&vec![0.0; n * o * hh * ww], y.shape());
            conv2d(source, x[1], None, stride, 0).backward_with(&inputs[0].data);
            let adjoint = source.grad().expect("a gradient");
            for (at, y) in y.to_vec().into_iter().enumerate() {
                let b = if bias { inputs[2].data[at / (hh * ww) % o] } else { 0.0 };
                prop_assert!((y - b - adjoint[at]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn along_time(batch in 0usize..3, time in 1usize..7, inputs in 1usize..4, outputs in 1usize..3,
                  dilation in 1usize..4, seed: u64) {
        let x = Input::normal(seed, [batch, time, inputs]);
        let (w, b) = (Input::normal(seed ^ 1, [outputs, inputs, 3]), Input::normal(seed ^ 2, [outputs]));
        gradcheck(&[x.clone(), w.clone(), b.clone()], |v| vec![conv1d(v[0], v[1], v[2], dilation)]);
        let tape = Tape::<f64>::new();
        let constant = |x: &Input| tape.constant(&x.data, x.shape);
        let found = conv1d(constant(&x), constant(&w), constant(&b), dilation).to_vec();
        for (at, found) in found.into_iter().enumerate() {
            let (n, t, o) = (at / (time * outputs), at / outputs % time, at % outputs);
            let mut expected = b.data[o];
            for tap in 0..3 {
                let from = t as isize + (tap as isize - 1) * dilation as isize;
                if (0..time as isize).contains(&from) {
                    expected += (0..inputs)
                        .map(|i| w.data[(o * inputs + i) * 3 + tap] * x.data[(n * time + from as usize) * inputs + i])
                        .sum::<f64>();
                }
            }
            prop_assert!((found - expected).abs() < 1e-12);
        }
    }
}
