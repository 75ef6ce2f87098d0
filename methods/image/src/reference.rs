//! The model without tiles, lanes or cut: the slow reference of the drawing.

use crate::gaussians::Gaussians;
use crate::window::Window;
use weaver_kernels::Real;

/// Draws colors `[N, 3]` of Gaussians to an image `[H, W, 3]`, in `f64`: all Gaussians at all pixels, 0 beyond `cut`
/// standard deviations.
pub fn draw<T: Real>(gaussians: &Gaussians<T>, window: &Window, cut: f64) -> Vec<f64> {
    let mut image = vec![0.0; 3 * window.pixels()];
    for (pixel, color) in image.chunks_exact_mut(3).enumerate() {
        let x = (window.x + pixel % window.width) as f64 + 0.5;
        let y = (window.y + pixel / window.width) as f64 + 0.5;
        for i in 0..gaussians.len() {
            let number = |of: &[T], i: usize| of[i].to_f64();
            let (dx, dy) = (x - number(&gaussians.centers, 2 * i), y - number(&gaussians.centers, 2 * i + 1));
            let (sin, cos) = number(&gaussians.angles, i).sin_cos();
            let u = (cos * dx + sin * dy) / number(&gaussians.scales, 2 * i);
            let v = (cos * dy - sin * dx) / number(&gaussians.scales, 2 * i + 1);
            let square = u * u + v * v;
            if square <= cut * cut {
                let value = (-0.5 * square).exp();
                for (c, to) in color.iter_mut().enumerate() {
                    *to += value * number(&gaussians.colors, 3 * i + c);
                }
            }
        }
    }
    image
}
