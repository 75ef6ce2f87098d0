//! The engine for `f32` and `f64`, compiled here once.
//!
//! All of it is generic, so that every crate, test and example above would compile the ops it uses once more. Naming an
//! instance has it compiled here. The dev profile, where crates are optimized one by one, links all of them. Release
//! builds specialize each use, except of functions that are `#[inline(never)]`: those are linked, too. They are the
//! ones that have much code below them, as kernels and [`Tape::try_apply`], which is compiled for each type of op.
//! Nobody trains in `f64`, so that release builds have no use for its instances.

use crate::{Params, Tape, Var, ops};
use std::hint::black_box;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A static is compiled although nothing reads it.
#[expect(dead_code)]
static INSTANCES: &[fn()] = &[
    for_f32,
    #[cfg(debug_assertions)]
    for_f64,
];

macro_rules! instances {
    ($name:ident, $t:ty) => {
        fn $name() {
            black_box([
                ops::attention::<$t> as *const (),
                ops::concat::<$t> as *const (),
                ops::conv2d::<$t> as *const (),
                ops::conv_transpose2d::<$t> as *const (),
                ops::cross_entropy::<$t> as *const (),
                ops::huber::<$t> as *const (),
                ops::linear::<$t> as *const (),
                ops::scale_residual::<$t> as *const (),
                ops::split::<$t> as *const (),
                ops::straight_through::<$t> as *const (),
                Var::<$t>::abs as *const (),
                Var::<$t>::avg_pool_same as *const (),
                Var::<$t>::backward as *const (),
                Var::<$t>::bicubic as *const (),
                Var::<$t>::bicubic_antialias as *const (),
                Var::<$t>::bilinear as *const (),
                Var::<$t>::clamp as *const (),
                Var::<$t>::detach as *const (),
                Var::<$t>::exp as *const (),
                Var::<$t>::gather_rows as *const (),
                Var::<$t>::gelu as *const (),
                Var::<$t>::layer_norm as *const (),
                Var::<$t>::ln as *const (),
                Var::<$t>::log_softmax as *const (),
                Var::<$t>::matmul as *const (),
                Var::<$t>::mean as *const (),
                Var::<$t>::mean_axis as *const (),
                Var::<$t>::normalize_rows as *const (),
                Var::<$t>::permute as *const (),
                Var::<$t>::relu as *const (),
                Var::<$t>::rope2d as *const (),
                Var::<$t>::scatter_add_rows as *const (),
                Var::<$t>::sigmoid as *const (),
                Var::<$t>::silu as *const (),
                Var::<$t>::slice as *const (),
                Var::<$t>::softmax as *const (),
                Var::<$t>::softplus as *const (),
                Var::<$t>::sqrt as *const (),
                Var::<$t>::square as *const (),
                Var::<$t>::sum as *const (),
                Var::<$t>::sum_axis as *const (),
                Var::<$t>::tanh as *const (),
                Var::<$t>::to_vec as *const (),
                <Var<$t> as Add>::add as *const (),
                <Var<$t> as Add<f64>>::add as *const (),
                <Var<$t> as Sub>::sub as *const (),
                <Var<$t> as Sub<f64>>::sub as *const (),
                <Var<$t> as Mul>::mul as *const (),
                <Var<$t> as Mul<f64>>::mul as *const (),
                <Var<$t> as Div>::div as *const (),
                <Var<$t> as Div<f64>>::div as *const (),
                <Var<$t> as Neg>::neg as *const (),
                Tape::<$t>::new as *const (),
                Tape::<$t>::reset as *const (),
                Tape::<$t>::scalar as *const (),
                Tape::<$t>::param as *const (),
                Tape::<$t>::param_grad as *const (),
                Tape::<$t>::memory as *const (),
                Params::<$t>::value_mut as *const (),
            ]);
        }
    };
}
instances!(for_f32, f32);
#[cfg(debug_assertions)]
instances!(for_f64, f64);
