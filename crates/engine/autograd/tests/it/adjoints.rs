//! Linear maps whose backward pass must be their exact adjoint, in each argument that they are linear in.

use crate::strategies::cases;
use proptest::prelude::*;
use weaver_autograd::gradcheck::{Input, adjoint_check};
use weaver_autograd::ops::{Activation, concat, conv_transpose2d, conv2d, linear, split};
use weaver_autograd::{Shape, Var};

/// Random numbers as a constant beside `x`.
fn beside<'t>(x: Var<'t, f64>, seed: u64, shape: impl Into<Shape>) -> Var<'t, f64> {
    let input = Input::normal(seed ^ 7, shape);
    x.tape().constant(&input.data, input.shape)
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn products(m in 0usize..4, k in 1usize..5, n in 1usize..4, seed: u64) {
        adjoint_check([2, m, k], seed, |x| x.matmul(beside(x, seed, [2, k, n])));
        adjoint_check([2, k, n], seed, |x| beside(x, seed, [2, m, k]).matmul(x));
        adjoint_check([n, k], seed, |x| beside(x, seed, [2, m, k]).matmul_with(x, false, true));
        adjoint_check([2, m, k], seed, |x| linear(x, beside(x, seed, [n, k]), None, Activation::None));
        adjoint_check([n, k], seed, |w| linear(beside(w, seed, [m, k]), w, None, Activation::None));
    }

    #[test]
    fn convolutions(n in 0usize..3, c in 1usize..3, o in 1usize..3, k in 1usize..4, stride in 1usize..3, seed: u64) {
        let (image, kernel) = ([n, c, 4, 5], [o, c, k, k]);
        adjoint_check(image, seed, |x| conv2d(x, beside(x, seed, kernel), None, stride, k / 2));
        adjoint_check(kernel, seed, |w| conv2d(beside(w, seed, image), w, None, stride, k / 2));
        let kernel = [c, o, k, k];
        adjoint_check(image, seed, |x| conv_transpose2d(x, beside(x, seed, kernel), None, stride));
        adjoint_check(kernel, seed, |w| conv_transpose2d(beside(w, seed, image), w, None, stride));
    }

    #[test]
    fn rearrangements(rows in 0usize..4, a in 0usize..4, b in 1usize..4, seed: u64) {
        adjoint_check([rows, a], seed, |x| concat(&[x, x * 2.0], 1));
        adjoint_check([rows, a + b], seed, |x| split(x, 1, &[a, b])[1]);
        adjoint_check([rows, a], seed, |x| x.sum());
    }
}
