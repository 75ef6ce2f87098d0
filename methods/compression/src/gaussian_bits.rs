//! Quantizers and rates on the tape.

use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape, ops};
use weaver_codec::{GaussianRate, binary, gaussian_rate};
use weaver_kernels::parallel;

/// Numbers in a parallel task.
const GRAIN: usize = 2048;

#[derive(Debug)]
struct GaussianBits;

/// The rate of number i, from its value, mean, deviation and step.
fn rate<T: Real>(ins: &[View<'_, T>], i: usize) -> GaussianRate {
    let [x, mean, deviation, step] = [0, 1, 2, 3].map(|k| ins[k][i].to_f64());
    gaussian_rate(x, mean, deviation, step)
}

impl<T: Real> Op<T> for GaussianBits {
    fn name(&self) -> &'static str {
        "gaussian_bits"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let fits = ins.len() == 4 && ins.iter().all(|shape| *shape == ins[0]);
        ensure_shape!(fits, "numbers, means, deviations and steps of one shape");
        Ok(Shapes::one(ins[0]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        parallel::for_chunks(&mut outs[0], GRAIN, |chunk, out| {
            out.iter_mut().zip(GRAIN * chunk..).for_each(|(bits, i)| *bits = T::from_f64(rate(ins, i).bits));
        });
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, pool, .. } = at;
        let mut slopes = pool.buffer::<[T; 3]>(ins[0].len());
        parallel::for_chunks(&mut slopes, GRAIN, |chunk, out| {
            for (slopes, i) in out.iter_mut().zip(GRAIN * chunk..) {
                let GaussianRate { by_x, by_deviation, by_step, .. } = rate(ins, i);
                *slopes = [by_x, by_deviation, by_step].map(|slope| T::from_f64(slope) * douts[0][i]);
            }
        });
        // The derivative by the mean is the negative of the derivative by the value.
        for (din, (slope, sign)) in dins.iter_mut().zip([(0, T::ONE), (0, -T::ONE), (1, T::ONE), (2, T::ONE)]) {
            if let Some(din) = din {
                din.add_each(|i| sign * slopes[i][slope]);
            }
        }
    }
}

/// Bits of numbers that are rounded with steps `Q`, under normal distributions:
/// [`gaussian_rate`](weaver_codec::gaussian_rate) of each.
///
/// All of one shape. Differentiable in all four; below the least probability the derivative is constant.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let [x, mean, deviation, step] = [0.0, 0.0, 1.0, 2.0 * 0.674_489_75].map(|x| tape.leaf(&[x], [1]));
/// assert!((weaver_compression::gaussian_bits(x, mean, deviation, step).item() - 1.0).abs() < 1e-6);
/// ```
///
/// # Panics
/// For tensors of different shapes.
#[track_caller]
pub fn gaussian_bits<'t, T: Real>(
    x: Var<'t, T>,
    mean: Var<'t, T>,
    deviation: Var<'t, T>,
    step: Var<'t, T>,
) -> Var<'t, T> {
    let [bits] = x.tape().apply(GaussianBits, &[x, mean, deviation, step]);
    bits
}

/// 1 from zero on and -1 below, with gradient 1 on `|x| < 1`: the straight-through estimator of
/// [`binary`](weaver_codec::binary).
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let x = tape.leaf(&[-2.0, -0.5, 0.25], [3]);
/// let y = weaver_compression::binary_through(x);
/// y.sum().backward();
/// assert_eq!((y.to_vec(), x.grad().unwrap()), (vec![-1.0, -1.0, 1.0], vec![0.0, 1.0, 1.0]));
/// ```
pub fn binary_through<'t, T: Real>(x: Var<'t, T>) -> Var<'t, T> {
    let signs: Vec<T> = x.value().iter().map(|x| T::from_f64(binary(x.to_f64()))).collect();
    ops::straight_through(x.clamp(-1.0, 1.0), x.tape().constant(&signs, x.shape()))
}
