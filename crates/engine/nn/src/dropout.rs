//! Dropout.

use weaver_autograd::{Real, Var};
use weaver_kernels::random::Stream;

/// Sets a share of numbers to 0 and multiplies the others by 1 / (1 - rate). The mask is a function of the stream and
/// the place.
///
/// ```
/// use weaver_autograd::Tape;
/// use weaver_kernels::random::Stream;
/// use weaver_nn::Dropout;
/// let tape = Tape::<f32>::new();
/// let x = tape.constant(&[1.0; 1000], [1000]);
/// let dropout = Dropout { rate: 0.2, stream: Stream::new(1, 0, "dropout") };
/// let kept = Dropout::apply(Some(dropout), x, 0).to_vec();
/// assert!(kept.iter().all(|x| [0.0, 1.25].contains(x)));
/// assert!((750..850).contains(&kept.iter().filter(|x| **x > 0.0).count()));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Dropout {
    /// The share, in [0, 1).
    pub rate: f64,
    /// The random numbers of the mask.
    pub stream: Stream,
}

impl Dropout {
    /// Applies it to x of any shape; `place` is a number of its own for each place in a network. Differentiable in x.
    /// Without dropout, x as it is.
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
