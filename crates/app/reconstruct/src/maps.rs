//! Maps of a scene at a view.

use crate::Error;
use std::sync::atomic::{AtomicU32, Ordering};
use weaver_geometry::Camera;
use weaver_geometry::glam::DVec3;
use weaver_geometry::lens::LensCamera;
use weaver_io::{Image, false_color};
use weaver_scene::{ActivatedGaussians, CameraRows, CameraSlices, Model};
use weaver_splat::{Images, RasterSettings, Workspace, rasterize};

/// An image `[H, W, 3]`, clamped.
pub fn picture(pixels: &[f32], camera: &Camera) -> Image {
    let pixels = pixels.iter().map(|x| x.clamp(0.0, 1.0)).collect();
    Image { width: camera.width, height: camera.height, pixels }
}

/// Mean absolute difference of the colors of each pixel; the brightest color stands for a quarter.
pub fn error(image: &[f32], photo: &[u8], camera: &Camera) -> Image {
    let difference = |(a, b): (&[f32], &[u8])| {
        a.iter().zip(b).map(|(a, b)| (a.clamp(0.0, 1.0) - f32::from(*b) / 255.0).abs()).sum::<f32>() / 3.0
    };
    let values: Vec<f32> = image.chunks_exact(3).zip(photo.chunks_exact(3)).map(difference).collect();
    false_color(&values, camera.width, camera.height, 0.0, 0.25)
}

/// Number of Gaussians that each pixel blends, and the largest of those numbers.
pub fn count(
    gaussians: &ActivatedGaussians,
    (camera, model): (&Camera, Model),
    settings: &RasterSettings,
    workspace: &mut Workspace<f32>,
) -> Result<(Image, u32), Error> {
    let pixels = camera.width * camera.height;
    let (mut image, mut alpha) = (vec![0.0; 3 * pixels], vec![0.0; pixels]);
    let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
    let rows = CameraRows::new(&[*camera]);
    let cameras = CameraSlices { model, ..rows.as_slices(&[0.0; 3]) };
    rasterize(&gaussians.as_slices(), &cameras, settings, workspace, images)?;
    let counts: Vec<AtomicU32> = (0..pixels).map(|_| AtomicU32::new(0)).collect();
    workspace.for_each_hit(|pixel, _, _, _| {
        counts[pixel].fetch_add(1, Ordering::Relaxed);
    })?;
    let counts: Vec<f32> = counts.into_iter().map(|c| c.into_inner() as f32).collect();
    let most = counts.iter().fold(1.0_f32, |a, b| a.max(*b));
    Ok((false_color(&counts, camera.width, camera.height, 0.0, most), most as u32))
}

/// Pixels of a cell of [`density`].
const CELL: usize = 8;

/// Number of Gaussians that have their middle in each cell of 8 x 8 pixels, and the largest of those numbers.
pub fn density(gaussians: &ActivatedGaussians, seen: &LensCamera, near: f64) -> (Image, u32) {
    let camera = &seen.camera;
    let (columns, rows) = (camera.width.div_ceil(CELL), camera.height.div_ceil(CELL));
    let mut counts = vec![0.0_f32; columns * rows];
    for mean in gaussians.means.chunks_exact(3) {
        let p = camera.pose.apply(DVec3::new(f64::from(mean[0]), f64::from(mean[1]), f64::from(mean[2])));
        let Some((pixel, depth)) = seen.see(p) else { continue };
        let at = pixel / CELL as f64;
        if depth > near && at.x >= 0.0 && at.y >= 0.0 && at.x < columns as f64 && at.y < rows as f64 {
            counts[at.y as usize * columns + at.x as usize] += 1.0;
        }
    }
    let most = counts.iter().fold(1.0_f32, |a, b| a.max(*b));
    let pixel = |i: usize| counts[i / camera.width / CELL * columns + i % camera.width / CELL];
    let values: Vec<f32> = (0..camera.width * camera.height).map(pixel).collect();
    (false_color(&values, camera.width, camera.height, 0.0, most), most as u32)
}
