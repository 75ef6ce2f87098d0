//! First guesses where there are none: the scene's own cameras.

use std::path::{Path, PathBuf};
use weaver_command::{Failure, camera_files};
use weaver_geometry::Camera;
use weaver_io::PhotoFile;
use weaver_scene::{ActivatedGaussians, Frame};
use weaver_splat::{RasterSettings, Workspace, render};

/// Longest side of the pictures that are compared.
const SIDE: f64 = 64.0;

/// For each photo the camera of the transforms.json beside the scene from which it looks most like the photo, and that file.
pub fn nearest(
    scene: &Path,
    gaussians: &ActivatedGaussians,
    photos: &[PathBuf],
    background: [f32; 3],
    settings: &RasterSettings,
) -> Result<(Vec<Frame>, PathBuf), Failure> {
    let file = scene.with_file_name("transforms.json");
    if !file.is_file() {
        let message = format!("--cameras: expected first guesses, or the scene's own cameras in {}", file.display());
        return Err(Failure::Usage(message));
    }
    let frames = camera_files::read(&file, camera_files::Size::default())?;
    let mut workspace = Workspace::new();
    let mut views = Vec::with_capacity(frames.len());
    for frame in &frames {
        let small = shrunk(&frame.camera);
        let image = render(gaussians, &[small], background, settings, &mut workspace)?.concat();
        views.push((small, image));
    }
    let mut guesses = Vec::with_capacity(photos.len());
    for path in photos {
        let photo = PhotoFile::at(path)?.over(background);
        let mut best: Option<(f64, usize)> = None;
        for (at, (camera, image)) in views.iter().enumerate() {
            let pixels = photo.resize_whole(camera.width, camera.height)?.pixels;
            let square = |(a, b): (&f32, &u8)| f64::from(a - f32::from(*b) / 255.0).powi(2);
            let error = image.iter().zip(&pixels).map(square).sum::<f64>() / image.len() as f64;
            if best.is_none_or(|(least, _)| error < least) {
                best = Some((error, at));
            }
        }
        let (_, at) = best.ok_or_else(|| Failure::message(format!("{}: expected cameras", file.display())))?;
        let name = path.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
        guesses.push(Frame { path: path.clone(), ..Frame::new(name, frames[at].camera) });
    }
    Ok((guesses, file))
}

fn shrunk(camera: &Camera) -> Camera {
    let factor = (SIDE / camera.width.max(camera.height) as f64).min(1.0);
    let side = |side: usize| ((side as f64 * factor).round() as usize).max(1);
    let (width, height) = (side(camera.width), side(camera.height));
    let (sx, sy) = (width as f64 / camera.width as f64, height as f64 / camera.height as f64);
    Camera { intrinsics: camera.intrinsics.resized(sx, sy), width, height, ..*camera }
}
