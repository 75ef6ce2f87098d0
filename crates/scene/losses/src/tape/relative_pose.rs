//! Losses on cameras that a common motion of the world does not change.

use weaver_autograd::{Real, Shape, Var, apply_pointwise, pointwise};

/// Distance of cosines from 1 and -1, where the slope of the arc cosine is infinite.
const MARGIN: f64 = 1e-6;

pointwise!(
    /// The angle of a rotation with this trace.
    Angle, 1, |trace| {
        let cosine = ((trace - 1.0) * 0.5).max(MARGIN - 1.0).min(1.0 - MARGIN);
        ((-cosine + 1.0) / (cosine + 1.0)).sqrt().atan() * 2.0
    }
);

pointwise!(
    /// (a - b)^2
    SquaredError, 2, |a, b| (a - b) * (a - b)
);

/// The angles between rotations, radians: arccos((tr(A^T B) - 1) / 2), the cosine at most 1 - 1e-6 in size.
///
/// Rotations are rows of nine numbers `[.., 9]`; the result is `[..]`. Between equal ones it is the margin's floor,
/// 1.41421e-3, with gradient 0. Differentiable in both, the nine numbers taken as independent. Source: 2Xplat, Jeong et
/// al., arXiv 2603.21064.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let a = tape.constant(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], [1, 9]);
/// let b = tape.constant(&[0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0], [1, 9]);
/// let angle = weaver_losses::rotation_angles(a, b).item();
/// assert!((angle - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
/// ```
#[track_caller]
pub fn rotation_angles<'t, T: Real>(a: Var<'t, T>, b: Var<'t, T>) -> Var<'t, T> {
    let shape = a.shape();
    let fits = shape.last() == 9 && shape == b.shape();
    a.tape().ensure_shapes(fits, "rotation_angles", "rotations [.., 9] twice", &[shape, b.shape()]);
    let trace = (a * b).sum_axis(shape.rank() - 1);
    apply_pointwise(Angle, [trace])
}

/// The mean squared error of focal lengths in image widths, a scalar: mean over views and (fx, fy) of ((f - g) / W)^2.
///
/// `predicted` and `truth` are fx, fy, cx, cy in pixels, `[.., 4]`. Differentiable in both; principal points do not
/// count. Source: 2Xplat, Jeong et al., arXiv 2603.21064.
///
/// ```
/// use weaver_autograd::Tape;
/// let tape = Tape::<f64>::new();
/// let [a, b] = [[6.0, 5.0, 0.0, 0.0], [5.0, 5.0, 9.0, 9.0]].map(|k| tape.constant(&k, [1, 4]));
/// assert!((weaver_losses::focal_error(a, b, 10).item() - 0.005).abs() < 1e-12);
/// ```
#[track_caller]
pub fn focal_error<'t, T: Real>(predicted: Var<'t, T>, truth: Var<'t, T>, width: usize) -> Var<'t, T> {
    let shape: Shape = predicted.shape();
    let fits = shape.last() == 4 && shape == truth.shape();
    predicted.tape().ensure_shapes(fits, "focal_error", "intrinsics [.., 4] twice", &[shape, truth.shape()]);
    let [predicted, truth] = [predicted, truth].map(|k| k.slice(shape.rank() - 1, 0, 2));
    apply_pointwise(SquaredError, [predicted, truth]).mean() * (1.0 / (width * width) as f64)
}
