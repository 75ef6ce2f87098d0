//! Streams of symbols, each described once for both directions.

use super::colors::{LARGEST_COEFFICIENT, transform};
use super::head::{Head, LARGEST, Steps};
use super::neighbors::{NEIGHBORS, known, neighbors};
use super::symbols::{Symbols, ln_opacities};
use crate::error::CodecError;
use crate::mixed::{MixedBit, MixedModel};
use crate::octree::code_octree;
use crate::raht::Raht;
use crate::range::Coder;

/// Symbols to code, and the state that encoder and decoder share.
pub(super) struct Fields {
    head: Head,
    pub(super) symbols: Symbols,
    near: Vec<[u32; NEIGHBORS]>,
    /// By scales and opacities, once these are known.
    steps: Vec<Steps>,
    /// Coefficients of colors from coarse to fine.
    order: Vec<usize>,
}

/// Largest magnitude that counts in means of the last ones, so that their sums have room.
const LARGEST_RECENT: i32 = 1 << 15;

/// Quarters that predictions take from neighbors, of four.
pub(super) const BLENDS: u32 = 4;

/// Length of a magnitude in bits, up to a largest one.
#[inline(always)]
fn bucket(x: i32, largest: usize) -> usize {
    ((u32::BITS - x.unsigned_abs().leading_zeros()) as usize).min(largest)
}

/// A value moved toward the neighbors' mean, by `blend` quarters.
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
        Self { head, near: neighbors(&symbols.voxels), steps: Vec::new(), order: Vec::new(), symbols }
    }

    /// Sets the steps by each Gaussian's visibility, which the streams behind scales and opacities need. Returns the
    /// transform of colors.
    pub(super) fn see(&mut self) -> Result<Raht, CodecError> {
        let (head, logs) = (self.head, ln_opacities(self.head.opacity_levels));
        let shapes = self.symbols.scales.iter().zip(&self.symbols.opacities);
        self.steps = shapes.map(|(s, opacity)| head.steps(*s, head.shows(*s, *opacity, &logs))).collect();
        let raht = transform(&self.symbols.voxels, &self.steps.iter().map(|steps| steps.factor).collect::<Vec<_>>())?;
        self.order = raht.order();
        Ok(raht)
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
            let range = ((0.87 / self.steps[i].rotation).min(1e6) as i32).max(1);
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

    /// Coefficients of degree 0, from the largest regions to the smallest.
    #[inline(always)]
    pub(super) fn colors(&self, coder: &mut impl Coder, colors: &mut [[i32; 3]]) -> Result<(), CodecError> {
        let mut model = MixedModel::new([16 * 3, 12 * 3, 9 * 3]);
        let mut recent = [[0; 3]];
        for (at, &i) in self.order.iter().enumerate() {
            let (own, mut found) = (colors[i], [0; 3]);
            let all = bucket(total(&recent) >> 3, 11);
            for m in 0..3 {
                let contexts = [16 * m + bucket(recent[0][m] >> 2, 15), 12 * m + all, 9 * m + brothers(found, m)];
                found[m] = coefficient(model.code(coder, contexts, own[m]));
            }
            colors[i] = found;
            remember(&mut recent, &[found]);
            check(coder, "colo", at)?;
        }
        Ok(())
    }

    /// Coefficients of further harmonics: of each degree, are there any? Then these.
    #[inline(always)]
    pub(super) fn harmonics(&self, coder: &mut impl Coder, harmonics: &mut [[i32; 3]]) -> Result<(), CodecError> {
        let rest = harmonics.len() / self.count().max(1);
        let kinds = 3 * rest;
        let mut any = MixedBit::new([5 * 12, 5 * 12]);
        let mut model = MixedModel::new([12 * kinds, 12 * 12 * 3, 9 * kinds]);
        let mut recent = vec![[0; 3]; rest];
        for (at, &i) in self.order.iter().enumerate() {
            let row = &mut harmonics[rest * i..][..rest];
            let (mut sums, mut first, mut degree) = ([0_i32; 3], 0, 1);
            while first < rest {
                let next = first + 2 * degree + 1;
                let lately = total(&recent[first..next]) / (4 * (next - first) as i32);
                let contexts = [12 * degree + bucket(lately, 11), 12 * degree + bucket(total(&[sums]), 11)];
                let there = row[first..next].iter().any(|three| *three != [0; 3]);
                if any.code(coder, contexts, there) {
                    for k in first..next {
                        row[k] = harmonic(coder, &mut model, (k, row[k]), (&recent[k], &mut sums));
                    }
                } else {
                    row[first..next].fill([0; 3]);
                }
                (first, degree) = (next, degree + 1);
            }
            remember(&mut recent, row);
            check(coder, "harm", at)?;
        }
        Ok(())
    }
}

/// Codes the three coefficients of a harmonic. `sums` are the magnitudes of the harmonics before it.
#[inline(always)]
fn harmonic(
    coder: &mut impl Coder,
    model: &mut MixedModel<3>,
    (k, own): (usize, [i32; 3]),
    (recent, sums): (&[i32; 3], &mut [i32; 3]),
) -> [i32; 3] {
    let (count, lately) = (k as i32 + 1, bucket(total(&[*recent]) >> 3, 11));
    let mut found = [0; 3];
    for m in 0..3 {
        let energy = bucket(2 * sums[m] / count + sums[m].min(2), 11);
        let all = bucket(total(&[*sums]), 11);
        let kind = 3 * k + m;
        let contexts = [12 * kind + energy, 12 * (12 * m + all) + lately, 9 * kind + brothers(found, m)];
        found[m] = coefficient(model.code(coder, contexts, own[m]));
        sums[m] = (sums[m] + found[m].abs()).min(LARGEST);
    }
    found
}

#[inline(always)]
fn coefficient(symbol: i32) -> i32 {
    symbol.clamp(-LARGEST_COEFFICIENT, LARGEST_COEFFICIENT)
}

/// Sizes of the mixtures of a color that come before one.
#[inline(always)]
fn brothers(found: [i32; 3], m: usize) -> usize {
    3 * bucket(found[0], 2) + if m == 2 { bucket(found[1], 2) } else { 0 }
}

#[inline(always)]
fn total(rows: &[[i32; 3]]) -> i32 {
    rows.as_flattened().iter().sum()
}

/// Magnitudes of the last coefficients, in parts of 256: each new one counts an eighth.
#[inline(always)]
fn remember(recent: &mut [[i32; 3]], row: &[[i32; 3]]) {
    for (mean, x) in recent.as_flattened_mut().iter_mut().zip(row.as_flattened()) {
        *mean += ((x.abs().min(LARGEST_RECENT) << 8) - *mean) >> 3;
    }
}

/// Depth at which most voxels of a surface hold one of so many points: beyond it a child says as much as three bits.
pub(super) fn octree_depth(count: usize) -> u8 {
    (usize::BITS - count.leading_zeros()).div_ceil(2) as u8 + 2
}

/// A mask of so many bits.
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
        // The bits below the octree, in two parts of at most 32 bits.
        let (high, low) = (below / 2, below - below / 2);
        let upper = u64::from(coder.raw(high, (voxel >> low) as u32 & mask(high)));
        let lower = u64::from(coder.raw(low, voxel as u32 & mask(low)));
        *cell = *cell << below | upper << low | lower;
        check(coder, "posi", i)?;
    }
    Ok(found)
}
