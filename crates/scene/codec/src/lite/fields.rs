//! Streams of symbols, each described once for both directions.

use super::head::{Head, LARGEST, Steps};
use super::neighbors::{NEIGHBORS, known, neighbors};
use super::symbols::{Symbols, ln_opacities};
use crate::error::CodecError;
use crate::mixed::MixedModel;
use crate::octree::code_octree;
use crate::range::Coder;

/// Symbols that are coded, and what both directions know of them.
pub(super) struct Fields {
    head: Head,
    pub(super) symbols: Symbols,
    near: Vec<[u32; NEIGHBORS]>,
    /// By scales and opacities, once these are known.
    shown: Vec<Shown>,
}

/// Visibility of a Gaussian: halves of a natural logarithm about the reference, and the steps that follow from it.
struct Shown {
    context: usize,
    steps: Steps,
}

/// Quarters that predictions take from neighbors, of four.
pub(super) const BLENDS: u32 = 4;

/// Length of a magnitude in bits, up to a largest one.
#[inline(always)]
fn bucket(x: i32, largest: usize) -> usize {
    ((u32::BITS - x.unsigned_abs().leading_zeros()) as usize).min(largest)
}

/// A value plus what neighbors have more of it, by `blend` quarters.
#[inline(always)]
fn blended(base: i32, mean: i32, blend: u32) -> i32 {
    base + (mean - base) * blend as i32 / BLENDS as i32
}

/// Mean and spread of the neighbors' values, or the base and none.
#[inline(always)]
fn mean_of(values: impl Iterator<Item = i32>, base: i32) -> (i32, i32) {
    let (mut sum, mut count, mut low, mut high) = (0, 0, i32::MAX, i32::MIN);
    for value in values {
        (sum, count, low, high) = (sum + value, count + 1, low.min(value), high.max(value));
    }
    // Quotients by constants.
    match count {
        0 => (base, 0),
        1 => (sum, 0),
        2 => (sum / 2, high - low),
        _ => (sum / 3, high - low),
    }
}

#[inline(always)]
fn bounded(symbol: i32) -> i32 {
    symbol.clamp(-LARGEST, LARGEST)
}

/// The nearest integer, of even ones in the middle, up to 2^20 in magnitude.
#[inline(always)]
fn nearest(x: f32) -> i32 {
    const ROUND: f32 = 12_582_912.0;
    ((x.clamp(-1_048_576.0, 1_048_576.0) + ROUND) - ROUND) as i32
}

/// An error once a decoder has come to the end of its bytes.
fn check(coder: &impl Coder, place: &str, i: usize) -> Result<(), CodecError> {
    if !coder.exhausted() {
        return Ok(());
    }
    Err(CodecError::invalid(format!("stream {place}"), "symbols of all Gaussians", format!("those of {i}")))
}

impl Fields {
    /// Fields whose positions are known.
    pub(super) fn new(head: Head, symbols: Symbols) -> Self {
        Self { head, near: neighbors(&symbols.voxels), shown: Vec::new(), symbols }
    }

    /// Sees how much each Gaussian shows: what streams behind scales and opacities need.
    pub(super) fn see(&mut self) {
        let (head, logs) = (self.head, ln_opacities(self.head.opacity_levels));
        let shown = |(&scales, &opacity): (&[i32; 3], &i32)| {
            let shows = head.shows(scales, opacity, &logs);
            Shown { context: ((shows >> 15) + 6).clamp(0, 9) as usize, steps: head.steps(scales, shows) }
        };
        self.shown = self.symbols.scales.iter().zip(&self.symbols.opacities).map(shown).collect();
    }

    fn count(&self) -> usize {
        self.symbols.voxels.len()
    }

    #[inline(always)]
    pub(super) fn scales(&mut self, coder: &mut impl Coder, blend: u32) -> Result<(), CodecError> {
        let mut largest = MixedModel::new([1, 8, 16]);
        let mut second = MixedModel::new([1, 16, 16]);
        let mut third = MixedModel::new([1, 64, 16]);
        for i in 0..self.count() {
            let scales = &self.symbols.scales;
            let near = known(&self.near, i);
            let (mean, spread) = mean_of(near.clone().map(|j| scales[j][0]), self.head.scale_mean);
            let predicted = blended(self.head.scale_mean, mean, blend);
            let [a, b, c] = scales[i];
            let off = ((mean - self.head.scale_mean) / 4 + 8).clamp(0, 15) as usize;
            let a = bounded(predicted + largest.code(coder, [0, bucket(spread, 7), off], a - predicted));
            let (drop, _) = mean_of(near.clone().map(|j| scales[j][0] - scales[j][1]), 0);
            let large = ((a - self.head.scale_mean) / 4 + 8).clamp(0, 15) as usize;
            let b = bounded(a - second.code(coder, [0, drop.clamp(0, 15) as usize, large], a - b));
            let (fall, _) = mean_of(near.map(|j| scales[j][1] - scales[j][2]), 0);
            let first_drop = ((a - b) / 2).clamp(0, 15) as usize;
            let contexts = [0, (fall / 2).clamp(0, 15) as usize + 16 * (large / 4), first_drop];
            let c = bounded(b - third.code(coder, contexts, b - c));
            self.symbols.scales[i] = [a, b, c];
            check(coder, "scal", i)?;
        }
        Ok(())
    }

    /// Opacities from the largest one downwards.
    #[inline(always)]
    pub(super) fn opacities(&mut self, coder: &mut impl Coder) -> Result<(), CodecError> {
        let levels = self.head.opacity_levels as i32;
        let mut model = MixedModel::new([1, 16, 16]);
        for i in 0..self.count() {
            let (mean, _) = mean_of(known(&self.near, i).map(|j| self.symbols.opacities[j]), self.head.opacity_mean);
            let size = ((self.symbols.scales[i][0] - self.head.scale_mean) / 4 + 8).clamp(0, 15) as usize;
            let contexts = [0, (mean * 16 / (levels + 1)) as usize, size];
            let drop = model.code(coder, contexts, levels - self.symbols.opacities[i]);
            self.symbols.opacities[i] = (levels - drop).clamp(0, levels);
            check(coder, "opac", i)?;
        }
        Ok(())
    }

    #[inline(always)]
    pub(super) fn rotations(&self, coder: &mut impl Coder, rotations: &mut [[i32; 3]]) -> Result<(), CodecError> {
        let mut model = MixedModel::new([16 * 3, 16 * 3, 24 * 3]);
        for (i, rotation) in rotations.iter_mut().enumerate() {
            let scales = self.symbols.scales[i];
            // Numbers of the range: up to √¾ of the step.
            let range = ((0.87 / self.shown[i].steps.rotation).min(1e6) as i32).max(1);
            let fine = 2 * bucket(range, 11) - usize::from(range < 3 << (bucket(range, 11).max(2) - 2));
            let thin = ((scales[0] - scales[2]).saturating_mul(2) / 3).clamp(0, 15) as usize;
            let mut before = 0;
            for (axis, number) in rotation.iter_mut().enumerate() {
                let contexts = [thin * 3 + axis, bucket(before, 15) * 3 + axis, fine.min(23) * 3 + axis];
                let symbol = bounded(model.code(coder, contexts, *number));
                *number = symbol;
                before = before.max(symbol.abs());
            }
            check(coder, "rota", i)?;
        }
        Ok(())
    }

    #[inline(always)]
    pub(super) fn colors(&self, coder: &mut impl Coder, blend: u32, colors: &mut [[i32; 3]]) -> Result<(), CodecError> {
        let mut green = MixedModel::new([1, 16, 10]);
        let mut others = MixedModel::new([2, 16 * 2, 10 * 2, 12 * 2]);
        // Of each Gaussian that is known, green, red and blue as they are drawn.
        let mut drawn = vec![[0.0_f32; 3]; self.count()];
        for i in 0..self.count() {
            let Shown { context: shows, steps: Steps { dc, .. } } = self.shown[i];
            let near = known(&self.near, i);
            // Neighbors in steps of this Gaussian.
            let (dc, per_step) = (dc as f32, 1.0 / dc as f32);
            let like = |j: usize, channel: usize| nearest(drawn[j][channel] * per_step);
            let (mean, spread) = mean_of(near.clone().map(|j| like(j, 0)), 0);
            let predicted = blended(0, mean, blend);
            let own = colors[i];
            let off = green.code(coder, [0, bucket(spread, 15), shows], own[0] - predicted);
            let mut found = [bounded(predicted + off), 0, 0];
            for channel in 1..3 {
                let (mean, spread) = mean_of(near.clone().map(|j| like(j, channel)), 0);
                let red = if channel == 2 { bucket(found[1], 11) } else { bucket(off, 11) };
                let half = channel - 1;
                let contexts = [half, bucket(spread, 15) * 2 + half, shows * 2 + half, red * 2 + half];
                let predicted = blended(0, mean, blend);
                found[channel] = bounded(predicted + others.code(coder, contexts, own[channel] - predicted));
            }
            colors[i] = found;
            drawn[i] = found.map(|symbol| symbol as f32 * dc);
            check(coder, "colo", i)?;
        }
        Ok(())
    }

    #[inline(always)]
    pub(super) fn harmonics(&self, coder: &mut impl Coder, harmonics: &mut [[i32; 3]]) -> Result<(), CodecError> {
        let rest = harmonics.len() / self.count().max(1);
        let kinds = 3 * rest;
        let mut model = MixedModel::new([kinds * 10, kinds * 12, 36 * 12, kinds * 9, kinds * 9]);
        for i in 0..self.count() {
            let shows = self.shown[i].context;
            let (mut sums, mut counts) = ([0; 3], 0);
            for k in 0..rest {
                let at = rest * i + k;
                let mut green = 0;
                for channel in 0..3 {
                    let kind = 3 * k + channel;
                    let energy = bucket(2 * sums[channel] / (counts + 1) + sums[channel].min(2), 11);
                    let all = bucket(sums[0] + sums[1] + sums[2], 11);
                    let mut near = [0; 2];
                    for (j, near) in known(&self.near, i).zip(&mut near) {
                        *near = harmonics[rest * j + k][channel].signum() + 1;
                    }
                    let sides = (near[0] * 3 + near[1]) as usize;
                    let brothers = bucket(green, 2) * 3 + if channel == 2 { bucket(harmonics[at][1], 2) } else { 0 };
                    let contexts = [
                        kind * 10 + shows,
                        kind * 12 + energy,
                        (channel * 12 + all) * 12 + shows,
                        kind * 9 + brothers,
                        kind * 9 + sides,
                    ];
                    let symbol = bounded(model.code(coder, contexts, harmonics[at][channel]));
                    harmonics[at][channel] = symbol;
                    sums[channel] = (sums[channel] + symbol.abs()).min(LARGEST);
                    if channel == 0 {
                        green = symbol;
                    }
                }
                counts += 1;
            }
            check(coder, "harm", i)?;
        }
        Ok(())
    }
}

/// Depth at which most voxels of a surface hold one of so many points: beyond it a child says as much as three bits.
pub(super) fn octree_depth(count: usize) -> u8 {
    (usize::BITS - count.leading_zeros()).div_ceil(2) as u8 + 2
}

/// So many bits of 1.
fn mask(bits: u32) -> u32 {
    ((1_u64 << bits) - 1) as u32
}

/// Codes positions: an octree, then the bits below it.
pub(super) fn positions(
    coder: &mut impl Coder,
    head: &Head,
    count: usize,
    voxels: &[u64],
) -> Result<Vec<u64>, CodecError> {
    let octree = head.depth.min(octree_depth(count));
    let below = 3 * u32::from(head.depth - octree);
    let cells: Vec<u64> = voxels.iter().map(|voxel| voxel >> below).collect();
    let mut found = code_octree(coder, octree.into(), count, &cells)?;
    for (i, cell) in found.iter_mut().enumerate() {
        let voxel = voxels.get(i).copied().unwrap_or(0);
        // What is below the octree, in two parts of at most 32 bits.
        let (high, low) = (below / 2, below - below / 2);
        let upper = u64::from(coder.raw(high, (voxel >> low) as u32 & mask(high)));
        let lower = u64::from(coder.raw(low, voxel as u32 & mask(low)));
        *cell = *cell << below | upper << low | lower;
        check(coder, "posi", i)?;
    }
    Ok(found)
}
