//! A loss that teaches the router where the render differs from the photo.

use weaver_autograd::{Real, Var};
use weaver_kernels::parallel;

/// Added to the squared error before the logarithm: errors well below 1/100 count as none.
const FLOOR: f64 = 1e-4;

/// Writes 0.5 ln(smoothed squared error + 1e-4) of every pixel, centered over the scene, to `target`: large where the
/// render is worst.
///
/// `squared_error` `[V, H, W]` is the mean over the channels of (render - image)^2 in the views of one scene; it is
/// smoothed by a 3x3 mean of the pixels inside the image. `target` gets the same shape and mean 0.
pub fn error_target<T: Real>(squared_error: &[T], size: [usize; 2], target: &mut [T]) {
    let [height, width] = size;
    assert_eq!(squared_error.len(), target.len(), "error_target: as many targets as errors");
    parallel::for_chunks(target, height * width, |view, target| {
        let error = &squared_error[view * height * width..][..target.len()];
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let (rows, columns) = (y.saturating_sub(1)..(y + 2).min(height), x.saturating_sub(1)..(x + 2).min(width));
            let count = rows.len() * columns.len();
            let sum: T = rows.flat_map(|y| &error[y * width..][columns.clone()]).copied().sum();
            let mean = sum / T::from_usize(count);
            target[y * width + x] = T::from_f64(0.5) * (mean + T::from_f64(FLOOR)).ln();
        }
    });
    let center = target.iter().map(|t| t.to_f64()).sum::<f64>() / target.len().max(1) as f64;
    target.iter_mut().for_each(|t| *t -= T::from_f64(center));
}

/// The mean squared difference between the router's score and the [`error_target`] of each pixel, a scalar.
///
/// `score` `[V, H, W]` (or `[P]` with as many pixels) is the router's logit of expert 1 minus the logit of expert 0;
/// `squared_error` `[V, H, W]` belongs to the context views of the same scene. Differentiable in the score; the error
/// is held constant. Give one scene at a time: the target is centered over all pixels given; with `among`, over these
/// alone, which then are all that count.
#[track_caller]
pub fn error_regression<'t, T: Real>(
    score: Var<'t, T>,
    squared_error: Var<'t, T>,
    among: Option<&[u32]>,
) -> Var<'t, T> {
    let shape = squared_error.shape();
    let fits = shape.rank() == 3 && score.shape().len() == shape.len();
    let found = [score.shape(), shape];
    score.tape().ensure_shapes(fits, "error_regression", "a score and an error [V, H, W] for each pixel", &found);
    let target = score.tape().constant_with(shape, |target| {
        error_target(&squared_error.value(), [shape[1], shape[2]], target);
    });
    let Some(among) = among else { return super::mse(score.reshape(shape), target) };
    let center = among.iter().map(|p| target.value()[*p as usize].to_f64()).sum::<f64>() / among.len().max(1) as f64;
    let [score, target] = [score, target].map(|x| x.reshape([shape.len()]).gather_rows(among));
    super::mse(score, target - center)
}
