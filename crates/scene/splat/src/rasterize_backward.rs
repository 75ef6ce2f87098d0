//! Backward of the CPU rasterizer: blend backward tile by tile, then the projection Gaussian by Gaussian.

use crate::error::RasterError;
use crate::ewa::EwaGaussian;
use crate::extent::Extent;
use crate::gaussian_pass::{GaussianPass, Pinhole};
use crate::gradients::{Cotangents, Gradients, Target};
use crate::lens::RayGaussian;
use crate::memory::grown;
use crate::rasterize::blending;
use crate::settings::RasterSettings;
use crate::statistics_pass;
use crate::tiles::{BackwardPass, CHUNK, Tiles};
use crate::view::{CAMERA_SUMS, View};
use crate::workspace::Workspace;
use std::time::Instant;
use weaver_kernels::Real;
use weaver_kernels::lanes::Row;
use weaver_scene::{CameraSlices, GaussianSlices, Model};

/// Gradients with respect to everything that [`rasterize`](crate::rasterize()) was given, from those with respect to
/// image, alpha, depth and features.
///
/// `gaussians`, `cameras` and `settings` are the same as in the last forward with this workspace. Everything is
/// differentiated but the choices: the order, who is skipped, where a pixel ends, alpha where `alpha_max` holds, color
/// where it is clamped at zero, the compensation where its floor holds. The limits of x/z and y/z are functions of the
/// intrinsics; the camera center, for the line of sight, is -A^-1 t. Same bits at any number of threads.
///
/// Through a lens there are no gradients of the intrinsics, which the rays of the pixels depend on.
///
/// Gradients are finite where cotangents are: a number that overflows on its way to a gradient adds nothing to it.
/// Gaussians that were left out have zero gradients.
///
/// # Errors
///
/// Lengths that do not fit, a gradient of the intrinsics of a lens, or a workspace whose last forward had other sizes
/// or settings.
#[inline(never)]
pub fn rasterize_backward<T: Real>(
    gaussians: &GaussianSlices<'_, T>,
    cameras: &CameraSlices<'_, T>,
    settings: &RasterSettings,
    workspace: &mut Workspace<T>,
    cotangents: &Cotangents<'_, T>,
    mut gradients: Gradients<'_, T>,
) -> Result<(), RasterError> {
    let depth = workspace.drawn.is_some_and(|(extent, _)| extent.depth);
    let extent = Extent::through_any_lens(gaussians, cameras, settings, depth)?;
    let same_rays = match &workspace.rays {
        None => cameras.model == Model::Pinhole,
        Some(rays) => rays.is_of(cameras),
    };
    if workspace.drawn != Some((extent, *settings)) || !same_rays {
        return Err(RasterError::Arguments(
            "backward needs the workspace of a forward with the same sizes and settings".into(),
        ));
    }
    extent.check_backward(cameras, cotangents, &gradients)?;
    workspace.differentiated = None;
    let start = Instant::now();
    let Workspace { tiles, camera_sums, rays, .. } = workspace;
    let rays = rays.as_deref();
    let pass = BackwardPass {
        blending: blending(gaussians, settings, &extent),
        cotangents: *cotangents,
        statistics: gradients.statistics.is_some(),
    };
    match rays {
        None => tiles.backward(&EwaGaussian, &pass, |v| cameras.background_of(v)),
        Some(rays) => tiles.backward(&RayGaussian(rays), &pass, |v| cameras.background_of(v)),
    }
    if let Some(target) = &mut gradients.background {
        background_gradient(tiles, cameras.background.len() == 3, target);
    }
    if let Some(statistics) = gradients.statistics.take() {
        match rays {
            None => statistics_pass::accumulate(tiles, extent.views, &EwaGaussian, statistics),
            Some(rays) => statistics_pass::accumulate(tiles, extent.views, &RayGaussian(rays), statistics),
        }
    }
    let chunks = extent.gaussians.div_ceil(CHUNK);
    let sums = grown(camera_sums, chunks * extent.views * CAMERA_SUMS);
    sums.fill(Row::default());
    let extent_of = &extent;
    match rays {
        None => {
            let projector = &Pinhole;
            let pass = GaussianPass { projector, gaussians, cameras, settings, extent: extent_of, tiles };
            pass.run(&mut gradients, sums);
        }
        Some(projector) => {
            let pass = GaussianPass { projector, gaussians, cameras, settings, extent: extent_of, tiles };
            pass.run(&mut gradients, sums);
        }
    }
    camera_gradients(cameras, &extent, sums, &mut gradients);
    workspace.differentiated = Some(pass.statistics);
    workspace.timings.backward = start.elapsed();
    Ok(())
}

/// Sums the tiles' parts of the gradient of the background, in order; `shared` by all views or not.
pub(crate) fn background_gradient<T: Real>(tiles: &Tiles<T>, shared: bool, target: &mut Target<'_, T>) {
    let sums = tiles.background_sums();
    let per_color = if shared { sums.len() } else { tiles.tiles_per_view() };
    for (v, tiles) in sums.chunks(per_color.max(1)).enumerate() {
        for channel in 0..3 {
            target.put(3 * v + channel, tiles.iter().map(|sums| sums[channel]).sum());
        }
    }
}

/// Sums the chunks' parts, in order, and turns them into gradients of matrices and intrinsics.
fn camera_gradients<T: Real>(
    cameras: &CameraSlices<'_, T>,
    extent: &Extent,
    sums: &[Row<T>],
    gradients: &mut Gradients<'_, T>,
) {
    let matrix_len = cameras.matrix_len();
    for v in 0..extent.views {
        let mut total = [0.0; CAMERA_SUMS];
        for chunk in sums.chunks_exact(extent.views * CAMERA_SUMS) {
            let part = &chunk[v * CAMERA_SUMS..];
            for (total, row) in total.iter_mut().zip(part) {
                *total += row.0.iter().map(|x| x.to_f64()).sum::<f64>();
            }
        }
        let (matrix, intrinsics) = View::of(cameras, v).gradient(&total);
        if let Some(target) = &mut gradients.viewmats {
            (0..matrix_len).for_each(|i| target.put(v * matrix_len + i, matrix.get(i).copied().unwrap_or(T::ZERO)));
        }
        if let Some(target) = &mut gradients.intrinsics {
            (0..4).for_each(|i| target.put(4 * v + i, intrinsics[i]));
        }
    }
}
