//! The part of each Gaussian in pictures of a scene.

use weaver_geometry::Camera;
use weaver_scene::Gaussians;
use weaver_splat::{RasterError, RasterSettings, Workspace, render};

/// The sum of each Gaussian's weights, its alpha times what is let through before it, over the pixels of all cameras.
///
/// # Errors
/// When the rasterizer refuses.
pub fn contributions(
    gaussians: &Gaussians,
    cameras: impl Iterator<Item = Camera>,
    background: [f32; 3],
    settings: &RasterSettings,
) -> Result<Vec<f32>, RasterError> {
    let activated = gaussians.to_activated();
    let n = gaussians.len();
    let (mut all, mut sums, mut largest) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let mut workspace = Workspace::new();
    for camera in cameras {
        render(&activated, &[camera], background, settings, &mut workspace)?;
        workspace.contributions(&mut sums, &mut largest)?;
        all.iter_mut().zip(&sums).for_each(|(all, sum)| *all += sum);
    }
    Ok(all)
}
