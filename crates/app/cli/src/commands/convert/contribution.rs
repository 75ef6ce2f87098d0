//! What Gaussians add to the pictures of cameras.

use std::path::Path;
use weaver_command::camera_files::{self, Size};
use weaver_command::{DrawingOptions, Failure, memory};
use weaver_io::Drawing;
use weaver_scene::Gaussians;
use weaver_splat::{RasterSettings, Workspace, render};

/// Longest side of the pictures: what shows at this size shows at any.
const LONG_SIDE: usize = 640;

/// The sum of each Gaussian's weights, its alpha times what is let through before it, over the pixels of all cameras of a file.
pub fn contributions(
    gaussians: &Gaussians,
    cameras: &Path,
    (scene, drawing): (&Path, Drawing),
) -> Result<Vec<f32>, Failure> {
    let mut cameras = camera_files::read(cameras, Size::default())?;
    cameras.iter_mut().for_each(|frame| frame.camera = frame.camera.shrunk(LONG_SIDE));
    memory::check(memory::of_pictures(&cameras, 1), "smaller cameras reduce it")?;
    let (background, settings): (_, RasterSettings) = DrawingOptions::default().beside(scene, drawing)?;
    let activated = gaussians.to_activated();
    let n = gaussians.len();
    let (mut all, mut sums, mut largest) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let mut workspace = Workspace::new();
    for frame in &cameras {
        render(&activated, &[frame.camera], background, &settings, &mut workspace)?;
        workspace.contributions(&mut sums, &mut largest)?;
        all.iter_mut().zip(&sums).for_each(|(all, sum)| *all += sum);
    }
    Ok(all)
}
