//! Attention with weights that fall with the distance in time.

use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::parallel;

/// e^(-1/e), the weight of the next snippet.
fn decay() -> f64 {
    (-1.0 / std::f64::consts::E).exp()
}

#[derive(Debug)]
struct DecayAttention;

/// One over the sum of the weights of snippet j over all `n`: two geometric series.
fn shares<T: Real>(n: usize) -> Vec<T> {
    let r = decay();
    let series = |terms: usize| (1.0 - r.powi(terms as i32)) / (1.0 - r);
    (0..n).map(|j| T::from_f64(1.0 / (series(j + 1) + series(n - j) - 1.0))).collect()
}

/// `out_i = sum over j of r^|i - j| (before_j x_j) after_i` for one batch entry, by a recursion from each end.
fn filter<T: Real>(x: &[T], width: usize, before: impl Fn(usize) -> T, after: impl Fn(usize) -> T, out: &mut [T]) {
    let (r, n) = (T::from_f64(decay()), x.len() / width);
    let mut carried = vec![T::ZERO; width];
    for t in 0..n {
        let (row, scale) = (t * width..(t + 1) * width, before(t));
        for ((carried, x), out) in carried.iter_mut().zip(&x[row.clone()]).zip(&mut out[row]) {
            *carried = *carried * r + *x * scale;
            *out = *carried;
        }
    }
    carried.fill(T::ZERO);
    for t in (0..n).rev() {
        let (row, scale, share) = (t * width..(t + 1) * width, before(t), after(t));
        for ((carried, x), out) in carried.iter_mut().zip(&x[row.clone()]).zip(&mut out[row]) {
            *out = (*out + *carried * r) * share;
            *carried = *carried * r + *x * scale;
        }
    }
}

impl<T: Real> Op<T> for DecayAttention {
    fn name(&self) -> &'static str {
        "decay_attention"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 1 && ins[0].rank() == 3, "x [B, T, D]");
        Ok(Shapes::one(ins[0]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let [_, time, width] = [0, 1, 2].map(|axis| ins[0].shape()[axis]);
        let shares = shares(time);
        parallel::for_chunks(&mut outs[0], time * width, |b, out| {
            filter(&ins[0][b * time * width..][..out.len()], width, |t| shares[t], |_| T::ONE, out);
        });
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, pool, .. } = at;
        let Some(dx) = &mut dins[0] else { return };
        let [_, time, width] = [0, 1, 2].map(|axis| ins[0].shape()[axis]);
        let shares = shares(time);
        let mut filtered = pool.buffer::<T>(douts[0].len());
        parallel::for_chunks(&mut filtered, time * width, |b, out| {
            filter(&douts[0][b * time * width..][..out.len()], width, |_| T::ONE, |t| shares[t], out);
        });
        dx.add(&filtered);
    }
}

/// Attention whose weights fall with the distance in time: `y_i = sum over j of A_ij x_j`,
/// `A_ij = exp(-|i - j| / e) / Z_j`, where `Z_j` is the sum of row *j*, as in the public code of UR-DMU (Zhou et al.,
/// arXiv 2302.05160).
///
/// x `[B, T, D]` gives the same shape. Differentiable. Takes time and memory in proportion to T: the weights are two
/// geometric series.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// // What a snippet gives to all others, itself included, adds up to 1.
/// let y = weaver_vad::ops::decay_attention(tape.constant(&[0.0, 0.0, 1.0, 0.0], [1, 4, 1])).to_vec();
/// assert!((y.iter().sum::<f64>() - 1.0).abs() < 1e-12 && y[1] == y[3]);
/// ```
#[track_caller]
pub fn decay_attention<T: Real>(x: Var<'_, T>) -> Var<'_, T> {
    let [y] = x.tape().apply(DecayAttention, &[x]);
    y
}
