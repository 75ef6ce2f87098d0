//! Reordering of axes.

use super::strided::{Strided, contiguous};
use crate::{Grad, MAX_RANK, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::Real;

#[derive(Debug)]
struct Permute {
    axes: Shape,
}

/// Copies `x` with axis `axes[i]` of it as axis i of `out`.
fn permute<T: Real>(x: &View<'_, T>, axes: &[usize], out: &mut [T], beta: T) {
    let (dims, strides) = (permuted(x.shape(), axes), contiguous(x.shape()));
    let mut of_axis = [0; MAX_RANK];
    axes.iter().enumerate().for_each(|(i, &axis)| of_axis[i] = strides[axis]);
    Strided::new(dims, &of_axis[..axes.len()]).gather(x, out, beta);
}

fn permuted(shape: Shape, axes: &[usize]) -> Shape {
    let mut dims = [0; MAX_RANK];
    axes.iter().enumerate().for_each(|(i, &axis)| dims[i] = shape[axis]);
    Shape::new(&dims[..axes.len()])
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
        Ok(Shapes::one(permuted(ins[0], axes)))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        permute(&ins[0], self.axes.dims(), &mut outs[0], T::ZERO);
    }
    fn backward(
        &self,
        _ins: &[View<'_, T>],
        _outs: &[View<'_, T>],
        douts: &[View<'_, T>],
        dins: &mut [Option<Grad<'_, T>>],
        _pool: &Pool,
    ) {
        if let Some(dx) = &mut dins[0] {
            let axes = self.axes.dims();
            let mut inverse = [0; MAX_RANK];
            axes.iter().enumerate().for_each(|(i, &axis)| inverse[axis] = i);
            let (dx, beta) = dx.target();
            permute(&douts[0], &inverse[..axes.len()], dx, beta);
        }
    }
}

impl<'t, T: Real> Var<'t, T> {
    /// The tensor with its axes in another order: axis i of the result is axis `axes[i]` of `self`. Copies.
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
