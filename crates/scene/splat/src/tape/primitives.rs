//! The tile layer as an operation on the tape, for primitives of any kind.

use super::rasterize::RenderedVars;
use super::shelf::Shelf;
use crate::error::RasterError;
use crate::gradients::{Cotangents, Target};
use crate::rasterize_backward::background_gradient;
use crate::rasterizer::Images;
use crate::settings::RasterSettings;
use crate::tiles::{
    BackwardPass, Blending, Footprint, Grid, MAX_SUMS, Projection, Region, Response, TileStats, Tiles, moment,
};
use std::fmt::Debug;
use std::sync::{Mutex, PoisonError};
use weaver_autograd::{Backward, Grad, Op, Pool, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};
use weaver_kernels::{Real, parallel};

/// A kind of primitive, with its cameras: how tensors become records, and the chain rule back to the tensors.
///
/// [`RasterizePrimitives`] does the rest. The example `surfels` has a primitive of 150 lines.
pub trait Primitive<T: Real>: Debug + Send + Sync + 'static {
    /// Name of the operation in messages and profiles.
    const NAME: &'static str;
    /// Numbers that each tensor holds of a primitive: tensor i is `[N, ..]` with N times `TENSORS[i]` elements.
    const TENSORS: &'static [usize];
    /// The primitives of one call, which the tile layer works on.
    type Seen<'a>: Projection<T> + Footprint + Response;

    /// Number of views.
    fn views(&self) -> usize;

    /// The primitives with these tensors, for images of `width` x `height` pixels.
    fn seen<'a>(&'a self, tensors: &[&'a [T]], size: [usize; 2]) -> Self::Seen<'a>;

    /// Adds the gradient of primitive `n` through view `view` to `gradient`: the numbers of all its tensors, one tensor
    /// after the other. Called where the primitive covers a tile of the view.
    fn backward(seen: &Self::Seen<'_>, view: usize, n: usize, sums: &PixelSums<T>, gradient: &mut [T]);
}

/// Sums over the pixels of a view for one primitive; w is alpha times the light that arrives.
#[derive(Clone, Copy, Debug)]
pub struct PixelSums<T> {
    /// The sums of [`Response::backward`] and [`Response::depth_backward`]; the first [`Response::SUMS`] are used.
    pub shape: [T; MAX_SUMS],
    /// sum w dimage: the gradient with respect to the color of the record.
    pub color: [T; 3],
    /// sum w ddepth: the gradient with respect to the depth of the record, where [`Response::depth`] is the default.
    pub depth: T,
}

/// Tiles that are kept from step to step. Cloning shares them.
#[derive(Clone, Debug, Default)]
pub struct TilesPool<T>(Shelf<Tiles<T>>);

impl<T: Real> TilesPool<T> {
    /// An empty pool.
    pub fn new() -> Self {
        Self(Shelf::default())
    }

    /// Takes the first failure since the last call: too many list entries. Everything drawn since then is NaN.
    pub fn failure(&self) -> Option<RasterError> {
        self.0.failure()
    }
}

/// Draws primitives in several views, differentiably.
///
/// Inputs: the tensors of the [`Primitive`], then the background `[3]` or `[V, 3]`; all have gradients. Outputs are as
/// for [`Rasterize`](crate::Rasterize). Of the settings, `alpha_max`, `tile` and `region` are used; the others belong
/// to the primitive.
#[derive(Debug)]
pub struct RasterizePrimitives<T: Real, P> {
    primitive: P,
    size: [usize; 2],
    settings: RasterSettings,
    pool: TilesPool<T>,
    /// Set by forward; backward works in it, too.
    tiles: Mutex<Option<Tiles<T>>>,
}

impl<T: Real, P: Primitive<T>> RasterizePrimitives<T, P> {
    /// For views of `width` x `height` pixels.
    pub fn new(primitive: P, [width, height]: [usize; 2], settings: RasterSettings, pool: &TilesPool<T>) -> Self {
        Self { primitive, size: [width, height], settings, pool: pool.clone(), tiles: Mutex::new(None) }
    }

    /// Draws the primitives of `tensors` over `background`.
    ///
    /// # Panics
    ///
    /// If shapes do not fit.
    #[track_caller]
    pub fn apply<'t>(self, tensors: &[Var<'t, T>], background: Var<'t, T>) -> RenderedVars<'t, T> {
        let ins = [tensors, &[background]].concat();
        let [image, alpha, depth, counts] = background.tape().apply(self, &ins);
        RenderedVars { image, alpha, depth, counts }
    }

    fn region(&self) -> Region {
        self.settings.region.unwrap_or(Region::whole(self.size[0], self.size[1]))
    }

    fn blending(&self) -> Blending<'static, T> {
        Blending { alpha_max: self.settings.alpha_max, depth: true, features: None }
    }

    fn seen<'a>(&'a self, ins: &[View<'a, T>]) -> P::Seen<'a> {
        let tensors: Vec<&[T]> = ins[..P::TENSORS.len()].iter().map(View::data).collect();
        self.primitive.seen(&tensors, self.size)
    }

    fn draw(&self, ins: &[View<'_, T>], tiles: &mut Tiles<T>, images: Images<'_, T>) -> Result<TileStats, RasterError> {
        let (seen, blending) = (self.seen(ins), self.blending());
        let grid = Grid::new(self.region(), self.settings.tile);
        let stats = tiles.project(grid, self.primitive.views(), ins[0].shape()[0], &seen, &seen)?;
        tiles.bin(None);
        tiles.blend(&seen, &blending);
        tiles.images(&blending, background_of(ins), images);
        Ok(stats)
    }
}

/// The background of each view: the last input.
fn background_of<'a, T: Real>(ins: &[View<'a, T>]) -> impl Fn(usize) -> [T; 3] + Sync + 'a {
    let background = ins[ins.len() - 1].data();
    move |view| {
        let at = if background.len() == 3 { 0 } else { 3 * view };
        [background[at], background[at + 1], background[at + 2]]
    }
}

impl<T: Real, P> Drop for RasterizePrimitives<T, P> {
    fn drop(&mut self) {
        self.pool.0.put_back(&mut self.tiles);
    }
}

impl<T: Real, P: Primitive<T>> Op<T> for RasterizePrimitives<T, P> {
    fn name(&self) -> &'static str {
        P::NAME
    }

    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let tensors = P::TENSORS.len();
        ensure_shape!(ins.len() == tensors + 1 && ins[0].rank() > 0, "tensors of primitives [N, ..], and a background");
        let (n, views) = (ins[0][0], self.primitive.views());
        let fits = |(shape, numbers): (&Shape, &usize)| shape.rank() > 0 && shape[0] == n && shape.len() == n * numbers;
        ensure_shape!(ins.iter().zip(P::TENSORS).all(fits), "as many numbers of each primitive as it has");
        let background = [Shape::from([3]), Shape::from([views, 3])].contains(&ins[tensors]);
        ensure_shape!(background, "background [3] or [V, 3]");
        let region = self.region();
        ensure_shape!(
            region.is_within(self.size[0], self.size[1]),
            "an image, or a region of it, of at least one pixel"
        );
        let (h, w) = (region.height, region.width);
        Ok(Shapes::one([views, h, w, 3]).and([views, h, w]).and([views, h, w]).and([3]))
    }

    fn auxiliary_outputs(&self) -> usize {
        1
    }

    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        let [image, alpha, depth, counts] = outs else { unreachable!("four outputs, by shapes()") };
        let mut tiles = self.pool.0.take(Tiles::new);
        match self.draw(ins, &mut tiles, Images { image, alpha, depth: Some(depth), features: None }) {
            Ok(stats) => {
                let numbers = [stats.covered, stats.entries, stats.rejected];
                counts.iter_mut().zip(numbers).for_each(|(out, count)| *out = T::from_usize(count));
                self.tiles = Mutex::new(Some(tiles));
            }
            Err(error) => {
                self.pool.0.fail(error);
                outs.iter_mut().for_each(|out| out.fill(T::from_f64(f64::NAN)));
            }
        }
    }

    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, pool, .. } = at;
        let mut held = self.tiles.lock().unwrap_or_else(PoisonError::into_inner);
        // There are no tiles where forward failed.
        let Some(tiles) = held.as_mut() else { return };
        let seen = self.seen(ins);
        let cotangents =
            Cotangents { image: Some(&douts[0]), alpha: Some(&douts[1]), depth: Some(&douts[2]), features: None };
        let pass = BackwardPass { blending: self.blending(), cotangents, statistics: false };
        tiles.backward(&seen, &pass, background_of(ins));
        let tiles = &*tiles;
        let (n, views, numbers) = (ins[0].shape()[0], self.primitive.views(), P::TENSORS.iter().sum::<usize>());
        let mut rows = pool.filled(n * numbers, T::ZERO);
        parallel::for_chunks(&mut rows, numbers, |n, row| {
            for view in 0..views {
                if let Some(sums) = sums_of(tiles, view, n, <P::Seen<'_> as Response>::SUMS) {
                    P::backward(&seen, view, n, &sums, row);
                }
            }
        });
        let mut first = 0;
        let (tensors, background) = dins.split_at_mut(P::TENSORS.len());
        for (grad, len) in tensors.iter_mut().zip(P::TENSORS) {
            if let Some(mut target) = grad.as_mut().map(target) {
                let parts = rows.chunks_exact(numbers).flat_map(|row| &row[first..first + len]);
                parts.enumerate().for_each(|(i, x)| target.put(i, *x));
            }
            first += len;
        }
        if let Some(mut target) = background[0].as_mut().map(target) {
            background_gradient(tiles, ins[ins.len() - 1].len() == 3, &mut target);
        }
    }
}

/// The sums of primitive `n` in a view, if it covers a tile there.
fn sums_of<T: Real>(tiles: &Tiles<T>, view: usize, n: usize, own: usize) -> Option<PixelSums<T>> {
    let mut entries = tiles.entries(view, n).peekable();
    entries.peek()?;
    let mut row = [T::ZERO; weaver_kernels::lanes::LANES];
    entries.for_each(|entry| row.iter_mut().zip(entry).for_each(|(sum, x)| *sum += *x));
    let shape = std::array::from_fn(|i| if i < own { row[i] } else { T::ZERO });
    let color = std::array::from_fn(|i| row[own + moment::COLOR + i]);
    Some(PixelSums { shape, color, depth: row[own + moment::DEPTH] })
}

/// The memory of a gradient, as the rasterizer takes it.
fn target<'a, T: Real>(grad: &'a mut Grad<'_, T>) -> Target<'a, T> {
    match grad.target() {
        (values, beta) if beta == T::ZERO => Target::write(values),
        (values, _) => Target::add(values),
    }
}
