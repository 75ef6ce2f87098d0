//! Residual units and the blocks that fuse maps from coarse to fine.

use weaver_autograd::{Real, Var};
use weaver_nn::{Builder, Context, Conv2d, WeightInit};

/// Two 3x3 convolutions around which the *rectified* input is added: conv2(relu(conv1(relu x))) + relu(x).
///
/// Adding relu(x) instead of x follows the training of the published weights (there the first activation works in
/// place, so that the skip path sees its result).
#[derive(Clone, Debug)]
pub struct ResidualConvUnit {
    conv1: Conv2d,
    conv2: Conv2d,
}

impl ResidualConvUnit {
    /// Builds `conv1` and `conv2`.
    pub fn new<T: Real>(mut b: Builder<'_, T>, channels: usize) -> Self {
        Self {
            conv1: Conv2d::new(b.scope("conv1"), channels, channels, 3, WeightInit::FanIn),
            conv2: Conv2d::new(b.scope("conv2"), channels, channels, 3, WeightInit::FanIn),
        }
    }

    /// Maps `[N, C, h, w]` to the same shape.
    pub fn forward<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Var<'t, T> {
        cx.layer(self.conv1.weight, "conv1.weight", || {
            cx.tape
                .steps(|| x.relu())
                .then(|x| (x, self.conv1.forward(cx, x).relu()))
                .then(|(x, hidden)| self.conv2.forward(cx, hidden) + x)
                .end()
        })
    }
}

/// Adds a finer map to a coarser result, refines the sum and brings it to the next size.
#[derive(Clone, Debug)]
pub struct FusionBlock {
    of_finer: Option<ResidualConvUnit>,
    of_sum: ResidualConvUnit,
    out_conv: Conv2d,
}

impl FusionBlock {
    /// Builds `resConfUnit1` unless this is the `coarsest` block, `resConfUnit2` and `out_conv`.
    pub fn new<T: Real>(mut b: Builder<'_, T>, channels: usize, coarsest: bool) -> Self {
        Self {
            of_finer: (!coarsest).then(|| ResidualConvUnit::new(b.scope("resConfUnit1"), channels)),
            of_sum: ResidualConvUnit::new(b.scope("resConfUnit2"), channels),
            out_conv: Conv2d::new(b.scope("out_conv"), channels, channels, 1, WeightInit::FanIn),
        }
    }

    /// Fuses `map` with the output of the `coarser` block, at `size` (rows, columns).
    pub fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        map: Var<'t, T>,
        coarser: Option<Var<'t, T>>,
        size: [usize; 2],
    ) -> Var<'t, T> {
        let refine = || match (&self.of_finer, coarser) {
            (Some(unit), Some(coarser)) => self.of_sum.forward(cx, coarser + unit.forward(cx, map)),
            _ => self.of_sum.forward(cx, map),
        };
        cx.tape.steps(refine).then(|sum| resized(sum, size)).then(|sum| self.out_conv.forward(cx, sum)).end()
    }
}

/// Bilinear resize of maps `[N, C, h, w]` with aligned corners; nothing happens at equal size.
pub(crate) fn resized<T: Real>(maps: Var<'_, T>, size: [usize; 2]) -> Var<'_, T> {
    if [maps.shape()[2], maps.shape()[3]] == size { maps } else { maps.bilinear(size[0], size[1], true) }
}
