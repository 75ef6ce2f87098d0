//! Allocation to the cells of quadtrees: a few large Gaussians where the photos are even, many small ones where they
//! are not.

mod distortion;
mod forest;
mod pruning;

use super::{Allocation, AllocationRequest, Assignment, Fixed, bayer};
use crate::cell::Cells;
use distortion::Picture;
use forest::Forest;
use pruning::Pruning;
use weaver_autograd::Real;
use weaver_kernels::random::Stream;

/// The largest number of Gaussians of a cell.
const MOST: usize = 8;

/// Divides the views into square cells of 1 to 16 pixels and gives each at least one Gaussian, so that the photos would
/// lose least at the given count.
///
/// The loss of a cell with e Gaussians is the squared deviation of colors and log depths from the means of e bands,
/// over the cell and a quarter of its side around, which is where its Gaussians show. Of all divisions with
/// floor(budget P) Gaussians in all views together (P counts the pixels inside the masks), the one with the least sum
/// is taken, up to the last few (see the module on pruning). No pixel is left without a cell; a budget below one
/// Gaussian per coarsest cell is raised to that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quadtree {
    /// Gaussians per pixel, above 0.
    pub budget: f64,
}

/// Cells of the same size everywhere, or of two sizes in an even pattern, one Gaussian each: the counterpart of
/// [`Quadtree`] that does not look at the photos.
///
/// As a division of a cell adds three Gaussians, up to two of the budget may remain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuadtreeGrid {
    /// Gaussians per pixel, above 0.
    pub budget: f64,
}

/// The allocation of training for [`Quadtree`]: each step draws a budget.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuadtreeMix {
    /// Smallest and largest budget in Gaussians per pixel; the logarithm is drawn evenly.
    pub budgets: [f64; 2],
    /// True if cells are the same as [`QuadtreeGrid`]'s.
    pub grid: bool,
    /// Share of the steps in which every pixel is a cell of its own and all have as many Gaussians, 1 to M.
    pub dense: f64,
}

impl Default for QuadtreeMix {
    /// Budgets of 0.02 to 1, and one step in sixteen with every pixel.
    fn default() -> Self {
        Self { budgets: [0.02, 1.0], grid: false, dense: 1.0 / 16.0 }
    }
}

/// The angles and losses of an even grid of at most one Gaussian per cell: divided level by level, in the order of a
/// Bayer matrix.
fn even(forest: &Forest) -> (Vec<f32>, Vec<f32>) {
    let losses = |node: usize| {
        let (view, cell) = forest.cell(node);
        let side = cell.side();
        let threshold = bayer::threshold(cell.row / side, cell.column / side, bayer::view_shift(view));
        [f32::INFINITY, (side as f32).powi(4) * (1.0 + threshold as f32)]
    };
    (vec![0.0; forest.nodes()], (0..forest.nodes()).flat_map(losses).collect())
}

/// Forbids cells that hold both pixels that count and others, and lets cells of others alone go without Gaussians.
fn exclude(forest: &Forest, inside: &[bool], [height, width]: [usize; 2], losses: &mut [f32]) {
    let per_node = losses.len() / forest.nodes();
    for (node, losses) in losses.chunks_exact_mut(per_node).enumerate() {
        let (view, cell) = forest.cell(node);
        let columns = cell.columns(width);
        let rows = cell.rows(height).map(|row| (view * height + row) * width);
        let mut pixels = rows.flat_map(|row| &inside[row + columns.start..row + columns.end]);
        let (any, all) = (pixels.clone().any(|inside| *inside), pixels.all(|inside| *inside));
        if !all {
            losses.fill(f32::INFINITY);
            losses[0] = if any { f32::INFINITY } else { 0.0 };
        }
    }
}

fn allocate<T: Real>(request: &AllocationRequest<'_, T>, budget: f64, grid: bool) -> Assignment<T> {
    let (height, width, pool) = (request.height, request.width, request.pool);
    let forest = Forest::new(request.views, height, width);
    let most = if grid { 1 } else { (request.experts() - 1).clamp(1, MOST) };
    let (angles, mut losses) = if grid { even(&forest) } else { Picture::new(request).measure(&forest, most) };
    if let Some(inside) = request.inside {
        exclude(&forest, inside, [height, width], &mut losses);
    }
    let count = (budget * request.pixels_inside() as f64).floor() as usize;
    let mut expert = pool.filled(request.pixels(), 0);
    let mut cells = Cells { level: pool.filled(request.pixels(), 0), angle: pool.filled(request.pixels(), 0.0) };
    for (node, gaussians) in Pruning::new(&forest, &losses, most).leaves(count) {
        let (view, cell) = forest.cell(node);
        let first = (view * height + cell.row) * width + cell.column;
        (expert[first], cells.level[first], cells.angle[first]) = (gaussians, cell.level, angles[node]);
    }
    Assignment { expert, cells: Some(cells), gate: None }
}

impl<T: Real> Allocation<T> for Quadtree {
    fn allocate(&self, request: &AllocationRequest<'_, T>) -> Assignment<T> {
        allocate(request, self.budget, false)
    }
}

impl<T: Real> Allocation<T> for QuadtreeGrid {
    fn allocate(&self, request: &AllocationRequest<'_, T>) -> Assignment<T> {
        allocate(request, self.budget, true)
    }
}

impl<T: Real> Allocation<T> for QuadtreeMix {
    fn allocate(&self, request: &AllocationRequest<'_, T>) -> Assignment<T> {
        let step: Stream = request.stream.fork(0);
        if step.uniform::<f64>(0) < self.dense {
            return Fixed { expert: 1 + step.below(1, request.experts() - 1) as u8 }.allocate(request);
        }
        let [low, high] = self.budgets.map(f64::ln);
        let budget = (low + (high - low) * step.uniform::<f64>(2)).exp();
        allocate(request, budget, self.grid)
    }
}
