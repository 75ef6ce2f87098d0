//! Pictures of a prediction: depth, Gaussians per pixel, and rows of them side by side.

use crate::Prediction;
use weaver_geometry::Camera;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_io::{Image, false_color};

/// Least width of one image in a picture, pixels.
const LEAST_WIDTH: usize = 256;

/// Input, render, depth and Gaussians per pixel of view `v`, side by side, enlarged until they can be seen.
pub fn row(input: &Image, render: &Image, prediction: &Prediction, v: usize) -> Image {
    let (depth, density) = (depth_picture(prediction, v, input), density_picture(prediction, v, input));
    side_by_side(&[input, render, &depth, &density])
}

/// Images of one size side by side, enlarged until they can be seen.
pub fn side_by_side(images: &[&Image]) -> Image {
    let times = images.first().map_or(1, |image| LEAST_WIDTH.div_ceil(image.width.max(1)));
    let large: Vec<Image> = images.iter().map(|image| enlarged(image, times)).collect();
    Image::mosaic(&large.iter().collect::<Vec<_>>())
}

/// Where cameras stand, seen from above in the axes of the first: the true ones gray, the predicted ones dark, each
/// with the direction in which it looks. Of the size of `like`, times as large as [`side_by_side`] makes that.
pub fn camera_plan(predicted: &[Camera], truth: &[Camera], like: &Image) -> Image {
    const MARGIN: f64 = 0.12;
    let times = LEAST_WIDTH.div_ceil(like.width.max(1));
    let (width, height) = (like.width * times, like.height * times);
    let center = |camera: &Camera| {
        let center = camera.pose.center();
        DVec2::new(center.x, center.z)
    };
    let all = || predicted.iter().chain(truth).map(center);
    let (low, high) = all().fold((DVec2::MAX, DVec2::MIN), |(low, high), at| (low.min(at), high.max(at)));
    let span = (high - low).max_element().max(1e-6);
    let unit = (1.0 - 2.0 * MARGIN) * width.min(height) as f64 / span;
    let middle = (low + high) / 2.0;
    // Ahead is up.
    let place = |at: DVec2| {
        let from_middle = (at - middle) * unit;
        DVec2::new(width as f64 / 2.0 + from_middle.x, height as f64 / 2.0 - from_middle.y)
    };
    let mut image = Image::filled(width, height, [1.0; 3]);
    let mut dot = |at: DVec2, radius: i64, color: [f32; 3]| {
        let (x, y) = (at.x.round() as i64, at.y.round() as i64);
        for (dx, dy) in (-radius..=radius).flat_map(|dx| (-radius..=radius).map(move |dy| (dx, dy))) {
            let (x, y) = (x + dx, y + dy);
            if (0..width as i64).contains(&x) && (0..height as i64).contains(&y) {
                let i = 3 * (y as usize * width + x as usize);
                image.pixels[i..i + 3].copy_from_slice(&color);
            }
        }
    };
    for (cameras, radius, color) in [(truth, 4, [0.65; 3]), (predicted, 2, [0.1, 0.2, 0.6])] {
        for camera in cameras {
            let from = place(center(camera));
            let ahead = camera.pose.rotation.transpose() * DVec3::Z;
            let look = DVec2::new(ahead.x, -ahead.z) * (0.1 * width.min(height) as f64);
            (0..=20).for_each(|i| dot(from + look * (f64::from(i) / 20.0), radius / 2 - 1, color));
            dot(from, radius, color);
        }
    }
    image
}

/// Each pixel as a square of `times` x `times`.
pub(crate) fn enlarged(image: &Image, times: usize) -> Image {
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

/// Density of the Gaussians of view `v` as a picture: black is none, the brighter the more. Brightness follows the root
/// of the number per pixel, which is the number along a line, so that cells of very different sizes can be
/// distinguished.
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
