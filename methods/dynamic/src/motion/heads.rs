//! Features to offsets of raw Gaussians.

use weaver_autograd::{Real, Var};
use weaver_nn::{Builder, Context, Linear, WeightInit};

/// A linear layer on features, then for mean, scale, quaternion and opacity each relu, a layer, relu, a layer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OffsetHeads {
    trunk: Linear,
    heads: [[Linear; 2]; 4],
}

impl OffsetHeads {
    /// Builds `trunk` and `mean`, `scale`, `quat` and `opacity`, each `.0` and `.1`. The last layers begin at zero,
    /// without motion.
    pub fn new<T: Real>(b: &mut Builder<'_, T>, inputs: usize, width: usize) -> Self {
        let trunk = Linear::new(b.scope("trunk"), inputs, width, WeightInit::FanIn);
        let heads = [("mean", 3), ("scale", 3), ("quat", 4), ("opacity", 1)].map(|(name, outputs)| {
            let first = Linear::new(b.scope(format_args!("{name}.0")), width, width, WeightInit::FanIn);
            let last = Linear::new(b.scope(format_args!("{name}.1")), width, outputs, WeightInit::FanIn);
            let zeroed = [Some(last.weight), last.bias];
            zeroed.into_iter().flatten().for_each(|id| b.value_mut(id).fill(T::ZERO));
            [first, last]
        });
        Self { trunk, heads }
    }

    /// `raw` plus the offsets from features `[N, inputs]`.
    pub fn added<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        features: Var<'t, T>,
        raw: [Var<'t, T>; 4],
    ) -> [Var<'t, T>; 4] {
        let x = self.trunk.forward(cx, features).relu();
        std::array::from_fn(|i| {
            let [first, last] = &self.heads[i];
            raw[i] + last.forward(cx, first.forward(cx, x).relu())
        })
    }
}
