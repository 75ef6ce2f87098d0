//! Reordering of axes.

use crate::{Backward, MAX_RANK, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, permute};

#[derive(Debug)]
struct Permute {
    axes: Shape,
}

/// A shape and an order of its axes with leading axes of length 1, which stay in front.
fn padded(shape: Shape, axes: &[usize]) -> ([usize; MAX_RANK], [usize; MAX_RANK]) {
    let added = MAX_RANK - axes.len();
    let (mut dims, mut order) = ([1; MAX_RANK], std::array::from_fn(|axis| axis));
    dims[added..].copy_from_slice(shape.dims());
    order[added..].iter_mut().zip(axes).for_each(|(to, axis)| *to = added + axis);
    (dims, order)
}

impl<T: Real> Op<T> for Permute {
    fn name(&self) -> &'static str {
        "permute"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let axes = self.axes.dims();
        ensure_shape!(
            ins.len() == 1 && axes.len() == ins[0].rank() && (0..axes.len()).all(|a| axes.contains(&a)),
            "a tensor whose axes are those of {axes:?}"
        );
        let mut dims = [0; MAX_RANK];
        dims.iter_mut().zip(axes).for_each(|(dim, &axis)| *dim = ins[0][axis]);
        Ok(Shapes::one(Shape::new(&dims[..axes.len()])))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let (dims, axes) = padded(ins[0].shape(), self.axes.dims());
        permute::permute(dims, axes, &ins[0], (&mut outs[0], T::ZERO));
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        if let Some(dx) = &mut dins[0] {
            let (dims, axes) = padded(ins[0].shape(), self.axes.dims());
            let permuted = axes.map(|axis| dims[axis]);
            permute::permute(permuted, permute::inverse(axes), &douts[0], dx.target());
        }
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// Permutes the axes: axis i of the result is axis `axes[i]` of `self`. Copies the elements.
    ///
    /// x `[d_0, .., d_n]` gives `[d_axes[0], .., d_axes[n]]`. Differentiable. Panics if `axes` does not name every axis
    /// once.
    ///
    /// ```
    /// use weaver_autograd::Tape;
    /// let tape = Tape::<f32>::new();
    /// let x = tape.constant(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [2, 3]);
    /// assert_eq!(x.permute(&[1, 0]).to_vec(), [1.0, 4.0, 2.0, 5.0, 3.0, 6.0]);
    /// ```
    #[track_caller]
    pub fn permute(self, axes: &[usize]) -> Self {
        let [y] = self.tape().apply(Permute { axes: Shape::new(axes) }, &[self]);
        y
    }
}
