//! Dropout.

use weaver_autograd::{Real, Var};
use weaver_kernels::random::Stream;

/// Sets a share of numbers to 0 and makes the others larger by as much. Which ones is a function of the stream and the place.
#[derive(Clone, Copy, Debug)]
pub struct Dropout {
    /// The share, in [0, 1).
    pub rate: f64,
    /// Of the numbers that decide.
    pub stream: Stream,
}

impl Dropout {
    /// Applies it to x of any shape; `place` tells apart the places of a network. Differentiable in x. Without any, x as it is.
    pub fn apply<T: Real>(this: Option<Self>, x: Var<'_, T>, place: u64) -> Var<'_, T> {
        let Some(Self { rate, stream }) = this.filter(|dropout| dropout.rate > 0.0) else { return x };
        let (stream, kept) = (stream.fork(place), T::from_f64(1.0 / (1.0 - rate)));
        let mask = x.tape().constant_with(x.shape(), |mask| {
            let draw = |i: usize| if stream.uniform::<f64>(i as u64) < rate { T::ZERO } else { kept };
            mask.iter_mut().enumerate().for_each(|(i, mask)| *mask = draw(i));
        });
        x * mask
    }
}
