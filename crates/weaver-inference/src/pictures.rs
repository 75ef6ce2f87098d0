//! Pictures of a prediction: depth, Gaussians per pixel, and rows of them side by side.

use crate::Prediction;
use weaver_io::{Image, false_color};

/// Least width of one image in a picture, pixels.
const LEAST_WIDTH: usize = 256;

/// Input, render, depth and Gaussians per pixel of view `v`, side by side, enlarged until they can be seen.
pub fn row(input: &Image, render: &Image, prediction: &Prediction, v: usize) -> Image {
    let (depth, density) = (depth_picture(prediction, v, input), density_picture(prediction, v, input));
    let times = LEAST_WIDTH.div_ceil(input.width.max(1));
    let large = [input, render, &depth, &density].map(|image| enlarged(image, times));
    Image::mosaic(&large.each_ref())
}

/// Each pixel as a square of `times` x `times`.
fn enlarged(image: &Image, times: usize) -> Image {
    let (width, height) = (image.width * times, image.height * times);
    let at = |i: usize| ((i / width / times) * image.width + i % width / times) * 3;
    let pixels = (0..width * height).flat_map(|i| image.pixels[at(i)..at(i) + 3].iter().copied()).collect();
    Image { width, height, pixels }
}

/// The depth of view `v` on a logarithmic scale, bright is near.
pub fn depth_picture(prediction: &Prediction, v: usize, like: &Image) -> Image {
    let pixels = like.width * like.height;
    let nearness: Vec<f32> = prediction.depth[v * pixels..][..pixels].iter().map(|d| -d.max(1e-6).ln()).collect();
    let (low, high) = nearness.iter().fold((f32::MAX, f32::MIN), |(a, b), x| (a.min(*x), b.max(*x)));
    false_color(&nearness, like.width, like.height, low, high)
}

/// How dense the Gaussians of view `v` are: black is none, the brighter the more. Brightness follows the root of the number per pixel, which is
/// the number along a line, so that cells of very different sizes can be told apart.
pub fn density_picture(prediction: &Prediction, v: usize, like: &Image) -> Image {
    let pixels = like.width * like.height;
    let most = prediction.density.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
    let gray = |density: &f32| [(density / most).sqrt(); 3];
    let pixels = prediction.density[v * pixels..][..pixels].iter().flat_map(gray).collect();
    Image { width: like.width, height: like.height, pixels }
}

/// Images of one width, one below the other.
pub fn stack(rows: &[&Image]) -> Image {
    let width = rows.first().map_or(0, |r| r.width);
    let height = rows.iter().map(|r| r.height).sum();
    Image { width, height, pixels: rows.iter().flat_map(|r| r.pixels.iter().copied()).collect() }
}
