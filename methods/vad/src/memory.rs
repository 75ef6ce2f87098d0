//! UR-DMU's memories of normal and of anomalous snippets.

use crate::top_k::top_k;
use weaver_autograd::ops::top_k_mean;
use weaver_autograd::{ParamId, Real, Var};
use weaver_nn::{Builder, Context, Init};

/// Memory entries, compared with snippets; parameter `memory_block` `[entries, width]`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Memory {
    block: ParamId,
}

/// Answer of a memory to snippets.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Recalled<'t, T: Real> {
    /// Similarity of the snippets to the memory, `[B, T]`, in (0, 1).
    pub attention: Var<'t, T>,
    /// The memory's reconstruction of the snippets, `[B, T, width]`.
    pub augmented: Var<'t, T>,
}

impl Memory {
    pub fn new<T: Real>(mut builder: Builder<'_, T>, entries: usize, width: usize) -> Self {
        Self { block: builder.add("memory_block", [entries, width], Init::fan_in(width)) }
    }

    /// With s = sigmoid(x M^T / sqrt(width)): the mean of a snippet's largest entries of s, and s M. x is
    /// `[B, T, width]`.
    pub fn recall<'t, T: Real>(&self, cx: Context<'t, '_, T>, x: Var<'t, T>) -> Recalled<'t, T> {
        let entries = cx.param(self.block);
        let (count, width) = (entries.shape()[0], entries.shape()[1]);
        let similarity = (x.matmul_with(entries, false, true) * (1.0 / (width as f64).sqrt())).sigmoid();
        Recalled { attention: top_k_mean(similarity, top_k(count)), augmented: similarity.matmul(entries) }
    }
}
