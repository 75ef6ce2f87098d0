//! Forward: project, sort, deal to tiles, blend.

use crate::composite::{Blend, PLANES, Window, composite};
use crate::project::{Splat, splat};
use crate::scene::{Cameras, Extent, Gaussians, RasterError, RasterSettings, expect_len, extent};
use crate::tiles::{Grid, TileLists, depth_key, grown, sort_by_depth, unseen_key};
use crate::workspace::Workspace;
use rayon::prelude::*;
use weaver_kernels::{Real, simd};

/// Where the images go.
#[derive(Debug)]
pub struct Images<'a, T> {
    /// sum of w c + T background, `[V, H, W, 3]`.
    pub image: &'a mut [T],
    /// 1 - T, `[V, H, W]`.
    pub alpha: &'a mut [T],
    /// sum of w z, camera z in world units, not divided by alpha, `[V, H, W]`.
    pub depth: &'a mut [T],
}

/// What was drawn, summed over the views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RasterStats {
    /// Gaussians that touch an image.
    pub splats: usize,
    /// Splats over tiles: the entries of all tile lists.
    pub entries: usize,
    /// Gaussians left out because they hold, or lead to, numbers that are not finite, or have a zero quaternion.
    pub rejected: usize,
}

/// Gaussians per parallel chunk of projection.
const GRAIN: usize = 256;

/// Draws Gaussians in several views: image, alpha and depth.
///
/// At a pixel, splats in ascending camera z (as `f32`, ties by index) have `alpha_i = min(alpha_max, o_i
/// exp(-sigma_i))`, `sigma = d^T S^-1 d / 2` with d from the projected mean to the pixel centre and `S = J A C A^T
/// J^T + eps2d I`, `C = R diag(scale^2) R^T`, and J the Jacobian of the projection with x/z, y/z limited to the
/// frustum widened by 30 % of half its size. Alphas below 1/255 are skipped. `w_i = alpha_i T_i`, `T_i` the product
/// of `1 - alpha_j` over the splats in front; a pixel ends before the splat that would bring T to 1e-4 or less.
///
/// Shapes are with the fields of [`Gaussians`], [`Cameras`] and [`Images`]. `workspace` keeps what
/// [`rasterize_backward`](crate::rasterize_backward) needs. Images have the same bits at any number of threads and
/// any tile side.
///
/// Gaussians that are not finite, or have a zero quaternion, are left out and counted.
///
/// # Errors
///
/// Arguments whose lengths do not fit together, an image without pixels, a degree above 4, more than 2^32 list entries.
///
/// # Source
///
/// Kerbl et al., 3D Gaussian Splatting, 2023, equations 2 to 6; Zwicker et al., EWA splatting, 2002; the rules of
/// gsplat 1.4.0 but for its bounding boxes: a splat is seen wherever its alpha reaches 1/255.
///
/// ```
/// use weaver_splat::{Cameras, Colour, Gaussians, Images, RasterSettings, Workspace, rasterize};
/// let gaussians = Gaussians {
///     means: &[0.0_f32, 0.0, 2.0],
///     quats: &[1.0, 0.0, 0.0, 0.0],
///     scales: &[0.5, 0.5, 0.5],
///     opacities: &[0.8],
///     colour: Colour::Plain(&[1.0, 0.5, 0.0]),
/// };
/// let cameras = Cameras {
///     viewmats: &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
///     intrinsics: &[10.0, 10.0, 1.5, 1.5],
///     background: &[0.0; 3],
///     width: 3,
///     height: 3,
/// };
/// let (mut image, mut alpha, mut depth) = ([0.0; 27], [0.0; 9], [0.0; 9]);
/// let images = Images { image: &mut image, alpha: &mut alpha, depth: &mut depth };
/// rasterize(&gaussians, &cameras, &RasterSettings::default(), &mut Workspace::new(), images)?;
/// assert_eq!(&image[12..15], &[0.8, 0.4, 0.0]);
/// assert_eq!((alpha[4], depth[4]), (0.8, 1.6));
/// # Ok::<(), weaver_splat::RasterError>(())
/// ```
pub fn rasterize<T: Real>(
    gaussians: &Gaussians<'_, T>,
    cameras: &Cameras<'_, T>,
    settings: &RasterSettings,
    workspace: &mut Workspace<T>,
    images: Images<'_, T>,
) -> Result<RasterStats, RasterError> {
    let extent = extent(gaussians, cameras, settings)?;
    let pixels = extent.views * extent.width * extent.height;
    expect_len("image", images.image.len(), 3 * pixels)?;
    expect_len("alpha", images.alpha.len(), pixels)?;
    expect_len("depth", images.depth.len(), pixels)?;
    workspace.drawn = None;
    let splats = extent.views * extent.gaussians;
    project(gaussians, cameras, settings, &extent, workspace);
    let keys = &mut workspace.keys[..splats];
    let rejected = sort_by_depth(keys, extent.gaussians);
    let offsets = &mut workspace.offsets[..=splats];
    let mut entries = 0_u64;
    let mut seen = 0;
    for offset in offsets.iter_mut() {
        let count = *offset;
        seen += usize::from(count > 0);
        *offset = entries as u32;
        entries += u64::from(count);
    }
    if entries > u64::from(u32::MAX) {
        return Err(RasterError::new(format!("{entries} list entries are too many for one call")));
    }
    workspace.lists.deal(&extent, &workspace.splats, keys, offsets);
    match extent.side {
        8 => blend_tiles::<T, 8>(&extent, settings, workspace),
        16 => blend_tiles::<T, 16>(&extent, settings, workspace),
        _ => blend_tiles::<T, 32>(&extent, settings, workspace),
    }
    assemble(cameras, &extent, workspace, images);
    workspace.drawn = Some((extent, *settings));
    Ok(RasterStats { splats: seen, entries: entries as usize, rejected })
}

/// Fills `splats`, `keys`, and in `offsets` the number of tiles of each splat.
fn project<T: Real>(
    gaussians: &Gaussians<'_, T>,
    cameras: &Cameras<'_, T>,
    settings: &RasterSettings,
    extent: &Extent,
    workspace: &mut Workspace<T>,
) {
    let all = extent.views * extent.gaussians;
    let grid = Grid::new(extent);
    let offsets = grown(&mut workspace.offsets, all + 1);
    offsets[all] = 0;
    if all == 0 {
        return;
    }
    // Chunks do not cross views.
    let per_view = extent.gaussians;
    let splats = grown(&mut workspace.splats, all).par_chunks_mut(per_view);
    let keys = grown(&mut workspace.keys, all).par_chunks_mut(per_view);
    let counts = offsets[..all].par_chunks_mut(per_view);
    (splats, keys, counts).into_par_iter().enumerate().for_each(|(v, (splats, keys, counts))| {
        let view = cameras.view(v);
        let chunks = (splats.par_chunks_mut(GRAIN), keys.par_chunks_mut(GRAIN), counts.par_chunks_mut(GRAIN));
        chunks.into_par_iter().enumerate().for_each(|(chunk, (splats, keys, counts))| {
            simd::dispatch(
                #[inline(always)]
                || {
                    for i in 0..splats.len() {
                        let n = chunk * GRAIN + i;
                        counts[i] = 0;
                        keys[i] = match splat(&view, settings, &gaussians.get(n), &gaussians.colour) {
                            Err(why) => unseen_key(why),
                            Ok(splat) => {
                                grid.for_each_tile(&splat, |_| counts[i] += 1);
                                splats[i] = splat;
                                if counts[i] > 0 {
                                    depth_key(splat.z, n)
                                } else {
                                    unseen_key(crate::project::Unseen::Culled)
                                }
                            }
                        };
                    }
                },
            );
        });
    });
}

/// The part of tile `t` (of all views) that is in the image.
pub(crate) fn window_of(grid: &Grid, t: usize) -> Window {
    let corner = grid.corner(t % grid.len());
    Window { corner, columns: grid.side.min(grid.width - corner.0), rows: grid.side.min(grid.height - corner.1) }
}

fn blend_tiles<T: Real, const S: usize>(extent: &Extent, settings: &RasterSettings, workspace: &mut Workspace<T>) {
    let grid = Grid::new(extent);
    let tiles = extent.views * grid.len();
    let planes = grown(&mut workspace.planes, tiles * PLANES * S * S);
    let last = grown(&mut workspace.last, tiles * S * S);
    let (splats, lists): (&[Splat<T>], &TileLists) = (&workspace.splats, &workspace.lists);
    let blend = Blend::new(settings.alpha_max);
    let tiles = (planes.par_chunks_mut(PLANES * S * S), last.par_chunks_mut(S * S));
    tiles.into_par_iter().enumerate().for_each(|(t, (planes, last))| {
        simd::dispatch(
            #[inline(always)]
            || {
                let seen = lists.range(t).map(|entry| &splats[lists.splat(entry)]);
                composite::<T, S>(&blend, &window_of(&grid, t), seen, planes, last);
            },
        );
    });
}

/// Puts the tiles together and adds the background.
fn assemble<T: Real>(cameras: &Cameras<'_, T>, extent: &Extent, workspace: &Workspace<T>, images: Images<'_, T>) {
    let grid = Grid::new(extent);
    let (side, width, height) = (grid.side, grid.width, grid.height);
    let pixels = side * side;
    let rows = (
        images.image.par_chunks_mut(3 * width),
        images.alpha.par_chunks_mut(width),
        images.depth.par_chunks_mut(width),
    );
    rows.into_par_iter().enumerate().with_min_len(16).for_each(|(row, (image, alpha, depth))| {
        let (v, y) = (row / height, row % height);
        let background = cameras.background_of(v);
        for column in 0..grid.columns {
            let tile = v * grid.len() + y / side * grid.columns + column;
            let planes = &workspace.planes[tile * PLANES * pixels..];
            for i in 0..side.min(width - column * side) {
                let (at, x) = (y % side * side + i, column * side + i);
                let transmittance = planes[at];
                for channel in 0..3 {
                    image[3 * x + channel] = planes[(1 + channel) * pixels + at] + transmittance * background[channel];
                }
                alpha[x] = T::ONE - transmittance;
                depth[x] = planes[4 * pixels + at];
            }
        }
    });
}
