//! The influence of Gaussians on pictures: weights, squared gradients, sensitivities.

use crate::CompressionError;
use weaver_compress::Pictures;
use weaver_geometry::Camera;
use weaver_scene::{ActivatedGaussians, CameraRows, Gaussians};
use weaver_splat::{
    BlendWeights, Cotangents, CpuRasterizer, Gradients, Images, Rasterizer, Target, Workspace, rasterize,
};

/// Sum of the blending weights of each Gaussian over all pixels of all pictures, `[N]`.
pub(crate) fn contributions(gaussians: &Gaussians, pictures: &Pictures<'_>) -> Result<Vec<f32>, CompressionError> {
    let mut sums = vec![0.0_f64; gaussians.len()];
    each_view(gaussians, pictures, |weights, _, _| {
        for pixel in 0..weights.pixels() {
            weights.of_pixel(pixel).for_each(|(gaussian, weight)| sums[gaussian] += f64::from(weight));
        }
    })?;
    Ok(sums.into_iter().map(|sum| sum as f32).collect())
}

/// Sum over all pixels of the squared derivative of the pixel's color with respect to the value of each Gaussian there,
/// `[N]`.
///
/// A pixel shows `C = Σ c_i o_i g_i T_i` over the background, so that `dC / dg_i = o_i T_i (c_i - C_i)`, with `C_i` the
/// color of everything behind Gaussian i. The derivative of the sum of the three channels is squared.
pub(crate) fn squared_gradients(gaussians: &Gaussians, pictures: &Pictures<'_>) -> Result<Vec<f32>, CompressionError> {
    let mut sums = vec![0.0_f64; gaussians.len()];
    let background: f64 = pictures.background.iter().map(|x| f64::from(*x)).sum();
    let mut hits = Vec::new();
    each_view(gaussians, pictures, |weights, activated, camera| {
        let brightness = brightness(activated, camera);
        for pixel in 0..weights.pixels() {
            hits.clear();
            let mut transmittance = 1.0;
            for (gaussian, weight) in weights.of_pixel(pixel) {
                hits.push((gaussian, f64::from(weight), transmittance));
                transmittance -= f64::from(weight);
            }
            // From back to front: the light from behind, unattenuated by the Gaussians before it.
            let mut behind = background;
            for &(gaussian, weight, transmittance) in hits.iter().rev() {
                let own = brightness[gaussian];
                let slope = f64::from(activated.opacities[gaussian]) * transmittance * (own - behind);
                sums[gaussian] += slope * slope;
                let alpha = if transmittance > 0.0 { weight / transmittance } else { 0.0 };
                behind += alpha * (own - behind);
            }
        }
    })?;
    Ok(sums.into_iter().map(|sum| sum as f32).collect())
}

/// Sensitivities of a Gaussian's pictures to its colors and its shape: over all pictures, the sums of magnitudes of the
/// derivatives of the sum of a picture's channels, a pixel's share; the largest over a color's coefficients, and over
/// scales and rotation, `[N]` each.
pub(crate) fn sensitivities(gaussians: &Gaussians, pictures: &Pictures<'_>) -> Result<[Vec<f64>; 2], CompressionError> {
    let (activated, n) = (gaussians.to_activated(), gaussians.len());
    let mut session = CpuRasterizer.session();
    let (mut colors, mut scales) = (vec![0.0_f64; activated.sh.len()], vec![0.0_f64; 3 * n]);
    let mut quats = vec![0.0_f64; 4 * n];
    let mut pixels = 0;
    for camera in pictures.cameras {
        let count = camera.width * camera.height;
        pixels += count;
        let (mut image, mut alpha) = (vec![0.0; 3 * count], vec![0.0; count]);
        let rows = CameraRows::new(&[*camera]);
        let (slices, cameras) = (activated.as_slices(), rows.as_slices(&pictures.background));
        let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
        session.forward(&slices, &cameras, &pictures.settings, images)?;
        let ones = vec![1.0; 3 * count];
        let (mut sh, mut scale, mut quat) = (vec![0.0; colors.len()], vec![0.0; 3 * n], vec![0.0; 4 * n]);
        let targets = Gradients {
            colors: Some(Target::write(&mut sh)),
            scales: Some(Target::write(&mut scale)),
            quats: Some(Target::write(&mut quat)),
            ..Gradients::default()
        };
        let cotangents = Cotangents { image: Some(&ones), ..Cotangents::default() };
        session.backward(&slices, &cameras, &pictures.settings, &cotangents, targets)?;
        for (sums, values) in [(&mut colors, &sh), (&mut scales, &scale), (&mut quats, &quat)] {
            sums.iter_mut().zip(values).for_each(|(sum, x)| *sum += f64::from(x.abs()));
        }
    }
    // Derivatives by logarithms of scales, as codes of shapes have no size.
    scales.iter_mut().zip(&activated.scales).for_each(|(sum, scale)| *sum *= f64::from(*scale));
    let largest = |rows: &[f64], width: usize| -> Vec<f64> {
        rows.chunks_exact(width).map(|row| row.iter().copied().fold(0.0, f64::max) / pixels.max(1) as f64).collect()
    };
    let of_shapes = largest(&scales, 3).into_iter().zip(largest(&quats, 4)).map(|(a, b)| a.max(b));
    Ok([largest(&colors, 3 * gaussians.coefficients()), of_shapes.collect()])
}

/// Draws all pictures, and hands over the blended Gaussians of each pixel.
fn each_view(
    gaussians: &Gaussians,
    pictures: &Pictures<'_>,
    mut visit: impl FnMut(&BlendWeights<f32>, &ActivatedGaussians, &Camera),
) -> Result<(), CompressionError> {
    let activated = gaussians.to_activated();
    let mut workspace = Workspace::new();
    for camera in pictures.cameras {
        let pixels = camera.width * camera.height;
        let (mut image, mut alpha) = (vec![0.0; 3 * pixels], vec![0.0; pixels]);
        let rows = CameraRows::new(&[*camera]);
        let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
        let cameras = rows.as_slices(&pictures.background);
        rasterize(&activated.as_slices(), &cameras, &pictures.settings, &mut workspace, images)?;
        visit(&BlendWeights::of(&workspace)?, &activated, camera);
    }
    Ok(())
}

/// The sum of the channels of each Gaussian's color as seen by a camera, `[N]`.
fn brightness(gaussians: &ActivatedGaussians, camera: &Camera) -> Vec<f64> {
    gaussians.colors_from(camera.pose.center()).into_iter().map(|[r, g, b]| r + g + b).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_geometry::{Intrinsics, Pose};

    /// Three Gaussians, one behind the other, and a picture of a single pixel.
    fn pixel() -> (Gaussians, [Camera; 1]) {
        let gaussians = Gaussians {
            means: vec![[0.0, 0.1, 2.0], [0.1, 0.0, 3.0], [-0.1, 0.0, 4.0]],
            log_scales: vec![[-0.5, -0.7, -1.0]; 3],
            quats: vec![[1.0, 0.2, -0.1, 0.3]; 3],
            opacity_logits: vec![0.3, -0.4, 1.0],
            sh: vec![0.5, -0.2, 0.1, 0.9, 0.3, -0.6, -0.3, 0.4, 0.8],
            degree: 0,
        };
        let intrinsics = Intrinsics { fx: 1.0, fy: 1.0, cx: 0.5, cy: 0.5 };
        (gaussians, [Camera { pose: Pose::IDENTITY, intrinsics, width: 1, height: 1 }])
    }

    #[test]
    fn squared_gradients_are_those_of_the_backward_pass() {
        let (gaussians, cameras) = pixel();
        let pictures = Pictures { cameras: &cameras, background: [0.2, 0.5, 0.7], settings: Default::default() };
        let activated = gaussians.to_activated();
        let (mut image, mut alpha, mut opacities) = ([0.0; 3], [0.0], [0.0; 3]);
        let rows = CameraRows::new(&cameras);
        let mut session = CpuRasterizer.session();
        let (slices, cameras) = (activated.as_slices(), rows.as_slices(&pictures.background));
        let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
        session.forward(&slices, &cameras, &pictures.settings, images).unwrap();
        let cotangents = Cotangents { image: Some(&[1.0; 3]), ..Cotangents::default() };
        let targets = Gradients { opacities: Some(Target::write(&mut opacities)), ..Gradients::default() };
        session.backward(&slices, &cameras, &pictures.settings, &cotangents, targets).unwrap();
        // For one pixel: alpha = o g, so that dC/dg = (o / g) dC/do, with g from the weights.
        let found = squared_gradients(&gaussians, &pictures).unwrap();
        let weights = contributions(&gaussians, &pictures).unwrap();
        let mut transmittance = 1.0;
        for i in 0..3 {
            let opacity = activated.opacities[i];
            let value = weights[i] / transmittance / opacity;
            let expected = (opacity / value * opacities[i]).powi(2);
            assert!((found[i] / expected - 1.0).abs() < 1e-3, "{i}: {} of {expected}", found[i]);
            transmittance -= weights[i];
        }
        let left = 1.0 - weights.iter().sum::<f32>();
        assert!((alpha[0] - (1.0 - left)).abs() < 1e-6);
    }
}
