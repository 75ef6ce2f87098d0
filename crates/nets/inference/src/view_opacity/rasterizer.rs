//! Drawing of Gaussians whose opacities depend on the view.

use super::{DEGREE, ViewOpacity, direction, gaussians};
use std::sync::Arc;
use weaver_geometry::glam::DVec3;
use weaver_geometry::sh;
use weaver_kernels::Real;
use weaver_scene::{CameraSlices, GaussianSlices};
use weaver_splat::{
    AnyRasterizer, Cotangents, Gradients, Images, RasterError, RasterSettings, RasterStats, Rasterizer, Session, Target,
};

/// Draws Gaussians by another rasterizer, with the opacities that the camera sees in place of those that they are given
/// with, and differentiates through them: by the view matrix `[A | t]`, whose center is `-A^T t`, and by the means.
///
/// One view in a call. Gradients by opacities are refused, since those given take no part. Without a [`ViewOpacity`] it
/// is the other rasterizer.
#[derive(Clone, Debug)]
pub struct ViewOpacityRasterizer<T: Real> {
    /// The rasterizer.
    pub rasterizer: AnyRasterizer<T>,
    /// Opacity as a camera sees it.
    pub opacity: Option<Arc<ViewOpacity>>,
}

/// A session of the other rasterizer, and the data that forward leaves for backward.
#[derive(Debug)]
struct ViewOpacitySession<T: Real> {
    session: Box<dyn Session<T>>,
    opacity: Arc<ViewOpacity>,
    /// As seen, `[N]`.
    opacities: Vec<T>,
    /// The loss's gradient by them.
    slopes: Vec<T>,
}

impl<T: Real> Rasterizer<T> for ViewOpacityRasterizer<T> {
    fn session(&self) -> Box<dyn Session<T>> {
        let session = self.rasterizer.session();
        let Some(opacity) = self.opacity.clone() else { return session };
        Box::new(ViewOpacitySession { session, opacity, opacities: Vec::new(), slopes: Vec::new() })
    }
}

impl<T: Real> Session<T> for ViewOpacitySession<T> {
    fn forward(
        &mut self,
        gaussians: &GaussianSlices<'_, T>,
        cameras: &CameraSlices<'_, T>,
        settings: &RasterSettings,
        images: Images<'_, T>,
    ) -> Result<RasterStats, RasterError> {
        let Self { session, opacity, opacities, .. } = self;
        if cameras.views() != 1 {
            let views = cameras.views();
            return Err(RasterError::Unsupported(format!("expected one view, found {views}: opacities depend on it")));
        }
        *opacities = opacity.seen_from(gaussians.means, center(cameras.viewmats));
        let seen = GaussianSlices { opacities, ..*gaussians };
        session.forward(&seen, cameras, settings, images)
    }

    fn backward(
        &mut self,
        gaussians: &GaussianSlices<'_, T>,
        cameras: &CameraSlices<'_, T>,
        settings: &RasterSettings,
        cotangents: &Cotangents<'_, T>,
        mut gradients: Gradients<'_, T>,
    ) -> Result<(), RasterError> {
        let Self { session, opacity, opacities, slopes } = self;
        if gradients.opacities.is_some() {
            return Err(RasterError::Unsupported("expected no gradient by opacities: those given take no part".into()));
        }
        slopes.resize(opacities.len(), T::ZERO);
        let (mut means, mut viewmats) = (gradients.means.take(), gradients.viewmats.take());
        let inner = Gradients {
            means: again(&mut means),
            viewmats: again(&mut viewmats),
            opacities: Some(Target::write(slopes)),
            ..gradients
        };
        let seen = GaussianSlices { opacities, ..*gaussians };
        session.backward(&seen, cameras, settings, cotangents, inner)?;
        let by_center = opacity.add_gradient(gaussians.means, cameras.viewmats, (opacities, slopes), means);
        if let Some(viewmats) = viewmats {
            // The center is -A^T t.
            let (m, center) = (cameras.viewmats, by_center.to_array());
            for (row, slopes) in viewmats.values.chunks_exact_mut(4).take(3).enumerate() {
                for (j, by_center) in center.into_iter().enumerate() {
                    slopes[j] -= m[4 * row + 3] * T::from_f64(by_center);
                    slopes[3] -= m[4 * row + j] * T::from_f64(by_center);
                }
            }
        }
        Ok(())
    }
}

impl ViewOpacity {
    /// Adds the gradient by the means, through opacities and their slopes; returns that by the center.
    fn add_gradient<T: Real>(
        &self,
        means: &[T],
        viewmat: &[T],
        (opacities, slopes): (&[T], &[T]),
        mut by_means: Option<Target<'_, T>>,
    ) -> DVec3 {
        let center = center(viewmat);
        let mut by_center = DVec3::ZERO;
        for (n, ((mean, numbers), (opacity, slope))) in
            gaussians(means, &self.harmonics).zip(opacities.iter().zip(slopes)).enumerate()
        {
            let (direction, distance) = direction(mean, center);
            if distance == 0.0 {
                continue;
            }
            let opacity = opacity.to_f64();
            let by_logit = slope.to_f64() * opacity * (1.0 - opacity);
            // Rows are tangent to the sphere already.
            let rows = sh::gradient(direction.to_array());
            let by_direction: DVec3 = rows[..sh::coefficients(DEGREE)]
                .iter()
                .zip(numbers)
                .map(|(y, a)| f64::from(*a) * DVec3::from(*y))
                .sum();
            let by_mean = by_direction * (by_logit / distance);
            by_center -= by_mean;
            if let Some(target) = &mut by_means {
                (0..3).for_each(|j| target.values[3 * n + j] += T::from_f64(by_mean[j]));
            }
        }
        by_center
    }
}

/// The same memory once more.
fn again<'b, T>(target: &'b mut Option<Target<'_, T>>) -> Option<Target<'b, T>> {
    target.as_mut().map(|Target { values, add }| Target { values, add: *add })
}

/// The center of a camera, `-A^T t`.
fn center<T: Real>(viewmat: &[T]) -> DVec3 {
    let m = |row: usize, j: usize| viewmat[4 * row + j].to_f64();
    let [x, y, z] = std::array::from_fn(|j| -(0..3).map(|row| m(row, j) * m(row, 3)).sum::<f64>());
    DVec3::new(x, y, z)
}
