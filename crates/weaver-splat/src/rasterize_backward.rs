//! Backward: undo the blending tile by tile, then the projection Gaussian by Gaussian.

use crate::backward::{ViewCotangents, composite_backward};
use crate::composite::{Blend, PLANES};
use crate::gradients::{Cotangents, Gradients, Target};
use crate::project::footprint;
use crate::project_backward::{CAMERA_SUMS, GaussianGradient, MOMENTS, Moments, camera_gradient, splat_backward};
use crate::rasterize::window_of;
use crate::scene::{Cameras, Extent, Gaussians, RasterError, RasterSettings, expect_len, extent};
use crate::tiles::{Grid, TileLists, grown};
use crate::workspace::Workspace;
use std::ops::Range;
use weaver_kernels::{Real, simd};

/// Gradients of everything that [`rasterize`](crate::rasterize) was given, from those of image, alpha and depth.
///
/// `gaussians`, `cameras` and `settings` are those of the last forward with this workspace. Everything is
/// differentiated but the choices: the order, who is skipped, where a pixel ends, alpha where `alpha_max` holds,
/// colour where it is clamped at zero, the compensation where its floor holds. The limits of x/z and y/z are
/// functions of the intrinsics; the camera centre, for the line of sight, is -A^-1 t. Same bits at any number of
/// threads.
///
/// # Errors
///
/// Lengths that do not fit, or a workspace whose last forward had other sizes or settings.
pub fn rasterize_backward<T: Real>(
    gaussians: &Gaussians<'_, T>,
    cameras: &Cameras<'_, T>,
    settings: &RasterSettings,
    workspace: &mut Workspace<T>,
    cotangents: &Cotangents<'_, T>,
    mut gradients: Gradients<'_, T>,
) -> Result<(), RasterError> {
    let extent = extent(gaussians, cameras, settings)?;
    if workspace.drawn != Some((extent, *settings)) {
        return Err(RasterError::new("backward needs the workspace of a forward with the same sizes and settings"));
    }
    check(cameras, &extent, cotangents, &gradients)?;
    let grid = Grid::new(&extent);
    let tiles = extent.views * grid.len();
    let entries = workspace.lists.len();
    grown(&mut workspace.moments, entries * MOMENTS);
    grown(&mut workspace.background_sums, 3 * tiles);
    let absolute = gradients.centre_pull.is_some();
    match (extent.side, absolute) {
        (8, false) => undo_tiles::<T, 8, false>(cameras, settings, &extent, cotangents, workspace),
        (8, true) => undo_tiles::<T, 8, true>(cameras, settings, &extent, cotangents, workspace),
        (16, false) => undo_tiles::<T, 16, false>(cameras, settings, &extent, cotangents, workspace),
        (16, true) => undo_tiles::<T, 16, true>(cameras, settings, &extent, cotangents, workspace),
        (_, false) => undo_tiles::<T, 32, false>(cameras, settings, &extent, cotangents, workspace),
        (_, true) => undo_tiles::<T, 32, true>(cameras, settings, &extent, cotangents, workspace),
    }
    if let Some(target) = &mut gradients.background {
        background_gradient(cameras, &extent, &workspace.background_sums[..3 * tiles], target);
    }
    if let Some(target) = &mut gradients.centre_pull {
        centre_pull(&extent, workspace, target);
    }
    let chunks = extent.gaussians.div_ceil(GRAIN).max(1);
    let camera_len = extent.views * CAMERA_SUMS;
    let mut camera_sums = std::mem::take(&mut workspace.camera_sums);
    let sums = grown(&mut camera_sums, chunks * camera_len);
    sums.fill(T::ZERO);
    let pass = GaussianPass { gaussians, cameras, settings, extent: &extent, workspace };
    let share = Share {
        means: gradients.means.take(),
        quats: gradients.quats.take(),
        scales: gradients.scales.take(),
        opacities: gradients.opacities.take(),
        colours: gradients.colours.take(),
        camera_sums: &mut *sums,
    };
    pass.run(0..extent.gaussians, share);
    camera_gradients(cameras, &extent, sums, &mut gradients);
    workspace.camera_sums = camera_sums;
    Ok(())
}

fn check<T: Real>(
    cameras: &Cameras<'_, T>,
    extent: &Extent,
    cotangents: &Cotangents<'_, T>,
    gradients: &Gradients<'_, T>,
) -> Result<(), RasterError> {
    let (n, v) = (extent.gaussians, extent.views);
    let pixels = v * extent.width * extent.height;
    let inputs = [
        ("cotangent of the image", cotangents.image, 3 * pixels),
        ("cotangent of alpha", cotangents.alpha, pixels),
        ("cotangent of the depth", cotangents.depth, pixels),
    ];
    for (name, values, expected) in inputs {
        values.map_or(Ok(()), |values| expect_len(name, values.len(), expected))?;
    }
    let outputs = [
        ("gradient of the means", &gradients.means, 3 * n),
        ("gradient of the quats", &gradients.quats, 4 * n),
        ("gradient of the scales", &gradients.scales, 3 * n),
        ("gradient of the opacities", &gradients.opacities, n),
        ("gradient of the colours", &gradients.colours, extent.colour_len * n),
        ("gradient of the viewmats", &gradients.viewmats, cameras.viewmats.len()),
        ("gradient of the intrinsics", &gradients.intrinsics, 4 * v),
        ("gradient of the background", &gradients.background, cameras.background.len()),
        ("pull of the centres", &gradients.centre_pull, 2 * v * n),
    ];
    for (name, target, expected) in outputs {
        target.as_ref().map_or(Ok(()), |target| expect_len(name, target.values.len(), expected))?;
    }
    Ok(())
}

/// Runs [`composite_backward`] on each tile; a tile owns its entries' moments.
fn undo_tiles<T: Real, const S: usize, const ABSOLUTE: bool>(
    cameras: &Cameras<'_, T>,
    settings: &RasterSettings,
    extent: &Extent,
    cotangents: &Cotangents<'_, T>,
    workspace: &mut Workspace<T>,
) {
    let grid = Grid::new(extent);
    let tiles = extent.views * grid.len();
    let pixels = extent.width * extent.height;
    let blend = Blend::new(settings.alpha_max);
    let Workspace { splats, lists, planes, last, moments, background_sums, .. } = workspace;
    let moments = &mut moments[..lists.len() * MOMENTS];
    for_tiles(lists, 0..tiles, moments, &mut background_sums[..3 * tiles], &|t, moments, dbackground| {
        let v = t / grid.len();
        let view = ViewCotangents {
            image: cotangents.image.map(|d| &d[3 * v * pixels..]),
            alpha: cotangents.alpha.map(|d| &d[v * pixels..]),
            depth: cotangents.depth.map(|d| &d[v * pixels..]),
        };
        let first = lists.range(t).start;
        let state = (&planes[t * PLANES * S * S..][..S * S], &last[t * S * S..][..S * S]);
        simd::dispatch(
            #[inline(always)]
            || {
                composite_backward::<T, S, ABSOLUTE>(
                    &blend,
                    (&window_of(&grid, t), extent.width),
                    cameras.background_of(v),
                    &view,
                    |index| &splats[lists.splat(first + index)],
                    state,
                    moments,
                    dbackground,
                );
            },
        );
    });
}

/// Runs `body` on each tile of a range with the tile's part of the moments and of the background sums, in parallel.
fn for_tiles<T: Real>(
    lists: &TileLists,
    tiles: Range<usize>,
    moments: &mut [T],
    background: &mut [T],
    body: &(impl Fn(usize, &mut [T], &mut [T]) + Sync),
) {
    match tiles.len() {
        0 => {}
        1 => body(tiles.start, moments, background),
        count => {
            let middle = tiles.start + count / 2;
            let entries = lists.range(middle).start - lists.range(tiles.start).start;
            let (a, b) = moments.split_at_mut(entries * MOMENTS);
            let (c, d) = background.split_at_mut(3 * (middle - tiles.start));
            rayon::join(
                || for_tiles(lists, tiles.start..middle, a, c, body),
                || for_tiles(lists, middle..tiles.end, b, d, body),
            );
        }
    }
}

/// Sums the tiles' parts, in order.
fn background_gradient<T: Real>(cameras: &Cameras<'_, T>, extent: &Extent, sums: &[T], target: &mut Target<'_, T>) {
    let per_view = 3 * Grid::new(extent).len();
    let shared = cameras.background.len() == 3;
    let groups = if shared { sums.len() } else { per_view };
    for (v, tiles) in sums.chunks(groups.max(1)).enumerate() {
        for channel in 0..3 {
            target.put(3 * v + channel, tiles.iter().skip(channel).step_by(3).copied().sum());
        }
    }
}

/// The pixels' absolute pulls of all splats.
fn centre_pull<T: Real>(extent: &Extent, workspace: &Workspace<T>, target: &mut Target<'_, T>) {
    for id in 0..extent.views * extent.gaussians {
        let sums = moments_of(workspace, id).map_or([T::ZERO; 2], |sums| sums.absolute);
        (0..2).for_each(|axis| target.put(2 * id + axis, sums[axis]));
    }
}

/// The sums over all pixels of splat `id`, if it was drawn.
fn moments_of<T: Real>(workspace: &Workspace<T>, id: usize) -> Option<Moments<T>> {
    let entries = workspace.offsets[id] as usize..workspace.offsets[id + 1] as usize;
    let row = |entry| &workspace.moments[entry * MOMENTS..][..MOMENTS];
    (!entries.is_empty()).then(|| Moments::sum(workspace.lists.entries(entries).map(row)))
}

/// Gaussians per parallel chunk, and per partial sum of the cameras' gradients.
const GRAIN: usize = 128;

/// The gradients of consecutive Gaussians.
struct Share<'a, T> {
    means: Option<Target<'a, T>>,
    quats: Option<Target<'a, T>>,
    scales: Option<Target<'a, T>>,
    opacities: Option<Target<'a, T>>,
    colours: Option<Target<'a, T>>,
    camera_sums: &'a mut [T],
}

struct GaussianPass<'a, T> {
    gaussians: &'a Gaussians<'a, T>,
    cameras: &'a Cameras<'a, T>,
    settings: &'a RasterSettings,
    extent: &'a Extent,
    workspace: &'a Workspace<T>,
}

impl<T: Real> GaussianPass<'_, T> {
    /// Writes the gradients of the Gaussians in `range`, in parallel over chunks with fixed borders.
    fn run(&self, range: Range<usize>, share: Share<'_, T>) {
        let chunks = range.len().div_ceil(GRAIN);
        if chunks <= 1 {
            return self.chunk(range, share);
        }
        let count = chunks / 2 * GRAIN;
        let middle = range.start + count;
        let (a, b) = share.split(count, self.extent.colour_len, chunks / 2 * self.extent.views * CAMERA_SUMS);
        rayon::join(|| self.run(range.start..middle, a), || self.run(middle..range.end, b));
    }

    fn chunk(&self, range: Range<usize>, mut share: Share<'_, T>) {
        if let Some(colours) = &mut share.colours {
            colours.begin();
        }
        let Extent { gaussians, views, colour_len, .. } = *self.extent;
        let mut totals = [GaussianGradient::ZERO; GRAIN];
        for v in 0..views {
            let view = self.cameras.view(v);
            let camera = &mut share.camera_sums[v * CAMERA_SUMS..][..CAMERA_SUMS];
            for (i, n) in range.clone().enumerate() {
                let Some(moments) = moments_of(self.workspace, v * gaussians + n) else { continue };
                let gaussian = self.gaussians.get(n);
                let shape =
                    footprint(&view, self.settings, &gaussian).expect("a Gaussian that was drawn has a footprint");
                let splat = &self.workspace.splats[v * gaussians + n];
                splat_backward(
                    &view,
                    self.settings,
                    &gaussian,
                    &self.gaussians.colour,
                    (splat, &shape, &moments),
                    &mut totals[i],
                    camera,
                    |k, channel, value| {
                        if let Some(colours) = &mut share.colours {
                            colours.put(i * colour_len + 3 * k + channel, value);
                        }
                    },
                );
            }
        }
        for (i, total) in totals[..range.len()].iter().enumerate() {
            put_all(&mut share.means, i, &total.mean);
            put_all(&mut share.quats, i, &total.quat);
            put_all(&mut share.scales, i, &total.scale);
            put_all(&mut share.opacities, i, &[total.opacity]);
        }
    }
}

fn put_all<T: Real, const L: usize>(target: &mut Option<Target<'_, T>>, row: usize, values: &[T; L]) {
    if let Some(target) = target {
        (0..L).for_each(|i| target.put(L * row + i, values[i]));
    }
}

impl<'a, T: Real> Share<'a, T> {
    /// The parts of the first `gaussians` and of the rest.
    fn split(self, gaussians: usize, colour_len: usize, camera_len: usize) -> (Self, Self) {
        let cut =
            |target: Option<Target<'a, T>>, len: usize| target.map(|target| target.split(gaussians * len)).unzip();
        let (camera_a, camera_b) = self.camera_sums.split_at_mut(camera_len);
        let (means_a, means_b) = cut(self.means, 3);
        let (quats_a, quats_b) = cut(self.quats, 4);
        let (scales_a, scales_b) = cut(self.scales, 3);
        let (opacities_a, opacities_b) = cut(self.opacities, 1);
        let (colours_a, colours_b) = cut(self.colours, colour_len);
        (
            Self {
                means: means_a,
                quats: quats_a,
                scales: scales_a,
                opacities: opacities_a,
                colours: colours_a,
                camera_sums: camera_a,
            },
            Self {
                means: means_b,
                quats: quats_b,
                scales: scales_b,
                opacities: opacities_b,
                colours: colours_b,
                camera_sums: camera_b,
            },
        )
    }
}

/// Sums the chunks' parts, in order, and turns them into gradients of matrices and intrinsics.
fn camera_gradients<T: Real>(cameras: &Cameras<'_, T>, extent: &Extent, sums: &[T], gradients: &mut Gradients<'_, T>) {
    let matrix_len = cameras.matrix_len();
    for v in 0..extent.views {
        let mut total = [T::ZERO; CAMERA_SUMS];
        for chunk in sums.chunks_exact(extent.views * CAMERA_SUMS) {
            let part = &chunk[v * CAMERA_SUMS..];
            total.iter_mut().zip(part).for_each(|(total, x)| *total += *x);
        }
        let (matrix, intrinsics) = camera_gradient(&cameras.view(v), &total);
        if let Some(target) = &mut gradients.viewmats {
            (0..matrix_len).for_each(|i| target.put(v * matrix_len + i, matrix.get(i).copied().unwrap_or(T::ZERO)));
        }
        if let Some(target) = &mut gradients.intrinsics {
            (0..4).for_each(|i| target.put(4 * v + i, intrinsics[i]));
        }
    }
}
