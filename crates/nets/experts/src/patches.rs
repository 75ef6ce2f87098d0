//! The pixels that each Gaussian stands for, and averages over them.

use crate::Routes;
use weaver_autograd::{Backward, Buffer, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_router::{Cell, Cells};

/// Lists of pixels, end to end.
#[derive(Debug)]
pub struct PixelLists {
    /// Start of each list `[G + 1]`.
    start: Buffer<u32>,
    pixel: Buffer<u32>,
}

impl PixelLists {
    /// Takes lists of pixels as they are. None may be empty.
    pub fn from_lists(lists: &[Vec<u32>], pool: &Pool) -> Self {
        let mut all = Self::with_room(lists.len(), lists.iter().map(Vec::len).sum(), pool);
        lists.iter().enumerate().for_each(|(list, pixels)| all.fill(list, pixels.iter().copied()));
        all
    }

    /// So many empty lists, of at most so many pixels in all.
    fn with_room(lists: usize, entries: usize, pool: &Pool) -> Self {
        Self { start: pool.filled(lists + 1, 0), pixel: pool.filled(entries, 0) }
    }

    /// Fills a list; those before it are filled already.
    fn fill(&mut self, list: usize, pixels: impl Iterator<Item = u32>) {
        let mut at = self.start[list];
        for pixel in pixels {
            self.pixel[at as usize] = pixel;
            at += 1;
        }
        self.start[list + 1] = at;
    }

    /// Number of lists G.
    pub fn len(&self) -> usize {
        self.start.len() - 1
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The pixels of a list.
    pub fn of(&self, list: usize) -> &[u32] {
        &self.pixel[self.start[list] as usize..self.start[list + 1] as usize]
    }

    /// A copy that an op can own.
    fn copy(&self, pool: &Pool) -> Self {
        Self { start: pool.copy_of(&self.start), pixel: pool.copy_of(&self.pixel) }
    }
}

/// The pixels of each cell with Gaussians, and the part of them for which each of its Gaussians stands.
#[derive(Debug)]
pub struct Patches {
    /// The pixels of each routed cell, in the order of the routes.
    pub cell: PixelLists,
    /// The pixels of each Gaussian's band, in the order of the routes; all of its cell where some band of that has
    /// none.
    pub band: PixelLists,
    /// Where each Gaussian lies across its cell, in pixels from the mean of its pixels `[N]`.
    pub shift: Vec<f32>,
}

impl Patches {
    /// The patches of routes in views of H x W = `size` pixels. Without `cells`, each pixel is one.
    pub fn new(routes: &Routes, cells: Option<&Cells>, [height, width]: [usize; 2], pool: &Pool) -> Self {
        let cell_of = |pixel: usize| {
            let (row, column) = (pixel / width % height, pixel % width);
            let (level, angle) = cells.map_or((0, 0.0), |cells| (cells.level[pixel], cells.angle[pixel]));
            (pixel / (height * width), Cell { row, column, level }, angle)
        };
        let area = |&pixel: &u32| {
            let (_, cell, _) = cell_of(pixel as usize);
            cell.rows(height).len() * cell.columns(width).len()
        };
        let gaussians = routes.gaussians();
        let mut cell = PixelLists::with_room(routes.routed.len(), routes.routed.iter().map(area).sum(), pool);
        let mut band = PixelLists::with_room(gaussians, routes.pixel.iter().map(area).sum(), pool);
        let mut shift = vec![0.0; gaussians];
        let mut gaussian = 0;
        for (list, (&pixel, count)) in routes.routed.iter().zip(routes.experts()).enumerate() {
            let (view, own, angle) = cell_of(pixel as usize);
            let columns = own.columns(width);
            let pixels = own.rows(height).flat_map(|row| columns.clone().map(move |column| (row, column)));
            let index = |(row, column)| ((view * height + row) * width + column) as u32;
            let bands = own.bands(count, angle);
            let whole = (0..count).any(|band| pixels.clone().all(|(row, column)| bands.of(row, column) != band));
            for number in 0..count {
                let within = |&(row, column): &(usize, usize)| whole || bands.of(row, column) == number;
                band.fill(gaussian, pixels.clone().filter(within).map(index));
                shift[gaussian] = if whole { bands.middle(number) } else { 0.0 };
                gaussian += 1;
            }
            cell.fill(list, pixels.map(index));
        }
        Self { cell, band, shift }
    }
}

#[derive(Debug)]
struct PatchMean {
    lists: PixelLists,
}

impl<T: Real> Op<T> for PatchMean {
    fn name(&self) -> &'static str {
        "patch_mean"
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let used = &self.lists.pixel[..self.lists.start[self.lists.len()] as usize];
        let last = used.iter().max().map_or(0, |&p| p as usize + 1);
        ensure_shape!(ins[0].rank() == 2 && ins[0][0] >= last, "rows [P, C] of at least {last} pixels");
        Ok(Shapes::one([self.lists.len(), ins[0][1]]))
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let (x, width) = (ins[0], ins[0].shape().last());
        for (list, mean) in outs[0].chunks_exact_mut(width).enumerate() {
            let pixels = self.lists.of(list);
            let share = T::ONE / T::from_f64(pixels.len() as f64);
            mean.fill(T::ZERO);
            for &p in pixels {
                let row = &x[p as usize * width..][..width];
                mean.iter_mut().zip(row).for_each(|(mean, x)| *mean += *x);
            }
            mean.iter_mut().for_each(|mean| *mean *= share);
        }
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        let width = ins[0].shape().last();
        if let Some(dx) = &mut dins[0] {
            let dx = dx.accumulator();
            for (list, dmean) in douts[0].chunks_exact(width).enumerate() {
                let pixels = self.lists.of(list);
                let share = T::ONE / T::from_f64(pixels.len() as f64);
                for &p in pixels {
                    let row = &mut dx[p as usize * width..][..width];
                    row.iter_mut().zip(dmean).for_each(|(dx, dmean)| *dx += share * *dmean);
                }
            }
        }
    }
}

/// The mean of the rows of each list: row g of the result is the sum of the rows x_p over the pixels p of list g,
/// divided by their number.
///
/// x `[P, C]` is differentiable, the lists of G groups are constant; the result is `[G, C]`. Panics on other shapes.
#[track_caller]
pub fn patch_mean<'t, T: Real>(x: Var<'t, T>, lists: &PixelLists) -> Var<'t, T> {
    let [mean] = x.tape().apply(PatchMean { lists: lists.copy(x.tape().pool()) }, &[x]);
    mean
}
