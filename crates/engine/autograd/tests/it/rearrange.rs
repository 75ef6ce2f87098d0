//! Ops that move, repeat, pick and add up.

use crate::strategies::{cases, dim, length, shape, shape_and_axis};
use proptest::prelude::*;
use weaver_autograd::gradcheck::{Input, adjoint_check, gradcheck};
use weaver_autograd::{Shape, Tape, ops};
use weaver_kernels::random::Stream;

/// `count` indices below `n`, with repetitions.
fn indices(seed: u64, count: usize, n: usize) -> Vec<u32> {
    let stream = Stream::new(seed, 0, "test.indices");
    (0..count as u64).map(|i| stream.below(i, n) as u32).collect()
}

/// Element `index` of a tensor.
fn at(data: &[f64], shape: Shape, index: &[usize]) -> f64 {
    data[index.iter().zip(shape.dims()).fold(0, |offset, (i, d)| offset * d + i)]
}

/// The indices of all elements, in order.
fn positions(shape: Shape) -> Vec<Vec<usize>> {
    let of = |mut at: usize| {
        let mut index = vec![0; shape.rank()];
        for axis in (0..shape.rank()).rev() {
            index[axis] = at % shape[axis];
            at /= shape[axis];
        }
        index
    };
    (0..shape.len()).map(of).collect()
}

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn concat_and_split((shape, axis) in shape_and_axis(), sizes in prop::collection::vec(dim(), 1..4), seed: u64) {
        let inputs: Vec<Input> =
            sizes.iter().enumerate().map(|(i, &n)| Input::normal(seed ^ i as u64, shape.with_axis(axis, n))).collect();
        gradcheck(&inputs, |x| vec![ops::concat(x, axis)]);
        let tape = Tape::<f64>::new();
        let parts: Vec<_> = inputs.iter().map(|x| tape.constant(&x.data, x.shape)).collect();
        let whole = ops::concat(&parts, axis);
        for (part, input) in ops::split(whole, axis, &sizes).iter().zip(&inputs) {
            prop_assert_eq!(part.shape(), input.shape);
            prop_assert_eq!(part.to_vec(), input.data.clone());
        }
        let total = shape.with_axis(axis, sizes.iter().sum());
        gradcheck(&[Input::normal(seed, total)], |x| ops::split(x[0], axis, &sizes).to_vec());
    }

    #[test]
    fn slice((shape, axis) in shape_and_axis(), from in 0.0..1.0, to in 0.0..1.0, seed: u64) {
        let start = (from * shape[axis] as f64) as usize;
        let len = (to * (shape[axis] - start) as f64) as usize;
        adjoint_check(shape, seed, |x| x.slice(axis, start, len));
        let x = Input::normal(seed, shape);
        let tape = Tape::<f64>::new();
        let y = tape.constant(&x.data, shape).slice(axis, start, len);
        for (mut index, y) in positions(y.shape()).into_iter().zip(y.to_vec()) {
            index[axis] += start;
            prop_assert_eq!(y, at(&x.data, shape, &index));
        }
    }

    #[test]
    fn permute(axes in (0usize..7).prop_flat_map(|r| Just((0..r).collect::<Vec<_>>()).prop_shuffle()), seed: u64, dims in shape(6)) {
        let shape = Shape::new(&dims.dims()[..axes.len()]);
        let x = Input::normal(seed, shape);
        let tape = Tape::<f64>::new();
        let y = tape.constant(&x.data, shape).permute(&axes);
        for (index, y) in positions(y.shape()).into_iter().zip(y.to_vec()) {
            let mut from = vec![0; axes.len()];
            axes.iter().zip(index).for_each(|(&axis, i)| from[axis] = i);
            prop_assert_eq!(y, at(&x.data, shape, &from));
        }
        adjoint_check(shape, seed, |x| x.permute(&axes));
        // The second term adds to a gradient that is there.
        gradcheck(&[x], |x| vec![x[0].permute(&axes) + x[0].square().permute(&axes)]);
    }

    #[test]
    fn expand(target in (0usize..5).prop_flat_map(shape), skipped in 0usize..3, ones in prop::collection::vec(any::<bool>(), 4), seed: u64) {
        let kept = &target.dims()[skipped.min(target.rank())..];
        let dims: Vec<usize> = kept.iter().zip(&ones).map(|(&d, &one)| if one { 1 } else { d }).collect();
        let x = Input::normal(seed, dims.as_slice());
        let tape = Tape::<f64>::new();
        let y = tape.constant(&x.data, x.shape).expand(target);
        let added = target.rank() - dims.len();
        for (index, y) in positions(target).into_iter().zip(y.to_vec()) {
            let from: Vec<usize> = index[added..].iter().zip(&dims).map(|(&i, &d)| if d == 1 { 0 } else { i }).collect();
            prop_assert_eq!(y, at(&x.data, x.shape, &from));
        }
        adjoint_check(x.shape, seed, |x| x.expand(target));
        gradcheck(&[x], |x| vec![x[0].expand(target)]);
    }

    #[test]
    fn sum_and_mean_along_an_axis((shape, axis) in shape_and_axis(), seed: u64) {
        let x = Input::normal(seed, shape);
        let tape = Tape::<f64>::new();
        let y = tape.constant(&x.data, shape).sum_axis(axis);
        for (mut index, y) in positions(y.shape()).into_iter().zip(y.to_vec()) {
            index.insert(axis, 0);
            let term = |i: usize| { let mut index = index.clone(); index[axis] = i; at(&x.data, shape, &index) };
            prop_assert!((y - (0..shape[axis]).map(term).sum::<f64>()).abs() < 1e-12);
        }
        adjoint_check(shape, seed, |x| x.sum_axis(axis));
        if shape[axis] > 0 {
            adjoint_check(shape, seed, |x| x.mean_axis(axis));
            gradcheck(&[x], |x| vec![x[0].sum_axis(axis), x[0].mean_axis(axis)]);
        }
    }

    #[test]
    fn gather_and_scatter_rows(n in length(), count in dim(), width in dim(), seed: u64) {
        let index = indices(seed, count, n);
        let x = Input::normal(seed, [n, width, 2]);
        let picked = Input::normal(!seed, [count, width, 2]);
        adjoint_check(x.shape, seed, |x| x.gather_rows(&index));
        adjoint_check(picked.shape, seed, |x| x.scatter_add_rows(&index, n));
        gradcheck(&[x.clone(), picked.clone()], |x| vec![x[0].gather_rows(&index), x[1].scatter_add_rows(&index, n)]);

        let tape = Tape::<f64>::new();
        let rows = tape.constant(&x.data, x.shape).gather_rows(&index).to_vec();
        let sums = tape.constant(&picked.data, picked.shape).scatter_add_rows(&index, n).to_vec();
        for c in 0..2 * width {
            for (i, &row) in index.iter().enumerate() {
                prop_assert_eq!(rows[i * 2 * width + c], x.data[row as usize * 2 * width + c]);
            }
            for row in 0..n {
                let sum: f64 = (0..count).filter(|&i| index[i] as usize == row).map(|i| picked.data[i * 2 * width + c]).sum();
                prop_assert!((sums[row * 2 * width + c] - sum).abs() < 1e-12);
            }
        }
    }
}

#[test]
fn gradients_through_permutations_add_up() {
    let (tape, axes) = (Tape::<f64>::new(), [2, 0, 1]);
    let x = tape.leaf(&[0.0; 17 * 3 * 40], [17, 3, 40]);
    let weights: Vec<f64> = (0..x.shape().len()).map(|i| i as f64).collect();
    let weights = tape.constant(&weights, [40, 17, 3]);
    let (once, twice) = ((x.permute(&axes) * weights).sum(), (x.permute(&axes) * weights).sum());
    (once + twice * 2.0 + x.sum()).backward();
    let expected = weights.permute(&[1, 2, 0]).to_vec().into_iter().map(|w| 3.0 * w + 1.0).collect::<Vec<_>>();
    assert_eq!(x.grad().unwrap(), expected);
}

#[test]
#[should_panic(expected = "gather_rows: expected x [N, ..] with row 2, found [2, 1]")]
fn an_index_beyond_the_rows_is_loud() {
    let tape = Tape::<f32>::new();
    tape.constant(&[0.0; 2], [2, 1]).gather_rows(&[0, 2]);
}
