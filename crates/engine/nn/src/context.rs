//! The context in which a layer runs: a tape and the model's parameters.

use std::fmt::Display;
use weaver_autograd::{Outputs, ParamId, Params, Real, Tape, Var};

/// A tape and the parameters used on it, passed by value to the `forward` of every layer.
///
/// ```
/// use weaver_autograd::{Params, Tape};
/// use weaver_nn::Context;
/// let mut params = Params::<f32>::new();
/// let w = params.add("w", [1], vec![2.0]);
/// let tape = Tape::new();
/// let cx = Context::new(&tape, &params);
/// assert_eq!((cx.param(w) * 3.0).item(), 6.0);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Context<'t, 'p, T: Real = f32> {
    /// The tape that records.
    pub tape: &'t Tape<T>,
    /// The model's parameters.
    pub params: &'p Params<T>,
    /// True if transformer blocks keep nothing but their input, and are computed again on the way back.
    pub recompute: bool,
}

impl<'t, 'p, T: Real> Context<'t, 'p, T> {
    /// Pairs a tape with parameters.
    pub fn new(tape: &'t Tape<T>, params: &'p Params<T>) -> Self {
        Self { tape, params, recompute: false }
    }

    /// The same, with transformer blocks that are computed again on the way back, or not.
    #[must_use]
    pub fn recomputing(self, recompute: bool) -> Self {
        Self { recompute, ..self }
    }

    /// A parameter as a leaf of the tape.
    pub fn param(&self, id: ParamId) -> Var<'t, T> {
        self.tape.param(self.params, id)
    }

    /// Runs a part of the model below the model path ([`Tape::part`]): only its result stays in memory.
    pub fn part<R: Outputs<T>>(&self, name: impl Display, f: impl FnOnce() -> R) -> R {
        self.tape.part(name, f)
    }

    /// Runs a layer at its own path ([`Tape::part_at`]): only its result stays in memory. The path comes from the name
    /// of the layer's parameter `id`, whose own name within the layer is `name`: `encoder.block.3.attn.qkv` from
    /// `weight` of `encoder.block.3.attn.qkv.weight`.
    pub fn layer<R: Outputs<T>>(&self, id: ParamId, name: &str, f: impl FnOnce() -> R) -> R {
        let path = self.params.get(id).name().strip_suffix(name).unwrap_or_default();
        self.tape.part_at(path.trim_end_matches('.'), f)
    }
}
