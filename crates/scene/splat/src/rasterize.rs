//! Forward of the CPU rasterizer.

use crate::error::RasterError;
use crate::ewa::EwaGaussian;
use crate::extent::Extent;
use crate::lens::{RayGaussian, RayProjection};
use crate::project::EwaProjection;
use crate::rasterizer::{Images, RasterStats};
use crate::settings::RasterSettings;
use crate::tiles::{Blending, Grid};
use crate::workspace::{Timings, Workspace};
use std::time::Instant;
use weaver_kernels::Real;
use weaver_scene::{CameraSlices, GaussianSlices};

/// Draws Gaussians in several views: image, alpha and depth.
///
/// At a pixel, splats in ascending camera z (as `f32`, ties by index) have `alpha_i = min(alpha_max, o_i
/// exp(-sigma_i))`, `sigma = d^T S^-1 d / 2` with d from the projected mean to the pixel center and `S = J A C A^T
/// J^T + eps2d I`, `C = R diag(scale^2) R^T`, and J the Jacobian of the projection with x/z, y/z limited to the
/// frustum widened by 30 % of half its size. Alphas below 1/255 are skipped. `w_i = alpha_i T_i`, `T_i` the product
/// of `1 - alpha_j` over the splats in front; a pixel ends before the splat that would bring T to 1e-4 or less.
///
/// Through a [lens](weaver_scene::Model::Lens) each Gaussian is drawn on the plane that touches the unit sphere at its
/// own direction d: at a pixel whose ray is w, sigma is as above with `(e1 . w, e2 . w) / (d . w)` in place of the way
/// from mean to pixel, e1 and e2 across d, and J = (e1 e2)^T / |p|. The blur has the size of a pixel at the mean, a
/// function of the angle from the axis. Order, depth and limits are by distance |p|, and no ray sees what is behind
/// it. Alpha is 0 where the lens sees nothing.
///
/// Gaussians in [groups](weaver_scene::Groups) do not see each other: each group has a transmittance of its own, and
/// images, of the same bits as if it were drawn alone. One projection and one sort serve all of them.
///
/// Shapes are with the fields of [`GaussianSlices`], [`CameraSlices`] and [`Images`]. `workspace` keeps the data for
/// [`rasterize_backward`](crate::rasterize_backward()). Images have the same bits at any number of threads, any tile
/// side, and for any drawn region.
///
/// Gaussians that hold a number that is not finite, or whose projection does, or whose quaternion is zero (or so short
/// that 1 / |q| overflows), are left out and counted. Colors and features are only looked at where a Gaussian would be
/// drawn.
///
/// # Errors
///
/// Arguments whose lengths do not fit together, an image without pixels, a background that is not finite, a degree
/// above 4, a region beyond the image, views of a lens whose intrinsics differ, more than 2^32 list entries.
///
/// # Source
///
/// Kerbl et al., 3D Gaussian Splatting, 2023, equations 2 to 6; Zwicker et al., EWA splatting, 2002; the rules of
/// gsplat 1.4.0 but for its bounding boxes: a splat is seen wherever its alpha reaches 1/255. Lenses: the plane of
/// Huang et al., On the Error Analysis of 3D Gaussian Splatting and an Optimal Projection Strategy, 2024.
///
/// ```
/// use weaver_scene::{CameraSlices, Color, GaussianSlices, Model};
/// use weaver_splat::{Images, RasterSettings, Workspace, rasterize};
/// let gaussians = GaussianSlices {
///     means: &[0.0_f32, 0.0, 2.0],
///     quats: &[1.0, 0.0, 0.0, 0.0],
///     scales: &[0.5, 0.5, 0.5],
///     opacities: &[0.8],
///     color: Color::Plain(&[1.0, 0.5, 0.0]),
///     features: None,
///     groups: None,
/// };
/// let cameras = CameraSlices {
///     viewmats: &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
///     intrinsics: &[10.0, 10.0, 1.5, 1.5],
///     background: &[0.0; 3],
///     width: 3,
///     height: 3,
///     model: Model::Pinhole,
/// };
/// let (mut image, mut alpha, mut depth) = ([0.0; 27], [0.0; 9], [0.0; 9]);
/// let images = Images { image: &mut image, alpha: &mut alpha, depth: Some(&mut depth), features: None };
/// rasterize(&gaussians, &cameras, &RasterSettings::default(), &mut Workspace::new(), images)?;
/// assert_eq!(&image[12..15], &[0.8, 0.4, 0.0]);
/// assert_eq!((alpha[4], depth[4]), (0.8, 1.6));
/// # Ok::<(), weaver_splat::RasterError>(())
/// ```
#[inline(never)]
pub fn rasterize<T: Real>(
    gaussians: &GaussianSlices<'_, T>,
    cameras: &CameraSlices<'_, T>,
    settings: &RasterSettings,
    workspace: &mut Workspace<T>,
    images: Images<'_, T>,
) -> Result<RasterStats, RasterError> {
    let extent = Extent::through_any_lens(gaussians, cameras, settings, images.depth.is_some())?;
    extent.check_images(&images)?;
    (workspace.drawn, workspace.differentiated) = (None, None);
    workspace.rays = workspace.rays_cache.of(cameras)?;
    let start = Instant::now();
    let Workspace { tiles, rays, .. } = workspace;
    let grid = Grid::new(extent.region, settings.tile);
    let (views, n) = (extent.views, extent.gaussians);
    let stats = match rays.as_deref() {
        None => tiles.project(grid, views, n, &EwaProjection { gaussians, cameras, settings }, &EwaGaussian)?,
        Some(rays) => {
            let projection = RayProjection { rays, gaussians, cameras, settings };
            tiles.project(grid, views, n, &projection, &RayGaussian(rays))?
        }
    };
    let projected = Instant::now();
    tiles.bin(gaussians.groups);
    let binned = Instant::now();
    let blending = blending(gaussians, settings, &extent);
    let [pairs, evaluated] = match rays.as_deref() {
        None => tiles.blend(&EwaGaussian, &blending),
        Some(rays) => tiles.blend(&RayGaussian(rays), &blending),
    };
    tiles.images(&blending, |v| cameras.background_of(v), images);
    workspace.timings =
        Timings { project: projected - start, bin: binned - projected, blend: binned.elapsed(), ..workspace.timings };
    workspace.drawn = Some((extent, *settings));
    let (splats, entries, rejected) = (stats.covered, stats.entries, stats.rejected);
    Ok(RasterStats { splats, entries, rejected, pairs, evaluated })
}

/// Settings of blending the Gaussians of a call.
pub(crate) fn blending<'a, T: Real>(
    gaussians: &GaussianSlices<'a, T>,
    settings: &RasterSettings,
    extent: &Extent,
) -> Blending<'a, T> {
    Blending { alpha_max: settings.alpha_max, depth: extent.depth, features: gaussians.features }
}
