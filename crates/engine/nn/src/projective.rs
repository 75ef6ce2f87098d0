//! Attention that depends on the camera of each token.

use weaver_autograd::ops::{self, RopeTable};
use weaver_autograd::{Real, Var};

/// Projections of V views for [`projective_attention`]: world to normalized image, as 4 x 4 matrices, and back.
#[derive(Clone, Copy, Debug)]
pub struct Projections<'t, T: Real = f32> {
    /// P, `[B, V, 4, 4]`.
    pub matrices: Var<'t, T>,
    /// Its inverse, `[B, V, 4, 4]`.
    pub inverses: Var<'t, T>,
}

/// Attention over the tokens of several views that sees cameras only by how they stand to one another (PRoPE, Li et
/// al., arXiv 2507.10496).
///
/// The first half of a head is four-vectors, each multiplied by a 4 x 4 matrix of the token's camera; the second half
/// is turned by the token's position: q' = (P^T, F) q, k' = (P^-1, F) k, v' = (P^-1, F) v, and the result is (P, F^-1)
/// softmax(q' k' / sqrt h) v'. So two tokens meet through P_i P_j^-1: a rigid motion of the world changes nothing.
///
/// q, k and v are `[B, V n, heads, h]`, the n tokens of a view one after the other, h divisible by 8; `turns` has the
/// positions of V n tokens for heads of h / 2. The result has the shape of q. Differentiable in q, k, v and the
/// matrices.
///
/// ```
/// use weaver_autograd::{Tape, ops::RopeTable};
/// use weaver_nn::{Projections, projective_attention};
/// let tape = Tape::<f64>::new();
/// let turns = RopeTable::new(&[[0, 0], [0, 0]], 4, 100.0);
/// let identity: Vec<f64> = (0..32).map(|i| f64::from(u8::from(i % 16 % 5 == 0))).collect();
/// let p = tape.constant(&identity, [1, 2, 4, 4]);
/// let [q, k] = [0.1, 0.2].map(|x| tape.constant(&[x; 16], [1, 2, 1, 8]));
/// let v = tape.constant(&[[1.0; 8], [3.0; 8]].concat(), [1, 2, 1, 8]);
/// // Two views by one camera, and tokens that are all alike: the mean.
/// let y = projective_attention(q, k, v, &Projections { matrices: p, inverses: p }, &turns);
/// assert!(y.to_vec().iter().all(|y| (y - 2.0).abs() < 1e-12));
/// ```
///
/// # Panics
/// When shapes do not fit.
#[track_caller]
pub fn projective_attention<'t, T: Real>(
    q: Var<'t, T>,
    k: Var<'t, T>,
    v: Var<'t, T>,
    cameras: &Projections<'t, T>,
    turns: &RopeTable<T>,
) -> Var<'t, T> {
    let Projections { matrices, inverses } = *cameras;
    let turned = turns.inverse();
    let q = mapped(q, matrices, false, &turned);
    let [k, v] = [k, v].map(|x| mapped(x, inverses, true, &turned));
    mapped(ops::attention(q, k, v, scale(q)), matrices, true, turns)
}

/// Attention over the tokens of one view, whose queries and keys are turned by their positions: softmax(F q F k / sqrt
/// h) v.
///
/// As [rotary embedding](Var::rope2d), turned the other way, which is how weights that were trained beside
/// [`projective_attention`] have it. q, k and v are `[B, n, heads, h]`, h divisible by 4; the result has their shape.
/// Differentiable in all three.
///
/// # Panics
/// When shapes do not fit.
#[track_caller]
pub fn turned_attention<'t, T: Real>(q: Var<'t, T>, k: Var<'t, T>, v: Var<'t, T>, turns: &RopeTable<T>) -> Var<'t, T> {
    let turned = turns.inverse();
    ops::attention(q.rope2d(&turned), k.rope2d(&turned), v, scale(q))
}

fn scale<T: Real>(q: Var<'_, T>) -> f64 {
    1.0 / (q.shape().last() as f64).sqrt()
}

/// The first half of each head as four-vectors x, which become M x, or M^T x unless `upright`; the second half turned.
#[track_caller]
fn mapped<'t, T: Real>(x: Var<'t, T>, matrices: Var<'t, T>, upright: bool, turns: &RopeTable<T>) -> Var<'t, T> {
    let (shape, views) = (x.shape(), matrices.shape()[1]);
    let fits = shape.rank() == 4 && shape[1].is_multiple_of(views) && shape[3].is_multiple_of(8);
    x.tape().ensure_shapes(
        fits,
        "projective_attention",
        "heads [B, V n, heads, 8 k], matrices [B, V, 4, 4]",
        &[shape, matrices.shape()],
    );
    let half = shape[3] / 2;
    let vectors = shape[1] / views * shape[2] * half / 4;
    let first = x.slice(3, 0, half).reshape([shape[0], views, vectors, 4]).matmul_with(matrices, false, upright);
    let second = x.slice(3, half, half).rope2d(turns);
    ops::concat(&[first.reshape(second.shape()), second], 3)
}
