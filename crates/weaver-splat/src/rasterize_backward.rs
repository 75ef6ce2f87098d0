//! Backward: undo the blending tile by tile, then the projection Gaussian by Gaussian.

use crate::backward::{Undo, ViewCotangents, prepare};
use crate::cover::{GRAIN, Grid};
use crate::draw::planes;
use crate::gradients::{Cotangents, Gradients};
use crate::group_pass::GroupPass;
use crate::lists::Lists;
use crate::project_backward::{CAMERA_SUMS, camera_gradient};
use crate::rasterize::{windows_of, windows_per_tile};
use crate::scene::{Extent, RasterError, RasterSettings, Viewpoint, expect_len, extent};
use crate::splat::Splat;
use crate::window::{Plane, traverse};
use crate::workspace::{Workspace, grown};
use std::ops::Range;
use std::sync::atomic::AtomicU32;
use std::time::Instant;
use weaver_kernels::Real;
use weaver_kernels::lanes::{self, LANES, LaneKernel, Lanes, Row};
use weaver_scene::{CameraSlices, Features, GaussianSlices};

/// Gradients of everything that [`rasterize`](crate::rasterize) was given, from those of image, alpha and depth.
///
/// `gaussians`, `cameras` and `settings` are those of the last forward with this workspace. Everything is
/// differentiated but the choices: the order, who is skipped, where a pixel ends, alpha where `alpha_max` holds,
/// color where it is clamped at zero, the compensation where its floor holds. The limits of x/z and y/z are
/// functions of the intrinsics; the camera center, for the line of sight, is -A^-1 t. Same bits at any number of
/// threads.
///
/// Gradients are finite where cotangents are: a number that overflows on its way to a gradient adds nothing to it.
/// Gaussians that were left out have zero gradients.
///
/// # Errors
///
/// Lengths that do not fit, or a workspace whose last forward had other sizes or settings.
pub fn rasterize_backward<T: Real>(
    gaussians: &GaussianSlices<'_, T>,
    cameras: &CameraSlices<'_, T>,
    settings: &RasterSettings,
    workspace: &mut Workspace<T>,
    cotangents: &Cotangents<'_, T>,
    mut gradients: Gradients<'_, T>,
) -> Result<(), RasterError> {
    let depth = workspace.drawn.is_some_and(|(extent, _)| extent.depth);
    let extent = extent(gaussians, cameras, settings, depth)?;
    if workspace.drawn != Some((extent, *settings)) {
        return Err(RasterError::new("backward needs the workspace of a forward with the same sizes and settings"));
    }
    check(cameras, &extent, cotangents, &gradients)?;
    let start = Instant::now();
    let entries = workspace.lists.len();
    grown(&mut workspace.moments, entries);
    grown(&mut workspace.feature_sums, entries * extent.channels);
    grown(&mut workspace.background_sums, extent.views * Grid::new(&extent).len());
    match (depth, extent.channels > 0 || gradients.center_pull.is_some()) {
        (false, false) => undo_tiles::<T, 3, false>(gaussians, cameras, settings, &extent, cotangents, workspace),
        (false, true) => undo_tiles::<T, 3, true>(gaussians, cameras, settings, &extent, cotangents, workspace),
        (true, false) => undo_tiles::<T, 4, false>(gaussians, cameras, settings, &extent, cotangents, workspace),
        (true, true) => undo_tiles::<T, 4, true>(gaussians, cameras, settings, &extent, cotangents, workspace),
    }
    background_gradient(cameras, &extent, &workspace.background_sums, &mut gradients);
    let mut camera_sums = std::mem::take(&mut workspace.camera_sums);
    let chunks = extent.gaussians.div_ceil(GRAIN);
    let sums = grown(&mut camera_sums, chunks * extent.views * CAMERA_SUMS);
    sums.fill(Row::default());
    GroupPass { gaussians, cameras, settings, extent: &extent, workspace }.run(&mut gradients, sums);
    camera_gradients(cameras, &extent, sums, &mut gradients);
    workspace.camera_sums = camera_sums;
    workspace.stages.backward = start.elapsed();
    Ok(())
}

fn check<T: Real>(
    cameras: &CameraSlices<'_, T>,
    extent: &Extent,
    cotangents: &Cotangents<'_, T>,
    gradients: &Gradients<'_, T>,
) -> Result<(), RasterError> {
    let (n, v) = (extent.gaussians, extent.views);
    let pixels = v * extent.width * extent.height;
    let inputs = [
        ("cotangent of the image", cotangents.image, if extent.color_len > 0 { 3 * pixels } else { 0 }),
        ("cotangent of alpha", cotangents.alpha, pixels),
        ("cotangent of the depth", cotangents.depth, if extent.depth { pixels } else { 0 }),
        ("cotangent of the features", cotangents.features, extent.channels * pixels),
    ];
    for (name, values, expected) in inputs {
        values.map_or(Ok(()), |values| expect_len(name, values.len(), expected))?;
    }
    let outputs = [
        ("gradient of the means", &gradients.means, 3 * n),
        ("gradient of the quats", &gradients.quats, 4 * n),
        ("gradient of the scales", &gradients.scales, 3 * n),
        ("gradient of the opacities", &gradients.opacities, n),
        ("gradient of the colors", &gradients.colors, extent.color_len * n),
        ("gradient of the features", &gradients.features, extent.channels * n),
        ("gradient of the viewmats", &gradients.viewmats, cameras.viewmats.len()),
        ("gradient of the intrinsics", &gradients.intrinsics, 4 * v),
        ("gradient of the background", &gradients.background, cameras.background.len()),
        ("pull of the centers", &gradients.center_pull, 2 * v * n),
    ];
    for (name, target, expected) in outputs {
        target.as_ref().map_or(Ok(()), |target| expect_len(name, target.values.len(), expected))?;
    }
    Ok(())
}

/// Differentiates the windows of a tile; fills its part of the sums.
struct UndoTile<'a, T, const C: usize, const MORE: bool> {
    alpha_max: f64,
    grid: &'a Grid,
    tile: usize,
    list: &'a [AtomicU32],
    splats: &'a [Splat<T>],
    features: Option<Features<'a, T>>,
    gaussians: usize,
    background: [T; 3],
    cotangents: ViewCotangents<'a, T>,
    /// What drawing left, of all windows.
    drawn: &'a [Plane<T>],
    moments: &'a mut [Row<T>],
    feature_sums: &'a mut [T],
}

impl<T: Real, const C: usize, const MORE: bool> LaneKernel<T> for UndoTile<'_, T, C, MORE> {
    /// The gradient of the background.
    type Output = [T; 3];

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) -> [T; 3] {
        self.moments.fill(Row::default());
        self.feature_sums.fill(T::ZERO);
        let per_window = self.drawn.len() / windows_per_tile(self.grid);
        let channels = self.features.map_or(0, |features| features.channels);
        let count = planes(C == 4, channels);
        // Features are rare, and then the work is not in these few allocations.
        let (mut few, mut many) = ([[Row([T::ZERO; LANES]); LANES]; 5], Vec::new());
        let planes = if count <= few.len() { &mut few[..count] } else { grown(&mut many, count) };
        let mut row_sums = vec![Row::default(); channels];
        let mut transmittance = [Row::default(); LANES];
        let mut dbackground = [T::ZERO; 3];
        for (i, window) in windows_of(self.grid, self.tile) {
            let drawn = &self.drawn[i * per_window..][..per_window];
            let d = prepare::<V>(&window, C == 4, self.background, &self.cotangents, drawn, planes);
            (0..3).for_each(|c| dbackground[c] += d[c]);
            let sums = (&mut *self.moments, &mut *self.feature_sums);
            let mut undo =
                Undo::<V, C, MORE>::new(self.alpha_max, (self.features, self.gaussians), planes, sums, &mut row_sums);
            traverse(self.alpha_max, &window, self.list, self.splats, &mut transmittance, &mut undo);
        }
        dbackground
    }
}

/// Runs [`UndoTile`] on each tile; a tile owns its entries' sums.
fn undo_tiles<T: Real, const C: usize, const MORE: bool>(
    gaussians: &GaussianSlices<'_, T>,
    cameras: &CameraSlices<'_, T>,
    settings: &RasterSettings,
    extent: &Extent,
    cotangents: &Cotangents<'_, T>,
    workspace: &mut Workspace<T>,
) {
    let grid = Grid::new(extent);
    let tiles = extent.views * grid.len();
    let pixels = extent.width * extent.height;
    let per_tile = windows_per_tile(&grid) * planes(C == 4, extent.channels);
    let Workspace { splats, lists, planes, moments, feature_sums, background_sums, .. } = workspace;
    let entries = lists.len();
    let sums = Sums {
        moments: &mut moments[..entries],
        features: &mut feature_sums[..entries * extent.channels],
        channels: extent.channels,
        background: &mut background_sums[..tiles],
    };
    for_tiles(lists, 0..tiles, sums, &|tile, sums: Sums<'_, T>| {
        let v = tile / grid.len();
        sums.background[0] = lanes::run(UndoTile::<T, C, MORE> {
            alpha_max: settings.alpha_max,
            grid: &grid,
            tile,
            list: lists.of_tile(tile),
            splats,
            features: gaussians.features,
            gaussians: extent.gaussians,
            background: cameras.background_of(v),
            cotangents: cotangents.of_view(v, pixels, extent.channels),
            drawn: &planes[tile * per_tile..][..per_tile],
            moments: sums.moments,
            feature_sums: sums.features,
        });
    });
}

/// Something with a part for each list entry, or for each tile.
pub(crate) trait TileParts: Send + Sized {
    /// The parts of the first `tiles` tiles, which have `entries` entries, and of the rest.
    fn cut(self, tiles: usize, entries: usize) -> (Self, Self);
}

impl<T: Send> TileParts for &mut [Row<T>] {
    fn cut(self, _tiles: usize, entries: usize) -> (Self, Self) {
        self.split_at_mut(entries)
    }
}

/// What backward sums for each entry and each tile.
struct Sums<'a, T> {
    moments: &'a mut [Row<T>],
    features: &'a mut [T],
    channels: usize,
    background: &'a mut [[T; 3]],
}

impl<T: Send> TileParts for Sums<'_, T> {
    fn cut(self, tiles: usize, entries: usize) -> (Self, Self) {
        let channels = self.channels;
        let (a, b) = self.moments.split_at_mut(entries);
        let (c, d) = self.features.split_at_mut(entries * channels);
        let (e, f) = self.background.split_at_mut(tiles);
        (
            Self { moments: a, features: c, channels, background: e },
            Self { moments: b, features: d, channels, background: f },
        )
    }
}

/// Runs `body` on each tile of a range with the tile's part of the sums, in parallel.
pub(crate) fn for_tiles<P: TileParts>(lists: &Lists, tiles: Range<usize>, parts: P, body: &(impl Fn(usize, P) + Sync)) {
    match tiles.len() {
        0 => {}
        1 => body(tiles.start, parts),
        count => {
            let middle = tiles.start + count / 2;
            let entries = lists.range(middle).start - lists.range(tiles.start).start;
            let (a, b) = parts.cut(count / 2, entries);
            rayon::join(
                || for_tiles(lists, tiles.start..middle, a, body),
                || for_tiles(lists, middle..tiles.end, b, body),
            );
        }
    }
}

/// Sums the tiles' parts, in order.
fn background_gradient<T: Real>(
    cameras: &CameraSlices<'_, T>,
    extent: &Extent,
    sums: &[[T; 3]],
    gradients: &mut Gradients<'_, T>,
) {
    let Some(target) = &mut gradients.background else { return };
    let per_view = Grid::new(extent).len();
    let shared = cameras.background.len() == 3;
    let groups = if shared { extent.views * per_view } else { per_view };
    for (v, tiles) in sums[..extent.views * per_view].chunks(groups.max(1)).enumerate() {
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
        let (matrix, intrinsics) = camera_gradient(&Viewpoint::of(cameras, v), &total);
        if let Some(target) = &mut gradients.viewmats {
            (0..matrix_len).for_each(|i| target.put(v * matrix_len + i, matrix.get(i).copied().unwrap_or(T::ZERO)));
        }
        if let Some(target) = &mut gradients.intrinsics {
            (0..4).for_each(|i| target.put(4 * v + i, intrinsics[i]));
        }
    }
}
