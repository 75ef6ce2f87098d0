//! The largest values of rows: their indices, and their mean as an op.

use crate::{Backward, Buffer, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::Real;

/// The indices of the `k` largest numbers of a row in descending order, of equal ones the first; all of a shorter row.
fn top_indices<T: Real>(row: &[T], k: usize) -> Vec<u32> {
    let mut order: Vec<u32> = (0..row.len() as u32).collect();
    let k = k.min(row.len());
    let descending = |a: &u32, b: &u32| {
        // NaN has a place in the order, too; -0 and 0 are equal.
        let [x, y] = [a, b].map(|i| row[*i as usize].to_f64() + 0.0);
        y.total_cmp(&x).then(a.cmp(b))
    };
    if k > 0 && k < row.len() {
        order.select_nth_unstable_by(k - 1, descending);
    }
    order.truncate(k);
    order.sort_by(descending);
    order
}

#[derive(Debug)]
struct TopKMean {
    k: usize,
    /// For each row the indices of its `k` largest numbers in the whole tensor.
    chosen: Option<Buffer<u32>>,
}

impl<T: Real> Op<T> for TopKMean {
    fn name(&self) -> &'static str {
        "top_k_mean"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(
            ins.len() == 1 && ins[0].rank() > 0 && self.k > 0 && ins[0].last() >= self.k,
            "x [.., N] with N of at least {}, which is at least 1",
            self.k
        );
        Ok(Shapes::one(ins[0].without_axis(ins[0].rank() - 1)))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], pool: &Pool) {
        let (width, k) = (ins[0].shape().last(), self.k);
        let mut chosen = pool.buffer(outs[0].len() * k);
        let rows = ins[0].chunks_exact(width).zip(chosen.chunks_exact_mut(k)).zip(outs[0].iter_mut());
        for (row, ((x, chosen), y)) in rows.enumerate() {
            chosen.copy_from_slice(&top_indices(x, k));
            *y = chosen.iter().map(|i| x[*i as usize]).sum::<T>() / T::from_usize(k);
            chosen.iter_mut().for_each(|i| *i += (row * width) as u32);
        }
        self.chosen = Some(chosen);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { douts, dins, .. } = at;
        let Some(dx) = &mut dins[0] else { return };
        let chosen = self.chosen.as_ref().expect("the forward pass came first");
        let dx = dx.accumulator();
        for (chosen, dy) in chosen.chunks_exact(self.k).zip(douts[0].iter()) {
            chosen.iter().for_each(|i| dx[*i as usize] += *dy / T::from_usize(self.k));
        }
    }
}

/// The mean of the k largest numbers of each row, of equal ones the first.
///
/// x `[.., N]` gives `[..]`. Differentiable where the k-th and the next number differ. Panics unless 0 < k <= N.
///
/// ```
/// use weaver_autograd::{Tape, ops};
/// let tape = Tape::<f32>::new();
/// let x = tape.constant(&[1.0, 5.0, 3.0, 2.0, 2.0, 2.0], [2, 3]);
/// assert_eq!(ops::top_k_mean(x, 2).to_vec(), [4.0, 2.0]);
/// ```
#[track_caller]
pub fn top_k_mean<'t, T: Real>(x: Var<'t, T>, k: usize) -> Var<'t, T> {
    let [y] = x.tape().apply(TopKMean { k, chosen: None }, &[x]);
    y
}

/// For each batch entry the mean of the rows of x at the k largest of `by`, of equal ones the first.
///
/// x `[B, T, D]`, `by` `[B, T]` gives `[B, D]`. Differentiable in x; which rows is constant. Panics when shapes do not
/// fit.
#[track_caller]
pub fn mean_at_top_k<'t, T: Real>(x: Var<'t, T>, by: Var<'t, T>, k: usize) -> Var<'t, T> {
    let (shape, time) = (x.shape(), by.shape().last());
    let fits = shape.rank() == 3 && by.shape() == shape.without_axis(2);
    x.tape().ensure_shapes(fits, "mean_at_top_k", "x [B, T, D], by [B, T]", &[shape, by.shape()]);
    let of_row = |(b, row): (usize, &[T])| -> Vec<u32> {
        top_indices(row, k).into_iter().map(|i| i + (b * time) as u32).collect()
    };
    let indices: Vec<u32> = by.value().chunks_exact(time.max(1)).enumerate().flat_map(of_row).collect();
    let k = k.min(time);
    let rows = x.reshape([shape[0] * time, shape[2]]).gather_rows(&indices);
    rows.reshape([shape[0], k, shape[2]]).mean_axis(1)
}
