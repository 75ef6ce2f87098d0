//! Walking the lists of tiles: which primitive meets which pixels, in drawing order, and how much light is left.
//!
//! [`traverse`] walks a tile's list front to back over a window and shows every block that a primitive meets to a
//! [`Visitor`]; drawing, differentiating and counting are visitors. The computation at a pixel depends on the primitive
//! and the pixel alone.

use super::primitive::{Footprint, Response};
use super::window::{BLOCK, Plane, Window};
use super::{ALPHA_MIN, Record, TRANSMITTANCE_END};
use crate::each::each;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use weaver_kernels::lanes::{LANES, LaneMask, Lanes};
use weaver_kernels::simd::prefetch;

/// A primitive at the pixels of a block; `S` is the sample that its response keeps of the pixels.
#[derive(Clone, Copy)]
pub(crate) struct Hit<V: Lanes, S> {
    /// Index of the block.
    pub block: usize,
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
pub(crate) trait Visitor<V: Lanes, R: Response> {
    /// A primitive that may meet blocks.
    fn begin(&mut self, primitive: usize, record: &[V::Scalar; LANES]);
    /// A block that it meets.
    fn hit(&mut self, hit: &Hit<V, R::Sample<V>>);
    /// No more blocks; the primitive is at this place of the list.
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

/// The blocks that each of up to sixteen primitives may be seen in, one bit per block.
#[inline(always)]
fn blocks_of<V: Lanes>(
    footprint: &impl Footprint,
    ids: &[AtomicU32],
    records: &[Record<V::Scalar>],
    window: &Window,
) -> [u16; LANES] {
    let mut columns = each!(LANES, |i| V::load(&records[ids[i.min(ids.len() - 1)].load(Relaxed) as usize].0));
    V::transpose(&mut columns);
    let half = V::constant(0.5);
    let (x, y) = window.corner;
    let (corner_x, corner_y) = (V::constant(x as f64) + half, V::constant(y as f64) + half);
    let far = V::constant(BLOCK as f64 - 1.0);
    let mut seen = [0; LANES];
    for row in 0..BLOCK {
        let top = corner_y + V::constant((row * BLOCK) as f64);
        let (left, right, touched) = footprint.span(&columns, top, top + far);
        let second = footprint.second_span(&columns, top, top + far);
        for column in 0..BLOCK {
            let x = corner_x + V::constant((column * BLOCK) as f64);
            let seen = &mut seen[row * BLOCK + column];
            *seen = (x + far).ge_among(left, right.ge_among(x, touched)).bits();
            if let Some((left, right, touched)) = second {
                *seen |= (x + far).ge_among(left, right.ge_among(x, touched)).bits();
            }
        }
    }
    transpose_bits(seen)
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
    visitor: &mut impl Visitor<V, P>,
) -> Work {
    let (alpha_max, alpha_min) = (V::constant(alpha_max), V::constant(ALPHA_MIN));
    let end = V::constant(TRANSMITTANCE_END);
    let [pixel_x, pixel_y] = window.centers::<V>();
    let columns = each!(BLOCK, |i| primitive.column(V::load(&pixel_x[i].0)));
    let lines = each!(BLOCK, |i| primitive.line(V::load(&pixel_y[i].0)));
    // A pixel that has ended, or is beyond the region, holds its transmittance negated: nothing passes the tests below.
    for (block, left) in transmittance.iter_mut().enumerate() {
        V::constant(1.0).or(V::Mask::from_bits(window.lanes(block)), V::constant(-1.0)).store(&mut left.0);
    }
    let mut work = Work::default();
    for (batch, ids) in list.chunks(LANES).enumerate() {
        let live = live_blocks::<V>(transmittance);
        if live == 0 {
            break;
        }
        // The next records are anywhere in memory.
        let next = list.get((batch + 1) * LANES..).unwrap_or(&[]);
        next.iter().take(LANES).for_each(|id| prefetch(&records[id.load(Relaxed) as usize]));
        let blocks = blocks_of::<V>(primitive, ids, records, window);
        for (i, id) in ids.iter().enumerate() {
            let mut todo = blocks[i] & live;
            if todo == 0 {
                continue;
            }
            let id = id.load(Relaxed) as usize;
            let record = &records[id].0;
            let loaded = primitive.load::<V>(record);
            visitor.begin(id, record);
            while todo != 0 {
                let block = todo.trailing_zeros() as usize % LANES;
                todo &= todo - 1;
                let (raw, sample) = primitive.at(&loaded, &columns[block % BLOCK], &lines[block / BLOCK]);
                let alpha = alpha_max.min(raw);
                let before = V::load(&transmittance[block].0);
                let after = alpha.neg_mul_add(before, before);
                let visible = alpha.ge(alpha_min);
                let seen = after.gt_among(end, visible);
                // No branch: when a pixel ends cannot be predicted.
                let left = after.or(seen, before).negative(visible.and_not(seen));
                left.store(&mut transmittance[block].0);
                work.pairs += u64::from(seen.bits().count_ones());
                work.evaluated += LANES as u64;
                let weight = (alpha * before).only(seen);
                visitor.hit(&Hit { block, seen, sample, raw, alpha, transmittance: before, weight });
            }
            visitor.end(batch * LANES + i);
        }
    }
    for left in transmittance {
        V::load(&left.0).abs().store(&mut left.0);
    }
    work
}

/// The blocks with pixels that have not ended, one bit per block.
#[inline(always)]
fn live_blocks<V: Lanes>(transmittance: &Plane<V::Scalar>) -> u16 {
    let mut live = 0;
    for (block, left) in transmittance.iter().enumerate() {
        live |= u16::from(V::load(&left.0).gt(V::zero()).bits() != 0) << block;
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
