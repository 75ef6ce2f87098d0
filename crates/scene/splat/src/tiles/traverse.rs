//! Walking the lists of tiles: which primitive meets which pixels, in drawing order, and how much light is left.
//!
//! [`traverse`] walks a tile's list front to back over a window and shows every [`Cell`] that a primitive meets to a
//! [`Visitor`]; drawing, differentiating and counting are visitors. The computation at a pixel depends on the primitive
//! and the pixel alone.

use super::primitive::{Footprint, Response};
use super::window::{BLOCK, Cell, MOST_CELLS, MOST_PARTS, Plane, Window};
use super::{ALPHA_MIN, Record, TRANSMITTANCE_END};
use crate::each::each;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use weaver_kernels::lanes::{LANES, LaneMask, Lanes, Vector};
use weaver_kernels::simd::prefetch;

/// A primitive at the pixels of a cell; `S` is the sample that its response keeps of the pixels.
#[derive(Clone, Copy)]
pub(crate) struct Hit<V: Vector, S> {
    pub cell: Cell,
    /// The pixels that it adds to.
    pub seen: V::Mask,
    pub sample: S,
    /// Alpha before it is capped; of any value where not seen.
    pub raw: V,
    /// Alpha; of any value where not seen.
    pub alpha: V,
    /// Light that arrives.
    pub transmittance: V,
    /// Alpha times transmittance, 0 where not seen.
    pub weight: V,
}

/// Visitor of the primitives of a window.
pub(crate) trait Visitor<V: Vector, R: Response> {
    /// A primitive that may meet cells.
    fn begin(&mut self, primitive: usize, record: &[V::Scalar; LANES]);
    /// A cell that it meets.
    fn hit(&mut self, hit: &Hit<V, R::Sample<V>>);
    /// No more cells; the primitive is at this place of the list.
    fn end(&mut self, place: usize);
}

/// Work of a traversal.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Work {
    /// Primitives over pixels that they add to.
    pub pairs: u64,
    /// Lanes processed, masked ones included.
    pub evaluated: u64,
}

/// The cells that each of up to sixteen primitives may be seen in, one bit per cell.
#[inline(always)]
fn cells_of<V: Lanes>(
    footprint: &impl Footprint,
    ids: &[AtomicU32],
    records: &[Record<V::Scalar>],
    window: &Window,
) -> [u32; LANES] {
    let mut columns = each!(LANES, |i| V::load(&records[ids[i.min(ids.len() - 1)].load(Relaxed) as usize].0));
    V::transpose(&mut columns);
    let half = V::constant(0.5);
    let (x, y) = window.corner;
    let (corner_x, corner_y) = (V::constant(x as f64) + half, V::constant(y as f64) + half);
    let height = BLOCK / V::PARTS;
    let (far_x, far_y) = (V::constant(BLOCK as f64 - 1.0), V::constant(height as f64 - 1.0));
    let mut cells = [0; LANES];
    for part in 0..V::PARTS {
        let mut seen = [0; LANES];
        for row in 0..BLOCK {
            let top = corner_y + V::constant((row * BLOCK + part * height) as f64);
            let (left, right, touched) = footprint.span(&columns, top, top + far_y);
            let second = footprint.second_span(&columns, top, top + far_y);
            for column in 0..BLOCK {
                let x = corner_x + V::constant((column * BLOCK) as f64);
                let seen = &mut seen[row * BLOCK + column];
                *seen = (x + far_x).ge_among(left, right.ge_among(x, touched)).bits();
                if let Some((left, right, touched)) = second {
                    *seen |= (x + far_x).ge_among(left, right.ge_among(x, touched)).bits();
                }
            }
        }
        for (cells, seen) in cells.iter_mut().zip(transpose_bits(seen)) {
            *cells |= spread::<V>(seen) << part;
        }
    }
    cells
}

/// Bits of blocks as bits of their first cells.
#[inline(always)]
fn spread<V: Lanes>(blocks: u16) -> u32 {
    let mut bits = u32::from(blocks);
    if V::PARTS == 2 {
        for (shift, kept) in [(8, 0x00ff_00ff), (4, 0x0f0f_0f0f), (2, 0x3333_3333), (1, 0x5555_5555)] {
            bits = (bits | bits << shift) & kept;
        }
    }
    bits
}

/// Bit j of word i becomes bit i of word j.
#[inline(always)]
fn transpose_bits(mut words: [u16; LANES]) -> [u16; LANES] {
    // Swaps the off-diagonal quarters of ever smaller squares.
    let mut swap = |half: usize, low: u16| {
        for i in (0..LANES).filter(|i| i & half == 0) {
            let exchange = (words[i] >> half ^ words[i + half]) & low;
            words[i] ^= exchange << half;
            words[i + half] ^= exchange;
        }
    };
    swap(8, 0x00ff);
    swap(4, 0x0f0f);
    swap(2, 0x3333);
    swap(1, 0x5555);
    words
}

/// Walks `list` front to back over a window until no pixel is open.
///
/// `transmittance` is overwritten with the transmittance behind the last primitive.
#[inline(always)]
pub(crate) fn traverse<V: Lanes, P: Footprint + Response>(
    primitive: &P,
    alpha_max: f64,
    window: &Window,
    list: &[AtomicU32],
    records: &[Record<V::Scalar>],
    transmittance: &mut Plane<V::Scalar>,
    visitor: &mut impl Visitor<V::Part, P>,
) -> Work {
    let (alpha_max, alpha_min) = (V::Part::constant(alpha_max), V::Part::constant(ALPHA_MIN));
    let end = V::Part::constant(TRANSMITTANCE_END);
    let [pixel_x, pixel_y] = window.centers::<V>();
    // All parts of a block have the same columns.
    let columns = each!(BLOCK, |i| primitive.column(V::Part::load_part(&pixel_x[i].0, 0)));
    let mut lines = [primitive.line(V::Part::load_part(&pixel_y[0].0, 0)); BLOCK * MOST_PARTS];
    for (i, line) in lines.iter_mut().enumerate().take(BLOCK * V::PARTS).skip(1) {
        *line = primitive.line(V::Part::load_part(&pixel_y[i / V::PARTS].0, i % V::PARTS));
    }
    // By cells, so that the walk finds everything by one number.
    let columns = each!(MOST_CELLS, |cell| columns[cell / V::PARTS % BLOCK]);
    let lines = each!(MOST_CELLS, |cell| lines[cell / V::PARTS % LANES / BLOCK * V::PARTS + cell % V::PARTS]);
    // A pixel that has ended, or is beyond the region, holds its transmittance negated: nothing passes the tests below.
    for (block, left) in transmittance.iter_mut().enumerate() {
        V::constant(1.0).or(V::Mask::from_bits(window.lanes(block)), V::constant(-1.0)).store(&mut left.0);
    }
    let mut work = Work::default();
    for (batch, ids) in list.chunks(LANES).enumerate() {
        let live = live_cells::<V>(transmittance);
        if live == 0 {
            break;
        }
        // The next records are anywhere in memory.
        let next = list.get((batch + 1) * LANES..).unwrap_or(&[]);
        next.iter().take(LANES).for_each(|id| prefetch(&records[id.load(Relaxed) as usize]));
        let cells = cells_of::<V>(primitive, ids, records, window);
        for (i, id) in ids.iter().enumerate() {
            let mut todo = cells[i] & live;
            if todo == 0 {
                continue;
            }
            let id = id.load(Relaxed) as usize;
            let record = &records[id].0;
            let loaded = primitive.load::<V::Part>(record);
            visitor.begin(id, record);
            work.evaluated += u64::from(todo.count_ones()) * V::Part::WIDTH as u64;
            while todo != 0 {
                let cell = Cell(todo.trailing_zeros() as usize % (LANES * V::PARTS));
                todo &= todo - 1;
                let (raw, sample) = primitive.at(&loaded, &columns[cell.0], &lines[cell.0]);
                let alpha = alpha_max.min(raw);
                let visible = alpha.ge(alpha_min);
                let before: V::Part = cell.load(transmittance);
                // No branch: when a pixel ends cannot be predicted. The same numbers in two ways: masks cost next to
                // nothing with AVX-512; with AVX2 there are fewer of them where alpha is 0, which ends no open pixel.
                let (seen, left, weight) = if V::PARTS == 1 {
                    let after = alpha.neg_mul_add(before, before);
                    let seen = after.gt_among(end, visible);
                    (seen, after.or(seen, before).negative(visible.and_not(seen)), (alpha * before).only(seen))
                } else {
                    let alpha = alpha.only(visible);
                    let after = alpha.neg_mul_add(before, before);
                    let open = after.gt(end);
                    (open.and(visible), after.or(open, -before.abs()), (alpha * before).only(open))
                };
                cell.store(left, transmittance);
                work.pairs += u64::from(seen.bits().count_ones());
                visitor.hit(&Hit { cell, seen, sample, raw, alpha, transmittance: before, weight });
            }
            visitor.end(batch * LANES + i);
        }
    }
    for left in transmittance {
        V::load(&left.0).abs().store(&mut left.0);
    }
    work
}

/// The cells with pixels that have not ended, one bit per cell.
#[inline(always)]
fn live_cells<V: Lanes>(transmittance: &Plane<V::Scalar>) -> u32 {
    let mut live = 0;
    for cell in 0..LANES * V::PARTS {
        let left = V::Part::load_nth(transmittance, cell);
        live |= u32::from(left.gt(V::Part::zero()).bits() != 0) << cell;
    }
    live
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_transposed() {
        let words: [u16; LANES] = std::array::from_fn(|i| (i as u16 + 1).wrapping_mul(40503));
        let turned = transpose_bits(words);
        for (i, word) in words.into_iter().enumerate() {
            for (j, turned) in turned.into_iter().enumerate() {
                assert_eq!(turned >> i & 1, word >> j & 1);
            }
        }
    }
}
