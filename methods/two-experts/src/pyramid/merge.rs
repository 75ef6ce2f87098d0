//! From one level of the pyramid to the next: half as many rows and columns, twice as wide.

use weaver_autograd::{ParamId, Real, Var, ops};
use weaver_nn::{Builder, Context, Linear, WeightInit};

/// Patches by a 2 x 2 convolution of stride 2 for each channel, which makes two of it; registers by a linear layer.
/// Parameters `merge_block<i>.{weight [2 D, 1, 2, 2], bias}` and `resize_block<i>`.
#[derive(Clone, Copy, Debug)]
pub struct Merge {
    weight: ParamId,
    bias: ParamId,
    registers: Linear,
}

impl Merge {
    /// From tokens of `width` numbers to tokens of twice the width; `level` is the finer one, from 1.
    pub fn new<T: Real>(b: &mut Builder<'_, T>, level: usize, width: usize) -> Self {
        let (weights, biases) = WeightInit::FanIn.of(4);
        let mut patches = b.scope(format_args!("merge_block{level}"));
        let weight = patches.add("weight", [2 * width, 1, 2, 2], weights);
        let bias = patches.add("bias", [2 * width], biases);
        let registers = b.scope(format_args!("resize_block{level}"));
        Self { weight, bias, registers: Linear::new(registers, width, 2 * width, WeightInit::FanIn) }
    }

    /// Tokens `[V, registers + rows columns, D]` to `[V, registers + rows columns / 4, 2 D]`; `grid` is rows, columns.
    pub fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        x: Var<'t, T>,
        registers: usize,
        grid: [usize; 2],
    ) -> Var<'t, T> {
        let ([views, _, width], [rows, columns]) = ([0, 1, 2].map(|axis| x.shape()[axis]), grid);
        let merged = views * rows * columns / 4;
        // A product of four numbers with two rows of four weights, for each channel.
        let squares = x.slice(1, registers, rows * columns).reshape([views * rows / 2, 2, columns / 2, 2, width]);
        let squares = squares.permute(&[4, 0, 2, 1, 3]).reshape([width, merged, 4]);
        let weights = cx.param(self.weight).reshape([width, 2, 4]);
        let patches = squares.matmul_with(weights, false, true).permute(&[1, 0, 2]).reshape([merged, 2 * width]);
        let bias = cx.param(self.bias).reshape([1, 2 * width]).expand(patches.shape());
        let patches = (patches + bias).reshape([views, merged / views, 2 * width]);
        ops::concat(&[self.registers.forward(cx, x.slice(1, 0, registers)), patches], 1)
    }
}
