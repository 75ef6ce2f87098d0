//! Blending in a window of 16 x 16 pixels: which splat meets which pixels, in drawing order, and what light is left.
//!
//! A window is 4 x 4 blocks of 4 x 4 pixels, and a block is what [`Lanes`] hold. [`traverse`] walks a tile's list front
//! to back and shows every block that a splat meets to a [`Visitor`]; drawing, differentiating and counting are
//! visitors. What happens at a pixel depends on the splat and the pixel alone.

use crate::each::each;
use crate::scene::{ALPHA_MIN, TRANSMITTANCE_END};
use crate::splat::{Outline, Splat, slot};
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use weaver_kernels::Real;
use weaver_kernels::lanes::{LANES, LaneMask, Lanes, Row};
use weaver_kernels::simd::prefetch;

/// Pixels per side of a window.
pub(crate) const SIDE: usize = 16;
/// Pixels per side of a block, and blocks per side of a window.
pub(crate) const BLOCK: usize = 4;
/// One number for each pixel of a window, block by block.
pub(crate) type Plane<T> = [Row<T>; LANES];

/// Where a window lies in its image, and how large that is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Window {
    /// Left and top pixel.
    pub corner: (usize, usize),
    pub width: usize,
    pub height: usize,
}

impl Window {
    /// The pixel (x, y) of a lane of a block; outside the image for windows at its edge.
    #[inline(always)]
    pub fn pixel(&self, block: usize, lane: usize) -> (usize, usize) {
        let x = block % BLOCK * BLOCK + lane % BLOCK;
        let y = block / BLOCK * BLOCK + lane / BLOCK;
        (self.corner.0 + x, self.corner.1 + y)
    }

    /// Whether it is wholly inside the image.
    fn inside(&self) -> bool {
        self.corner.0 + SIDE <= self.width && self.corner.1 + SIDE <= self.height
    }

    /// The lanes of a block that are in the image.
    fn lanes(&self, block: usize) -> u16 {
        if self.inside() {
            return u16::MAX;
        }
        (0..LANES).fold(0, |bits, lane| {
            let (x, y) = self.pixel(block, lane);
            bits | u16::from(x < self.width && y < self.height) << lane
        })
    }

    /// The pixels' centers: x for each column of blocks, y for each row.
    #[inline(always)]
    fn centers<V: Lanes>(&self) -> [[Row<V::Scalar>; BLOCK]; 2] {
        let [mut columns, mut rows] = [[Row::default(); BLOCK]; 2];
        for i in 0..BLOCK {
            for lane in 0..LANES {
                let (x, _) = self.pixel(i, lane);
                let (_, y) = self.pixel(i * BLOCK, lane);
                columns[i].0[lane] = V::Scalar::from_f64(x as f64 + 0.5);
                rows[i].0[lane] = V::Scalar::from_f64(y as f64 + 0.5);
            }
        }
        [columns, rows]
    }

    /// A channel of an image `[H, W, channels]` at the pixels of a block; 0 beyond its edge.
    #[inline(always)]
    pub fn gather<V: Lanes>(&self, block: usize, image: &[V::Scalar], channels: usize, channel: usize) -> V {
        let (x, y) = self.pixel(block, 0);
        if self.inside() {
            let rows = each!(BLOCK, |row| &image[((y + row) * self.width + x) * channels..][..BLOCK * channels]);
            return V::from_fn(
                #[inline(always)]
                |lane| rows[lane / BLOCK][lane % BLOCK * channels + channel],
            );
        }
        V::from_fn(|lane| {
            let (x, y) = self.pixel(block, lane);
            let inside = x < self.width && y < self.height;
            if inside { image[(y * self.width + x) * channels + channel] } else { V::Scalar::ZERO }
        })
    }
}

/// A splat at the pixels of a block.
#[derive(Clone, Copy)]
pub(crate) struct Hit<V: Lanes> {
    /// Which block.
    pub block: usize,
    /// The pixels that it adds to.
    pub seen: V::Mask,
    pub u: V,
    pub v: V,
    /// opacity 2^-(u^2 + v^2); of any value where not seen.
    pub raw: V,
    /// Alpha, the same but capped; of any value where not seen.
    pub alpha: V,
    /// Light that arrives.
    pub transmittance: V,
    /// Alpha times transmittance, 0 where not seen.
    pub weight: V,
}

/// What wants to see the splats of a window.
pub(crate) trait Visitor<V: Lanes> {
    /// A splat that may meet blocks, at this place of the list.
    fn begin(&mut self, splat: usize, record: &[V::Scalar; LANES]);
    /// A block that it meets.
    fn hit(&mut self, hit: &Hit<V>);
    /// No more blocks.
    fn end(&mut self, place: usize);
}

/// How much work a traversal was.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Work {
    /// Splats over pixels that they add to.
    pub pairs: u64,
    /// Lanes processed, masked ones included.
    pub evaluated: u64,
}

/// The blocks that each of up to sixteen splats may be seen in, one bit per block.
#[inline(always)]
fn blocks_of<V: Lanes>(ids: &[AtomicU32], splats: &[Splat<V::Scalar>], window: &Window) -> [u16; LANES] {
    let mut rows = each!(LANES, |i| V::load(&splats[ids[i.min(ids.len() - 1)].load(Relaxed) as usize].0));
    V::transpose(&mut rows);
    let outline = Outline::of_columns(&rows);
    let half = V::constant(0.5);
    let (x, y) = window.corner;
    let (corner_x, corner_y) = (V::constant(x as f64) + half, V::constant(y as f64) + half);
    let far = V::constant(BLOCK as f64 - 1.0);
    let mut seen = [0; LANES];
    for row in 0..BLOCK {
        let top = corner_y + V::constant((row * BLOCK) as f64);
        let (left, right, touched) = outline.span(top, top + far);
        for column in 0..BLOCK {
            let x = corner_x + V::constant((column * BLOCK) as f64);
            seen[row * BLOCK + column] = (x + far).ge_among(left, right.ge_among(x, touched)).bits();
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
/// `transmittance` is overwritten: what is left behind the last splat.
#[inline(always)]
pub(crate) fn traverse<V: Lanes>(
    alpha_max: f64,
    window: &Window,
    list: &[AtomicU32],
    splats: &[Splat<V::Scalar>],
    transmittance: &mut Plane<V::Scalar>,
    visitor: &mut impl Visitor<V>,
) -> Work {
    let (alpha_max, alpha_min) = (V::constant(alpha_max), V::constant(ALPHA_MIN));
    let end = V::constant(TRANSMITTANCE_END);
    let [pixel_x, pixel_y] = window.centers::<V>();
    // A pixel that has ended, or is beyond the image, holds its transmittance negated: nothing passes the tests below.
    for (block, left) in transmittance.iter_mut().enumerate() {
        V::constant(1.0).or(V::Mask::from_bits(window.lanes(block)), V::constant(-1.0)).store(&mut left.0);
    }
    let mut work = Work::default();
    for (batch, ids) in list.chunks(LANES).enumerate() {
        let live = live_blocks::<V>(transmittance);
        if live == 0 {
            break;
        }
        // The next splats are anywhere in memory.
        let next = list.get((batch + 1) * LANES..).unwrap_or(&[]);
        next.iter().take(LANES).for_each(|id| prefetch(&splats[id.load(Relaxed) as usize]));
        let blocks = blocks_of::<V>(ids, splats, window);
        for (i, id) in ids.iter().enumerate() {
            let mut todo = blocks[i] & live;
            if todo == 0 {
                continue;
            }
            let id = id.load(Relaxed) as usize;
            let record = &splats[id].0;
            let (x, y) = (V::splat(record[slot::X]), V::splat(record[slot::Y]));
            let [p, q, r] = each!(3, |i| V::splat(record[slot::P + i]));
            let opacity = V::splat(record[slot::OPACITY]);
            visitor.begin(id, record);
            while todo != 0 {
                let block = todo.trailing_zeros() as usize % LANES;
                todo &= todo - 1;
                let (dx, dy) = (V::load(&pixel_x[block % BLOCK].0) - x, V::load(&pixel_y[block / BLOCK].0) - y);
                let (u, v) = (p.mul_add(dx, q * dy), r * dy);
                let raw = u.neg_mul_add(u, -(v * v)).exp2_times(opacity);
                let alpha = alpha_max.min(raw);
                let before = V::load(&transmittance[block].0);
                let after = alpha.neg_mul_add(before, before);
                let visible = alpha.ge(alpha_min);
                let seen = after.gt_among(end, visible);
                // No branch: which pixels end when is anyone's guess.
                let left = after.or(seen, before).negative(visible.and_not(seen));
                left.store(&mut transmittance[block].0);
                work.pairs += u64::from(seen.bits().count_ones());
                work.evaluated += LANES as u64;
                let weight = (alpha * before).only(seen);
                visitor.hit(&Hit { block, seen, u, v, raw, alpha, transmittance: before, weight });
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
        for i in 0..LANES {
            for j in 0..LANES {
                assert_eq!(turned[j] >> i & 1, words[i] >> j & 1);
            }
        }
    }
}
