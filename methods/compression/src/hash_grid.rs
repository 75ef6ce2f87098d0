//! Features of positions from hash tables of lattice points.

use std::sync::Arc;
use weaver_autograd::{Backward, Op, Pool, Real, Shape, ShapeError, Shapes, Var, View, ViewMut, ensure_shape};

/// Primes of the hash, one for each axis (Müller et al., 2022).
const PRIMES: [u32; 3] = [1, 2_654_435_761, 805_459_861];

/// A lattice over the unit cube, or over a plane of it, whose points are hashed to rows of a table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HashLevel {
    /// Its axes, up to three.
    pub axes: Vec<usize>,
    /// Cells along each axis.
    pub resolution: u32,
    /// Rows of its table, a power of two.
    pub rows: usize,
}

impl HashLevel {
    /// The row of a lattice point: the exclusive or of its coordinates on the level's axes times primes, modulo the
    /// rows.
    pub fn row(&self, point: [u32; 3]) -> usize {
        let hash = self.axes.iter().fold(0, |hash, &axis| hash ^ point[axis].wrapping_mul(PRIMES[axis]));
        hash as usize & (self.rows - 1)
    }
}

/// Levels with their tables one after the other, and the corners of positions in them.
///
/// The features of a position at a level are interpolated linearly between the corners of its cell: `Σ_c w_c
/// table[row_c]`. Positions are constant, so that corners are found once.
///
/// ```
/// use std::sync::Arc;
/// use weaver_autograd::Tape;
/// use weaver_compression::{HashGrid, HashLevel};
///
/// let levels = [HashLevel { axes: vec![0], resolution: 2, rows: 4 }];
/// let grid = Arc::new(HashGrid::new(&levels, &[[0.25, 0.0, 0.0]]));
/// let tape = Tape::<f64>::new();
/// let table = tape.leaf(&[3.0, 5.0, 7.0, 9.0], [4, 1]);
/// // Halfway between the first two points.
/// assert_eq!(grid.look_up(table).to_vec(), [4.0]);
/// ```
#[derive(Clone, Debug)]
pub struct HashGrid {
    levels: usize,
    positions: usize,
    /// Rows of all tables.
    rows: usize,
    /// Row and weight of each corner, `[positions, levels, 8]`, with weight 0 beyond a level's corners.
    corners: Vec<(u32, f64)>,
}

/// Corners of a cell.
const CORNERS: usize = 8;

impl HashGrid {
    /// Finds the corners of positions, clamped to the unit cube.
    ///
    /// # Panics
    /// For a level whose rows are no power of two, with another axis than 0, 1 and 2, or without cells.
    pub fn new(levels: &[HashLevel], positions: &[[f64; 3]]) -> Self {
        let mut corners = Vec::with_capacity(positions.len() * levels.len() * CORNERS);
        for position in positions {
            let mut first = 0;
            for level in levels {
                let fits =
                    level.rows.is_power_of_two() && level.axes.iter().all(|axis| *axis < 3) && level.axes.len() <= 3;
                assert!(fits && level.resolution > 0, "a level of a hash grid");
                corners.extend(corners_of(level, *position).map(|(row, weight)| ((first + row) as u32, weight)));
                first += level.rows;
            }
        }
        let rows = levels.iter().map(|level| level.rows).sum();
        Self { levels: levels.len(), positions: positions.len(), rows, corners }
    }

    /// Rows of all tables.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Features of all positions, `[N, levels C]`, of tables `[rows, C]`: plain sums in a fixed order, the same bits on
    /// every machine.
    pub fn features<T: Real>(&self, table: &[T], out: &mut [T]) {
        let width = table.len() / self.rows.max(1);
        for (out, corners) in out.chunks_exact_mut(width.max(1)).zip(self.corners.chunks_exact(CORNERS)) {
            out.fill(T::ZERO);
            for (row, weight) in corners {
                let weight = T::from_f64(*weight);
                let values = &table[*row as usize * width..][..width];
                out.iter_mut().zip(values).for_each(|(sum, x)| *sum += weight * *x);
            }
        }
    }

    /// Features of all positions, `[N, levels C]`, of tables `[rows, C]` on the tape. Differentiable.
    ///
    /// # Panics
    /// For tables with another number of rows.
    #[track_caller]
    pub fn look_up<'t, T: Real>(self: &Arc<Self>, table: Var<'t, T>) -> Var<'t, T> {
        let [features] = table.tape().apply(LookUp(self.clone()), &[table]);
        features
    }
}

/// Rows and weights of the corners around a position.
fn corners_of(level: &HashLevel, position: [f64; 3]) -> [(usize, f64); CORNERS] {
    let cells = f64::from(level.resolution);
    let places = position.map(|x| if x.is_finite() { x.clamp(0.0, 1.0) * cells } else { 0.0 });
    let low = places.map(|place| place.min(cells - 1.0).floor());
    std::array::from_fn(|corner| {
        if corner >> level.axes.len() != 0 {
            return (0, 0.0);
        }
        let (mut point, mut weight) = ([0; 3], 1.0);
        for (k, &axis) in level.axes.iter().enumerate() {
            let (upper, beyond) = (corner >> k & 1, places[axis] - low[axis]);
            point[axis] = low[axis] as u32 + upper as u32;
            weight *= if upper == 1 { beyond } else { 1.0 - beyond };
        }
        (level.row(point), weight)
    })
}

#[derive(Debug)]
struct LookUp(Arc<HashGrid>);

impl<T: Real> Op<T> for LookUp {
    fn name(&self) -> &'static str {
        "hash_grid"
    }
    fn shapes(&self, ins: &[Shape]) -> Result<Shapes, ShapeError> {
        let rows = self.0.rows;
        ensure_shape!(ins.len() == 1 && ins[0].rank() == 2 && ins[0][0] == rows, "tables [{rows}, C]");
        Ok(Shapes::one([self.0.positions, self.0.levels * ins[0][1]]))
    }
    fn forward(&mut self, ins: &[View<'_, T>], outs: &mut [ViewMut<'_, T>], _pool: &Pool) {
        self.0.features(&ins[0], &mut outs[0]);
    }
    fn backward(&self, at: Backward<'_, '_, T>) {
        let Backward { ins, douts, dins, .. } = at;
        let Some(dtable) = &mut dins[0] else { return };
        let (width, sums) = (ins[0].shape()[1].max(1), dtable.accumulator());
        // In the order of positions, which fixes the order of summation.
        for (slopes, corners) in douts[0].chunks_exact(width).zip(self.0.corners.chunks_exact(CORNERS)) {
            for (row, weight) in corners.iter().filter(|(_, weight)| *weight != 0.0) {
                let weight = T::from_f64(*weight);
                let row = &mut sums[*row as usize * width..][..width];
                row.iter_mut().zip(slopes).for_each(|(sum, x)| *sum += weight * *x);
            }
        }
    }
}
