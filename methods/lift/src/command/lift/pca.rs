//! Features as colors: their three principal components.

use crate::{Operator, Pca, Raster};
use weaver_command::Failure;
use weaver_geometry::Camera;
use weaver_io::Image;
use weaver_kernels::order::nth;

/// Gaussians in the sample for the principal components.
const SAMPLE: usize = 20_000;

/// A color for each Gaussian.
pub struct PcaColors {
    /// `[P, 3]`
    colors: Vec<f32>,
}

impl PcaColors {
    /// Red, green and blue are the first three components, scaled from 0 to 1 between the 2 % and 98 % quantiles of the
    /// seen Gaussians.
    pub fn of(features: &[f32], channels: usize, seen: &[f32]) -> Self {
        let of_seen: Vec<usize> = (0..seen.len()).filter(|j| seen[*j] > 0.0).collect();
        let step = of_seen.len().div_ceil(SAMPLE).max(1);
        let sample: Vec<f32> =
            of_seen.iter().step_by(step).flat_map(|j| &features[j * channels..(j + 1) * channels]).copied().collect();
        let pca = Pca::of(&sample, channels, 3);
        let components = pca.components();
        let ranges: Vec<[f64; 2]> = {
            let points = pca.project(&sample);
            (0..components).map(|c| quantiles(points.iter().skip(c).step_by(components).copied().collect())).collect()
        };
        let mut colors = vec![0.5; 3 * seen.len()];
        for (color, point) in colors.chunks_exact_mut(3).zip(pca.project(features).chunks_exact(components.max(1))) {
            for ((x, value), [low, high]) in color.iter_mut().zip(point).zip(&ranges) {
                *x = ((value - low) / (high - low).max(1e-12)).clamp(0.0, 1.0) as f32;
            }
        }
        Self { colors }
    }

    /// The picture of a view.
    pub fn draw(&self, raster: &mut Raster<'_, f32>, view: usize, camera: &Camera) -> Result<Image, Failure> {
        let mut pixels = vec![0.0; 3 * raster.rays(view)];
        raster.forward(view, &self.colors, 3, &mut pixels)?;
        Ok(Image { width: camera.width, height: camera.height, pixels })
    }
}

/// 2 % and 98 % of the values lie below these.
fn quantiles(mut values: Vec<f64>) -> [f64; 2] {
    let count = values.len() as f64;
    [0.02, 0.98].map(|q| nth(&mut values, (q * count) as usize).unwrap_or(0.0))
}
