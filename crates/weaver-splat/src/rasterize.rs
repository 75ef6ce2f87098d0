//! Forward: project, sort, deal to tiles, blend.

use crate::cover::{Chunk, Cover, GRAIN, Grid};
use crate::draw::{Draw, planes};
use crate::scene::{Extent, RasterError, RasterSettings, Viewpoint, expect_len, extent};
use crate::sort::sort;
use crate::splat::Splat;
use crate::window::{BLOCK, Plane, SIDE, Window, Work, traverse};
use crate::workspace::{Workspace, grown};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};
use std::time::Instant;
use weaver_kernels::lanes::{self, LaneKernel, Lanes};
use weaver_kernels::{Real, parallel};
use weaver_scene::{CameraSlices, Color, Features, GaussianSlices};

/// Where the images go.
#[derive(Debug)]
pub struct Images<'a, T> {
    /// sum of w c + T background, `[V, H, W, 3]`; empty for Gaussians without colors.
    pub image: &'a mut [T],
    /// 1 - T, `[V, H, W]`.
    pub alpha: &'a mut [T],
    /// sum of w z, camera z in world units, not divided by alpha, `[V, H, W]`; [`expected_depth`](crate::expected_depth)
    /// divides.
    pub depth: Option<&'a mut [T]>,
    /// sum of w f, `[V, H, W, C]`.
    pub features: Option<&'a mut [T]>,
}

/// What was drawn, summed over the views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RasterStats {
    /// Gaussians that some tile looks at; their outlines touch the image, or come near its edge.
    pub splats: usize,
    /// Splats over tiles: the entries of all tile lists.
    pub entries: usize,
    /// Gaussians left out because they hold, or lead to, numbers that are not finite, or have a quaternion of zero.
    pub rejected: usize,
    /// Splats over pixels that they add to.
    pub pairs: u64,
    /// Pixels at which splats were evaluated, those that they leave alone included.
    pub evaluated: u64,
}

/// Draws Gaussians in several views: image, alpha and depth.
///
/// At a pixel, splats in ascending camera z (as `f32`, ties by index) have `alpha_i = min(alpha_max, o_i
/// exp(-sigma_i))`, `sigma = d^T S^-1 d / 2` with d from the projected mean to the pixel center and `S = J A C A^T
/// J^T + eps2d I`, `C = R diag(scale^2) R^T`, and J the Jacobian of the projection with x/z, y/z limited to the
/// frustum widened by 30 % of half its size. Alphas below 1/255 are skipped. `w_i = alpha_i T_i`, `T_i` the product
/// of `1 - alpha_j` over the splats in front; a pixel ends before the splat that would bring T to 1e-4 or less.
///
/// Shapes are with the fields of [`GaussianSlices`], [`CameraSlices`] and [`Images`]. `workspace` keeps what
/// [`rasterize_backward`](crate::rasterize_backward) needs. Images have the same bits at any number of threads and
/// any tile side.
///
/// Gaussians that hold a number that is not finite, or whose projection does, or whose quaternion is zero (or so short
/// that 1 / |q| overflows), are left out and counted. Colors and features are only looked at where a Gaussian would be
/// drawn.
///
/// # Errors
///
/// Arguments whose lengths do not fit together, an image without pixels, a background that is not finite, a degree above
/// 4, more than 2^32 list entries.
///
/// # Source
///
/// Kerbl et al., 3D Gaussian Splatting, 2023, equations 2 to 6; Zwicker et al., EWA splatting, 2002; the rules of
/// gsplat 1.4.0 but for its bounding boxes: a splat is seen wherever its alpha reaches 1/255.
///
/// ```
/// use weaver_scene::{CameraSlices, Color, GaussianSlices};
/// use weaver_splat::{Images, RasterSettings, Workspace, rasterize};
/// let gaussians = GaussianSlices {
///     means: &[0.0_f32, 0.0, 2.0],
///     quats: &[1.0, 0.0, 0.0, 0.0],
///     scales: &[0.5, 0.5, 0.5],
///     opacities: &[0.8],
///     color: Color::Plain(&[1.0, 0.5, 0.0]),
///     features: None,
/// };
/// let cameras = CameraSlices {
///     viewmats: &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
///     intrinsics: &[10.0, 10.0, 1.5, 1.5],
///     background: &[0.0; 3],
///     width: 3,
///     height: 3,
/// };
/// let (mut image, mut alpha, mut depth) = ([0.0; 27], [0.0; 9], [0.0; 9]);
/// let images = Images { image: &mut image, alpha: &mut alpha, depth: Some(&mut depth), features: None };
/// rasterize(&gaussians, &cameras, &RasterSettings::default(), &mut Workspace::new(), images)?;
/// assert_eq!(&image[12..15], &[0.8, 0.4, 0.0]);
/// assert_eq!((alpha[4], depth[4]), (0.8, 1.6));
/// # Ok::<(), weaver_splat::RasterError>(())
/// ```
pub fn rasterize<T: Real>(
    gaussians: &GaussianSlices<'_, T>,
    cameras: &CameraSlices<'_, T>,
    settings: &RasterSettings,
    workspace: &mut Workspace<T>,
    images: Images<'_, T>,
) -> Result<RasterStats, RasterError> {
    let extent = extent(gaussians, cameras, settings, images.depth.is_some())?;
    check(gaussians, &extent, &images)?;
    workspace.drawn = None;
    let start = Instant::now();
    project(gaussians, cameras, settings, &extent, workspace);
    let projected = Instant::now();
    let entries: usize = workspace.chunks.iter().map(Chunk::len).sum();
    if entries > u32::MAX as usize {
        return Err(RasterError::new(format!("{entries} list entries are too many for one call")));
    }
    bin(&extent, entries, workspace);
    let binned = Instant::now();
    let work = match (extent.depth, extent.channels > 0) {
        (false, false) => blend::<T, 3, false>(gaussians, settings, &extent, workspace),
        (false, true) => blend::<T, 3, true>(gaussians, settings, &extent, workspace),
        (true, false) => blend::<T, 4, false>(gaussians, settings, &extent, workspace),
        (true, true) => blend::<T, 4, true>(gaussians, settings, &extent, workspace),
    };
    assemble(cameras, &extent, workspace, images);
    workspace.stages.project = projected - start;
    workspace.stages.bin = binned - projected;
    workspace.stages.composite = binned.elapsed();
    workspace.drawn = Some((extent, *settings));
    let count = |of: fn(&Chunk) -> usize| workspace.chunks.iter().map(of).sum();
    Ok(RasterStats {
        splats: count(|chunk| chunk.splats),
        entries,
        rejected: count(|chunk| chunk.rejected),
        pairs: work.pairs,
        evaluated: work.evaluated,
    })
}

fn check<T: Real>(
    gaussians: &GaussianSlices<'_, T>,
    extent: &Extent,
    images: &Images<'_, T>,
) -> Result<(), RasterError> {
    let pixels = extent.views * extent.width * extent.height;
    let color = usize::from(!matches!(gaussians.color, Color::None));
    expect_len("image", images.image.len(), 3 * pixels * color)?;
    expect_len("alpha", images.alpha.len(), pixels)?;
    images.depth.as_ref().map_or(Ok(()), |depth| expect_len("depth", depth.len(), pixels))?;
    let features = images.features.as_ref().map_or(0, |features| features.len());
    expect_len("image of the features", features, pixels * extent.channels)
}

/// Fills `splats`, `keys` and `chunks`.
fn project<T: Real>(
    gaussians: &GaussianSlices<'_, T>,
    cameras: &CameraSlices<'_, T>,
    settings: &RasterSettings,
    extent: &Extent,
    workspace: &mut Workspace<T>,
) {
    let (views, per_view) = (extent.views, extent.gaussians);
    let grid = Grid::new(extent);
    let chunks = per_view.div_ceil(GRAIN);
    // Chunks of an earlier, larger call would be counted; their memory goes.
    workspace.chunks.truncate(views * chunks);
    let chunks_of_views = grown(&mut workspace.chunks, views * chunks).chunks_mut(chunks.max(1));
    let splats = grown(&mut workspace.splats, views * per_view).chunks_mut(per_view.max(1));
    let [keys, sorted] = &mut workspace.keys;
    grown(sorted, views * per_view);
    let keys = grown(keys, views * per_view).chunks_mut(per_view.max(1));
    for (v, (chunks, (splats, keys))) in chunks_of_views.zip(splats.zip(keys)).enumerate() {
        let view = Viewpoint::of(cameras, v);
        let parts = (chunks, splats.par_chunks_mut(GRAIN), keys.par_chunks_mut(GRAIN));
        parts.into_par_iter().enumerate().for_each(|(i, (chunk, splats, keys))| {
            let first = i * GRAIN;
            lanes::run(Cover { view: &view, settings, gaussians, grid: &grid, first, splats, keys, chunk });
        });
    }
}

/// Sorts the splats of each view and deals them to the tiles.
fn bin<T: Real>(extent: &Extent, entries: usize, workspace: &mut Workspace<T>) {
    let per_view = extent.gaussians;
    let chunks = per_view.div_ceil(GRAIN);
    workspace.lists.prepare(extent, entries);
    let [keys, sorted] = &mut workspace.keys;
    for v in 0..extent.views {
        let part = v * per_view..(v + 1) * per_view;
        let seen = sort(&mut keys[part.clone()], &mut sorted[part.clone()], &mut workspace.counts);
        let sorted: &[AtomicU64] = &sorted[part][..seen];
        workspace.lists.deal(extent, v, sorted, &workspace.chunks[v * chunks..(v + 1) * chunks]);
    }
}

/// The windows of tile `t` (of all views): those in the image, with their place among the tile's.
pub(crate) fn windows_of(grid: &Grid, t: usize) -> impl Iterator<Item = (usize, Window)> + use<> {
    let Grid { width, height, side, .. } = *grid;
    let (x, y) = grid.corner(t % grid.len());
    let columns = side / SIDE;
    (0..columns * columns).filter_map(move |i| {
        let corner = (x + i % columns * SIDE, y + i / columns * SIDE);
        (corner.0 < width && corner.1 < height).then_some((i, Window { corner, width, height }))
    })
}

/// Windows in a tile.
pub(crate) fn windows_per_tile(grid: &Grid) -> usize {
    (grid.side / SIDE).pow(2)
}

/// Draws the windows of a tile.
struct DrawTile<'a, T, const C: usize, const MORE: bool> {
    alpha_max: f64,
    grid: &'a Grid,
    tile: usize,
    list: &'a [AtomicU32],
    splats: &'a [Splat<T>],
    features: Option<Features<'a, T>>,
    gaussians: usize,
    /// Of all windows.
    planes: &'a mut [Plane<T>],
}

impl<T: Real, const C: usize, const MORE: bool> LaneKernel<T> for DrawTile<'_, T, C, MORE> {
    type Output = Work;

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) -> Work {
        let per_window = self.planes.len() / windows_per_tile(self.grid);
        let mut total = Work::default();
        for (i, window) in windows_of(self.grid, self.tile) {
            let [transmittance, planes @ ..] = &mut self.planes[i * per_window..][..per_window] else { continue };
            let mut draw = Draw::<V, C, MORE>::new(self.features, self.gaussians, planes);
            let work = traverse(self.alpha_max, &window, self.list, self.splats, transmittance, &mut draw);
            total.pairs += work.pairs;
            total.evaluated += work.evaluated;
        }
        total
    }
}

fn blend<T: Real, const C: usize, const MORE: bool>(
    gaussians: &GaussianSlices<'_, T>,
    settings: &RasterSettings,
    extent: &Extent,
    workspace: &mut Workspace<T>,
) -> Work {
    let grid = Grid::new(extent);
    let per_tile = windows_per_tile(&grid) * planes(extent.depth, extent.channels);
    let planes = grown(&mut workspace.planes, extent.views * grid.len() * per_tile);
    let (splats, lists) = (&workspace.splats[..], &workspace.lists);
    let (pairs, evaluated) = (AtomicU64::new(0), AtomicU64::new(0));
    parallel::for_chunks(planes, per_tile, |tile, planes| {
        let work = lanes::run(DrawTile::<T, C, MORE> {
            alpha_max: settings.alpha_max,
            grid: &grid,
            tile,
            list: lists.of_tile(tile),
            splats,
            features: gaussians.features,
            gaussians: extent.gaussians,
            planes,
        });
        pairs.fetch_add(work.pairs, Relaxed);
        evaluated.fetch_add(work.evaluated, Relaxed);
    });
    Work { pairs: pairs.into_inner(), evaluated: evaluated.into_inner() }
}

/// Puts the windows together and adds the background.
fn assemble<T: Real>(cameras: &CameraSlices<'_, T>, extent: &Extent, workspace: &Workspace<T>, images: Images<'_, T>) {
    let channels = extent.channels;
    let image = Assembly { extent, grid: Grid::new(extent), planes: &workspace.planes };
    image.run(images.alpha, 1, |_, window, block, lane, out| {
        out.iter_mut().zip(&window[0][block].0[lane..]).for_each(|(out, &left)| *out = T::ONE - left);
    });
    if !images.image.is_empty() {
        image.run(images.image, 3, |v, window, block, lane, out| {
            let [left, red, green, blue] = [0, 1, 2, 3].map(|plane| &window[plane][block].0[lane..]);
            let background = cameras.background_of(v);
            for (i, pixel) in out.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                *pixel = [
                    red[i] + left[i] * background[0],
                    green[i] + left[i] * background[1],
                    blue[i] + left[i] * background[2],
                ];
            }
        });
    }
    if let Some(depth) = images.depth {
        image.run(depth, 1, |_, window, block, lane, out| {
            out.copy_from_slice(&window[4][block].0[lane..][..out.len()]);
        });
    }
    if let Some(features) = images.features.filter(|features| !features.is_empty()) {
        let first = 4 + usize::from(extent.depth);
        image.run(features, channels, |_, window, block, lane, out| {
            for (i, pixel) in out.chunks_exact_mut(channels).enumerate() {
                pixel.iter_mut().enumerate().for_each(|(c, x)| *x = window[first + c][block].0[lane + i]);
            }
        });
    }
}

/// From the planes of windows to the rows of images.
struct Assembly<'a, T> {
    extent: &'a Extent,
    grid: Grid,
    planes: &'a [Plane<T>],
}

impl<T: Real> Assembly<'_, T> {
    /// Runs `body(view, planes of the window, block, first lane, pixels)` on each row of each block, in parallel; `out`
    /// is `[V, H, W, channels]`.
    fn run(&self, out: &mut [T], channels: usize, body: impl Fn(usize, &[Plane<T>], usize, usize, &mut [T]) + Sync) {
        let Grid { width, height, side, columns, .. } = self.grid;
        let per_window = planes(self.extent.depth, self.extent.channels);
        let across = side / SIDE;
        parallel::for_chunks(out, width * channels, |row, out| {
            let (v, y) = (row / height, row % height);
            for (i, out) in out.chunks_mut(SIDE * channels).enumerate() {
                let tile = v * self.grid.len() + y / side * columns + i / across;
                let window = tile * across * across + y % side / SIDE * across + i % across;
                let planes = &self.planes[window * per_window..][..per_window];
                for (j, out) in out.chunks_mut(BLOCK * channels).enumerate() {
                    body(v, planes, y % SIDE / BLOCK * BLOCK + j, y % BLOCK * BLOCK, out);
                }
            }
        });
    }
}
