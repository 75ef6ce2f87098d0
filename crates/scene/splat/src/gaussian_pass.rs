//! The second half of backward: Gaussian by Gaussian, from sums over pixels to parameters.

use crate::columns::{prefetch_rows, put_columns, put_wide_columns, wide_columns};
use crate::each::each;
use crate::extent::Extent;
use crate::gradients::{Gradients, Target};
use crate::project::{Coefficients, Projection, projection};
use crate::project_backward::{Upstream, splat_backward};
use crate::settings::RasterSettings;
use crate::sh;
use crate::shape::{Group, GroupGradient};
use crate::tiles::{CHUNK, Chunk, Tiles, moment};
use crate::view::{CAMERA_SUMS, View};
use std::ops::Range;
use std::sync::atomic::Ordering::Relaxed;
use weaver_kernels::Real;
use weaver_kernels::lanes::{self, LANES, LaneKernel, LaneMask, Lanes, Row};
use weaver_kernels::simd::prefetch;
use weaver_scene::{CameraSlices, Color, GaussianSlices};

/// Projection of shapes by a kind of camera, and its derivative.
pub(crate) trait Projector<T: Real>: Sync {
    /// Sums over pixels for each shape.
    const SUMS: usize;
    /// Everything between Gaussians and what the pixels see of them.
    type Projected<V: Lanes<Scalar = T>>: Copy;

    /// Projects sixteen shapes.
    fn project<V: Lanes<Scalar = T>>(
        &self,
        view: &View<V>,
        settings: &RasterSettings,
        group: &Group<V>,
    ) -> Self::Projected<V>;

    /// Adds the gradients of sixteen shapes to those of their Gaussians and of the camera.
    fn backward<V: Lanes<Scalar = T>>(
        &self,
        at: (&View<V>, &RasterSettings),
        group: &Group<V>,
        projected: &Self::Projected<V>,
        upstream: &Upstream<'_, V>,
        out: &mut GroupGradient<V>,
        camera: &mut [V; CAMERA_SUMS],
    );
}

/// The pinhole, by the EWA approximation.
pub(crate) struct Pinhole;

impl<T: Real> Projector<T> for Pinhole {
    const SUMS: usize = crate::ewa::SUMS;
    type Projected<V: Lanes<Scalar = T>> = Projection<V>;

    #[inline(always)]
    fn project<V: Lanes<Scalar = T>>(
        &self,
        view: &View<V>,
        settings: &RasterSettings,
        group: &Group<V>,
    ) -> Projection<V> {
        projection(view, settings, group)
    }

    #[inline(always)]
    fn backward<V: Lanes<Scalar = T>>(
        &self,
        at: (&View<V>, &RasterSettings),
        group: &Group<V>,
        projected: &Projection<V>,
        upstream: &Upstream<'_, V>,
        out: &mut GroupGradient<V>,
        camera: &mut [V; CAMERA_SUMS],
    ) {
        splat_backward(at, group, projected, upstream, out, camera);
    }
}

/// Inputs of the pass.
pub(crate) struct GaussianPass<'a, T, P> {
    pub projector: &'a P,
    pub gaussians: &'a GaussianSlices<'a, T>,
    pub cameras: &'a CameraSlices<'a, T>,
    pub settings: &'a RasterSettings,
    pub extent: &'a Extent,
    pub tiles: &'a Tiles<T>,
}

impl<T, P> Copy for GaussianPass<'_, T, P> {}
impl<T, P> Clone for GaussianPass<'_, T, P> {
    fn clone(&self) -> Self {
        *self
    }
}

/// Destination of the gradients of consecutive Gaussians.
struct Share<'a, T> {
    means: Option<Target<'a, T>>,
    quats: Option<Target<'a, T>>,
    scales: Option<Target<'a, T>>,
    opacities: Option<Target<'a, T>>,
    colors: Option<Target<'a, T>>,
    /// `[chunks, V, CAMERA_SUMS]`
    camera_sums: &'a mut [Row<T>],
}

impl<'a, T: Real> Share<'a, T> {
    /// The parts of the first `chunks` chunks and of the rest.
    fn split(self, chunks: usize, extent: &Extent) -> (Self, Self) {
        let count = chunks * CHUNK;
        let cut = |target: Option<Target<'a, T>>, len: usize| target.map(|target| target.split(count * len)).unzip();
        let (camera_a, camera_b) = self.camera_sums.split_at_mut(chunks * extent.views * CAMERA_SUMS);
        let (means_a, means_b) = cut(self.means, 3);
        let (quats_a, quats_b) = cut(self.quats, 4);
        let (scales_a, scales_b) = cut(self.scales, 3);
        let (opacities_a, opacities_b) = cut(self.opacities, 1);
        let (colors_a, colors_b) = cut(self.colors, extent.color_len);
        let a = Self {
            means: means_a,
            quats: quats_a,
            scales: scales_a,
            opacities: opacities_a,
            colors: colors_a,
            camera_sums: camera_a,
        };
        let b = Self {
            means: means_b,
            quats: quats_b,
            scales: scales_b,
            opacities: opacities_b,
            colors: colors_b,
            camera_sums: camera_b,
        };
        (a, b)
    }
}

impl<T: Real, P: Projector<T>> GaussianPass<'_, T, P> {
    /// Writes the gradients of Gaussians, and the cameras' gradients in parts: `camera_sums` is `[chunks, V,
    /// CAMERA_SUMS]`.
    pub fn run(&self, gradients: &mut Gradients<'_, T>, camera_sums: &mut [Row<T>]) {
        if let Some(target) = gradients.features.take() {
            self.tiles.sum_features(target, self.extent.channels);
        }
        let share = Share {
            means: gradients.means.take(),
            quats: gradients.quats.take(),
            scales: gradients.scales.take(),
            opacities: gradients.opacities.take(),
            colors: gradients.colors.take(),
            camera_sums,
        };
        self.split(0..self.extent.gaussians.div_ceil(CHUNK), share);
    }

    /// Runs the chunks in parallel.
    fn split(&self, chunks: Range<usize>, share: Share<'_, T>) {
        match chunks.len() {
            0 => {}
            1 => lanes::run(ChunkPass { pass: *self, index: chunks.start, share }),
            count => {
                let middle = chunks.start + count / 2;
                let (a, b) = share.split(count / 2, self.extent);
                rayon::join(|| self.split(chunks.start..middle, a), || self.split(middle..chunks.end, b));
            }
        }
    }
}

/// One chunk of Gaussians.
struct ChunkPass<'a, T, P> {
    pass: GaussianPass<'a, T, P>,
    index: usize,
    share: Share<'a, T>,
}

/// The columns of the sums of sixteen Gaussians over the tiles of a view, and which were drawn.
#[inline(always)]
fn moments_of<V: Lanes>(tiles: &Tiles<V::Scalar>, chunk: &Chunk, lanes: Range<usize>) -> ([V; LANES], V::Mask) {
    let mut rows = [V::zero(); LANES];
    let mut drawn = 0_u16;
    for (lane, i) in lanes.enumerate() {
        let places = chunk.places(i);
        drawn |= u16::from(!places.is_empty()) << lane;
        for place in places {
            rows[lane] = rows[lane] + V::load(&tiles.moments()[place.load(Relaxed) as usize].0);
        }
    }
    V::transpose(&mut rows);
    (rows, V::Mask::from_bits(drawn))
}

/// Writes the columns of a group of Gaussians that starts at `at`.
#[inline(always)]
fn put<V: Lanes, const K: usize>(
    target: &mut Option<Target<'_, V::Scalar>>,
    at: usize,
    count: usize,
    columns: &[V; K],
) {
    if let Some(target) = target {
        put_columns(columns, target.add, &mut target.values[K * at..K * (at + count)]);
    }
}

impl<T: Real, P: Projector<T>> LaneKernel<T> for ChunkPass<'_, T, P> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let Self { pass, index, mut share } = self;
        let GaussianPass { projector, gaussians, cameras, settings, extent, tiles } = pass;
        let first = index * CHUNK;
        let len = CHUNK.min(extent.gaussians - first);
        let color_len = extent.color_len;
        let mut coefficients: Coefficients<V> = [V::zero(); _];
        let mut dcolors: Coefficients<V> = [V::zero(); _];
        for at in (0..len).step_by(LANES) {
            let count = LANES.min(len - at);
            let group = Group::<V>::load(gaussians, first + at, count);
            let mut out = GroupGradient::zero();
            dcolors[..color_len].fill(V::zero());
            let mut loaded = false;
            if let Color::Sh { coefficients: values, .. } = gaussians.color {
                prefetch_rows(values, (first + at + LANES) * color_len, LANES * color_len);
            }
            for v in 0..extent.views {
                let (chunk, _) = tiles.chunk(v, first);
                // The next group's sums are anywhere in memory.
                for i in at + LANES..(at + 2 * LANES).min(len) {
                    let places = chunk.places(i).iter();
                    places.for_each(|place| prefetch(&tiles.moments()[place.load(Relaxed) as usize]));
                }
                let (moments, drawn) = moments_of::<V>(tiles, chunk, at..at + count);
                if drawn.bits() == 0 {
                    continue;
                }
                let view = View::of(cameras, v).in_lanes::<V>();
                let projected = projector.project(&view, settings, &group);
                let mut dsight = [V::zero(); 3];
                let dcolor = each!(3, |i| moments[P::SUMS + moment::COLOR + i]);
                match gaussians.color {
                    Color::None => {}
                    Color::Plain(_) => {
                        for (sum, x) in dcolors.iter_mut().zip(dcolor) {
                            *sum = *sum + x;
                        }
                    }
                    Color::Sh { coefficients: values, degree } => {
                        if !loaded {
                            let range = (first + at) * color_len..(first + at + count) * color_len;
                            wide_columns(&values[range], color_len, &mut coefficients);
                            loaded = true;
                        }
                        // Any direction where nothing was drawn, so that zeros stay zeros.
                        let anywhere = V::constant(1.0);
                        let sight = each!(3, |i| (group.mean[i] - view.center[i]).or(drawn, anywhere));
                        dsight = sh::color_backward(degree, sight, &coefficients, dcolor, &mut dcolors);
                    }
                }
                let camera = &mut share.camera_sums[v * CAMERA_SUMS..][..CAMERA_SUMS];
                let mut sums = each!(CAMERA_SUMS, |i| V::load(&camera[i].0));
                let upstream = Upstream { moments: &moments, drawn, dsight };
                projector.backward((&view, settings), &group, &projected, &upstream, &mut out, &mut sums);
                for (row, sum) in camera.iter_mut().zip(sums) {
                    sum.store(&mut row.0);
                }
            }
            put(&mut share.means, at, count, &out.mean);
            put(&mut share.quats, at, count, &out.quat);
            put(&mut share.scales, at, count, &out.scale);
            put(&mut share.opacities, at, count, &[out.opacity]);
            if let Some(target) = &mut share.colors {
                let rows = &mut target.values[at * color_len..(at + count) * color_len];
                match gaussians.color {
                    Color::None => {}
                    Color::Plain(_) => put_columns(&[dcolors[0], dcolors[1], dcolors[2]], target.add, rows),
                    Color::Sh { .. } => put_wide_columns(&mut dcolors, color_len, target.add, rows),
                }
            }
        }
    }
}
