//! Tikhonov guidance: more decided opacities while features are lifted and drawn.

use crate::error::LiftError;
use weaver_kernels::Real;

/// Bound of the logits that are scaled.
const MOST: f64 = 13.8;

/// Opacities o, in `[0, 1]`, become `sigma(lambda logit o)`, logits limited to +-13.8; lambda = 1 changes no bit.
///
/// Opacities above one half rise with lambda > 1, others fall; the effect on the number of Gaussians in a pixel depends
/// on the majority: [`Coverage::off_diagonal`](crate::Coverage::off_diagonal) measures it.
///
/// # Errors
/// A lambda that is not positive and finite.
///
/// # Source
/// Xiong et al., Splat Feature Solver, 2026.
///
/// ```
/// let mut opacities = [0.5, 0.8];
/// weaver_lift::guide(&mut opacities, 2.0)?;
/// assert!(opacities[0] == 0.5 && (opacities[1] - 16.0 / 17.0_f64).abs() < 1e-12);
/// # Ok::<(), weaver_lift::LiftError>(())
/// ```
pub fn guide<T: Real>(opacities: &mut [T], lambda: f64) -> Result<(), LiftError> {
    if !(lambda > 0.0 && lambda.is_finite()) {
        return Err(LiftError::Setting { key: "lambda", expected: "a positive number", found: lambda });
    }
    if lambda == 1.0 {
        return Ok(());
    }
    for opacity in opacities {
        let o = opacity.to_f64();
        let logit = (o / (1.0 - o)).ln().clamp(-MOST, MOST);
        *opacity = T::from_f64(1.0 / (1.0 + (-lambda * logit).exp()));
    }
    Ok(())
}
