//! Single-level wavelet analysis, as an op.

use crate::filter::Wavelet;
use crate::transform::{Border, add_transposed, analyze};
use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};

#[derive(Debug)]
struct Analysis {
    wavelet: Wavelet,
}

/// The last two dimensions of a shape that has been checked to have them.
pub(crate) fn image_size(shape: Shape) -> [usize; 2] {
    [shape[shape.rank() - 2], shape.last()]
}

impl<T: Real> Op<T> for Analysis {
    fn name(&self) -> &'static str {
        "wavelet_analysis"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        ensure_shape!(ins.len() == 1 && (2..6).contains(&ins[0].rank()), "images [.., H, W] of rank 2 to 5");
        let [height, width] = image_size(ins[0]);
        ensure_shape!(height > 0 && width > 0, "images [.., H, W] with pixels");
        let (leading, out) =
            (&ins[0].dims()[..ins[0].rank() - 2], [4, self.wavelet.output_len(height), self.wavelet.output_len(width)]);
        let mut dims = [0; 6];
        dims[..leading.len()].copy_from_slice(leading);
        dims[leading.len()..leading.len() + 3].copy_from_slice(&out);
        Ok(Shapes::one(&dims[..leading.len() + 3]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        analyze(self.wavelet, Border::Symmetric, &ins[0], image_size(ins[0].shape()), &mut outs[0]);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        if let Some(dx) = &mut dins[0] {
            add_transposed(self.wavelet, Border::Symmetric, &douts[0], image_size(ins[0].shape()), dx.accumulator());
        }
    }
}

/// The four sub-bands of a single-level 2-D wavelet transform of images.
///
/// Images `[.., H, W]` give `[.., 4, h, w]`:
/// `y[k] = sum_j f[L-1-j] x[2k + j - (L - 2)]` along x, then along y, with half-sample symmetric extension (edge sample
/// repeated); h = floor((H + L - 1) / 2), likewise w. Bands in order: (x low, y low), (x low, y high), (x high, y low),
/// (x high, y high); the last three are PyWavelets' (cH, cV, cD). Linear; its gradient is the exact adjoint, mirrored
/// border terms included. Panics unless x has 2 to 5 dimensions and at least one pixel per image.
///
/// ```
/// use weaver_autograd::Tape;
/// use weaver_wavelet::{Wavelet, analysis};
/// let tape = Tape::<f64>::new();
/// let x = tape.leaf(&[1.0, 1.0, 3.0, 3.0], [2, 2]);
/// let bands = analysis(x, Wavelet::Haar);
/// assert_eq!(bands.shape().dims(), [4, 1, 1]);
/// assert!((bands.to_vec()[0] - 4.0).abs() < 1e-12 && bands.to_vec()[2].abs() < 1e-12);
/// ```
#[track_caller]
pub fn analysis<T: Real>(x: Var<'_, T>, wavelet: Wavelet) -> Var<'_, T> {
    let [bands] = x.tape().apply(Analysis { wavelet }, &[x]);
    bands
}
