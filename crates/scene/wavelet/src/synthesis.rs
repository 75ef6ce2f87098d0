//! Single-level wavelet synthesis, as an op.

use crate::filter::Wavelet;
use crate::transform::{Border, add_transposed, analyze};
use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};

#[derive(Debug)]
struct Synthesis {
    wavelet: Wavelet,
    size: [usize; 2],
}

impl<T: Real> Op<T> for Synthesis {
    fn name(&self) -> &'static str {
        "wavelet_synthesis"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let [height, width] = self.size;
        let expected = [4, self.wavelet.output_len(height), self.wavelet.output_len(width)];
        let rank = ins[0].rank();
        ensure_shape!(
            height > 0 && width > 0 && rank >= 3 && ins[0].dims()[rank - 3..] == expected,
            "sub-bands [.., {}, {}, {}] for images of {height} x {width}",
            expected[0],
            expected[1],
            expected[2]
        );
        let mut dims = [0; 6];
        dims[..rank - 3].copy_from_slice(&ins[0].dims()[..rank - 3]);
        dims[rank - 3..rank - 1].copy_from_slice(&self.size);
        Ok(Shapes::one(&dims[..rank - 1]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        outs[0].fill(T::ZERO);
        add_transposed(self.wavelet, Border::Zero, &ins[0], self.size, &mut outs[0]);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, pool, .. } = at;
        if let Some(dbands) = &mut dins[0] {
            let mut bands = pool.buffer(ins[0].len());
            analyze(self.wavelet, Border::Zero, &douts[0], self.size, &mut bands);
            dbands.add(&bands);
        }
    }
}

/// The images of `size` (H, W) that have the given sub-bands: the inverse of [`analysis`](crate::analysis()).
///
/// Bands `[.., 4, h, w]` give `[.., H, W]`:
/// `x[i] = sum_k f[L-1-(i + L - 2 - 2k)] y[k]` over both filters and axes: the transpose of the analysis without its
/// border terms, which the extension makes an inverse because the filters are orthonormal. Linear, with the exact
/// adjoint. Panics unless the bands have the shape that the analysis of such an image gives.
#[track_caller]
pub fn synthesis<T: Real>(bands: Var<'_, T>, wavelet: Wavelet, size: [usize; 2]) -> Var<'_, T> {
    let [x] = bands.tape().apply(Synthesis { wavelet, size }, &[bands]);
    x
}
