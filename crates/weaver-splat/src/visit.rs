//! What was drawn, hit by hit.

use crate::cover::{GRAIN, Grid};
use crate::rasterize::windows_of;
use crate::rasterize_backward::for_tiles;
use crate::scene::{Extent, RasterError, expect_len};
use crate::splat::Splat;
use crate::window::{Hit, Visitor, Window, traverse};
use crate::workspace::{Workspace, grown};
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use weaver_kernels::lanes::{self, LANES, LaneKernel, LaneMask, Lanes, Row};
use weaver_kernels::{Real, parallel};

impl<T: Real> Workspace<T> {
    /// Calls `visit(pixel, gaussian, weight, transmittance)` for every Gaussian at every pixel that it adds to, in the
    /// last image drawn with this workspace.
    ///
    /// `pixel` indexes `[V, H, W]`, `gaussian` is 0 to N - 1, `transmittance` T is the light that arrives there, `weight`
    /// is alpha T: the very numbers of the image. At each pixel hits come front to back. Tiles are visited in parallel,
    /// so that hits of different pixels come in no fixed order.
    ///
    /// # Errors
    ///
    /// A workspace that nothing was drawn with, or whose last drawing failed.
    ///
    /// ```
    /// # use weaver_scene::{CameraSlices, Color, GaussianSlices};
    /// # use weaver_splat::{Images, RasterSettings, Workspace, rasterize};
    /// # let gaussians = GaussianSlices {
    /// #     means: &[0.0_f32, 0.0, 2.0],
    /// #     quats: &[1.0, 0.0, 0.0, 0.0],
    /// #     scales: &[0.5, 0.5, 0.5],
    /// #     opacities: &[0.8],
    /// #     color: Color::None,
    /// #     features: None,
    /// # };
    /// # let cameras = CameraSlices {
    /// #     viewmats: &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
    /// #     intrinsics: &[10.0, 10.0, 0.5, 0.5],
    /// #     background: &[0.0; 3],
    /// #     width: 1,
    /// #     height: 1,
    /// # };
    /// # let mut alpha = [0.0];
    /// # let images = Images { image: &mut [], alpha: &mut alpha, depth: None, features: None };
    /// let mut workspace = Workspace::new();
    /// rasterize(&gaussians, &cameras, &RasterSettings::default(), &mut workspace, images)?;
    /// workspace.for_each_hit(|pixel, gaussian, weight, transmittance| {
    ///     assert_eq!((pixel, gaussian, weight, transmittance), (0, 0, 0.8, 1.0));
    /// })?;
    /// # Ok::<(), weaver_splat::RasterError>(())
    /// ```
    pub fn for_each_hit(&self, visit: impl Fn(usize, usize, T, T) + Sync) -> Result<(), RasterError> {
        let (extent, settings) = self.last()?;
        let grid = Grid::new(&extent);
        parallel::for_ranges(extent.views * grid.len(), 1, |tiles| {
            for tile in tiles {
                let list = self.lists.of_tile(tile);
                let first = tile / grid.len() * extent.width * extent.height;
                for (_, window) in windows_of(&grid, tile) {
                    let place = (first, window, extent.gaussians);
                    lanes::run(Report {
                        alpha_max: settings.alpha_max,
                        place,
                        list,
                        splats: &self.splats,
                        visit: &visit,
                    });
                }
            }
        });
        Ok(())
    }

    /// What each Gaussian adds to the last image drawn with this workspace: the sum and the largest of its weights
    /// alpha T over the pixels, `[V, N]` each; 0 where it is not seen.
    ///
    /// # Errors
    ///
    /// Lengths that do not fit, or a workspace that nothing was drawn with.
    pub fn contributions(&mut self, sums: &mut [T], largest: &mut [T]) -> Result<(), RasterError> {
        let (extent, settings) = self.last()?;
        let Extent { gaussians, views, .. } = extent;
        expect_len("sums of the contributions", sums.len(), views * gaussians)?;
        expect_len("largest contributions", largest.len(), views * gaussians)?;
        let grid = Grid::new(&extent);
        let Self { lists, moments, splats, chunks, .. } = self;
        let rows = grown(moments, lists.len());
        for_tiles(lists, 0..views * grid.len(), &mut *rows, &|tile, rows: &mut [Row<T>]| {
            rows.fill(Row::default());
            for (_, window) in windows_of(&grid, tile) {
                let list = lists.of_tile(tile);
                lanes::run(Tally { alpha_max: settings.alpha_max, window, list, splats, rows });
            }
        });
        let per_view = gaussians.div_ceil(GRAIN);
        parallel::for_chunks2(sums, GRAIN, largest, GRAIN, |chunk, sums, largest| {
            for (i, (sum, largest)) in sums.iter_mut().zip(largest).enumerate() {
                let (v, n) = ((chunk * GRAIN + i) / gaussians, (chunk * GRAIN + i) % gaussians);
                (*sum, *largest) = (T::ZERO, T::ZERO);
                for place in chunks[v * per_view + n / GRAIN].places(n % GRAIN) {
                    let row = &rows[place.load(Relaxed) as usize].0;
                    *sum += row[0];
                    *largest = largest.max(row[1]);
                }
            }
        });
        Ok(())
    }
}

/// Tells of every hit in a window.
struct Report<'a, T, F> {
    alpha_max: f64,
    /// First pixel of the view, window, Gaussians per view.
    place: (usize, Window, usize),
    list: &'a [AtomicU32],
    splats: &'a [Splat<T>],
    visit: &'a F,
}

struct Reporter<'a, F> {
    place: (usize, Window, usize),
    gaussian: usize,
    visit: &'a F,
}

impl<V: Lanes, F: Fn(usize, usize, V::Scalar, V::Scalar)> Visitor<V> for Reporter<'_, F> {
    fn begin(&mut self, splat: usize, _record: &[V::Scalar; LANES]) {
        self.gaussian = splat % self.place.2;
    }

    fn hit(&mut self, hit: &Hit<V>) {
        let (first, window, _) = &self.place;
        let (weight, transmittance) = (hit.weight.to_array(), hit.transmittance.to_array());
        let mut todo = hit.seen.bits();
        while todo != 0 {
            let lane = todo.trailing_zeros() as usize;
            todo &= todo - 1;
            let (x, y) = window.pixel(hit.block, lane);
            (self.visit)(first + y * window.width + x, self.gaussian, weight[lane], transmittance[lane]);
        }
    }

    fn end(&mut self, _place: usize) {}
}

impl<T: Real, F: Fn(usize, usize, T, T)> LaneKernel<T> for Report<'_, T, F> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let mut reporter = Reporter { place: self.place, gaussian: 0, visit: self.visit };
        let mut left = [Row([T::ZERO; LANES]); LANES];
        traverse::<V>(self.alpha_max, &self.place.1, self.list, self.splats, &mut left, &mut reporter);
    }
}

/// Sums the weights of the splats of a window.
struct Tally<'a, T> {
    alpha_max: f64,
    window: Window,
    list: &'a [AtomicU32],
    splats: &'a [Splat<T>],
    /// Sum and largest weight of the tile's splats.
    rows: &'a mut [Row<T>],
}

struct Tallier<'a, V: Lanes> {
    sum: V,
    largest: V,
    rows: &'a mut [Row<V::Scalar>],
}

impl<V: Lanes> Visitor<V> for Tallier<'_, V> {
    #[inline(always)]
    fn begin(&mut self, _splat: usize, _record: &[V::Scalar; LANES]) {
        (self.sum, self.largest) = (V::zero(), V::zero());
    }

    #[inline(always)]
    fn hit(&mut self, hit: &Hit<V>) {
        self.sum = self.sum + hit.weight;
        self.largest = self.largest.max(hit.weight);
    }

    #[inline(always)]
    fn end(&mut self, place: usize) {
        let row = &mut self.rows[place].0;
        row[0] += self.sum.to_array().into_iter().sum::<V::Scalar>();
        row[1] = self.largest.to_array().into_iter().fold(row[1], V::Scalar::max);
    }
}

impl<T: Real> LaneKernel<T> for Tally<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes<Scalar = T>>(self) {
        let mut tallier = Tallier::<V> { sum: V::zero(), largest: V::zero(), rows: self.rows };
        let mut left = [Row([T::ZERO; LANES]); LANES];
        traverse::<V>(self.alpha_max, &self.window, self.list, self.splats, &mut left, &mut tallier);
    }
}
