//! A control: the size of the same symbols without contexts.

use super::blocks::STREAMS;
use super::colors::Block;
use super::fields::octree_depth;
use super::quality::Quality;
use super::quantized::{Quantized, quantize};
use super::symbols::Symbols;
use crate::adaptive::AdaptiveModel;
use crate::error::CodecError;
use crate::range::CodeLength;
use weaver_scene::Gaussians;

/// Symbols of an alphabet of the control at most; those beyond count as the last one.
const ALPHABET: i32 = 1 << 14;

/// Bits that adaptive models of order 0 take for the symbols of [`encode`](super::encode), stream by stream: one model
/// for each number of a Gaussian, of values or of differences along the Morton order, whichever is shorter; bytes of
/// occupancy for the octree.
///
/// Bits without contexts and mixing; the difference to [`encode`](super::encode) is their gain.
///
/// # Errors
/// As [`encode`](super::encode).
pub fn order_zero_bits(gaussians: &Gaussians, quality: &Quality) -> Result<[([u8; 4], f64); 6], CodecError> {
    let Quantized { head, blocks, .. } = quantize(gaussians, quality)?;
    let mut lengths = STREAMS.map(|name| (name, 0.0));
    for Block { symbols, .. } in &blocks {
        let own = block_bits(head.depth, symbols, gaussians.coefficients() - 1);
        lengths.iter_mut().zip(own).for_each(|((_, bits), own)| *bits += own);
    }
    Ok(lengths)
}

fn block_bits(depth: u8, symbols: &Symbols, rest: usize) -> [f64; 6] {
    let rows = |rows: &[[i32; 3]], stride: usize| -> f64 {
        let column = |first: usize, part: usize| shorter(rows.iter().skip(first).step_by(stride).map(|row| row[part]));
        (0..stride.min(rows.len()))
            .flat_map(|first| (0..3).map(move |part| (first, part)))
            .map(|(f, p)| column(f, p))
            .sum()
    };
    let drops: Vec<[i32; 3]> = symbols.scales.iter().map(|&[a, b, c]| [a, a - b, b - c]).collect();
    [
        occupancy(&symbols.voxels, depth),
        rows(&drops, 1),
        shorter(symbols.opacities.iter().copied()),
        rows(&symbols.rotations, 1),
        rows(&symbols.colors, 1),
        if rest > 0 { rows(&symbols.harmonics, rest) } else { 0.0 },
    ]
}

/// The shorter code of values or of their differences.
fn shorter(values: impl Iterator<Item = i32> + Clone) -> f64 {
    let mut before = 0;
    let differences = values.clone().map(|value| value - std::mem::replace(&mut before, value)).collect::<Vec<_>>();
    length(values).min(length(differences.into_iter()))
}

fn length(values: impl Iterator<Item = i32> + Clone) -> f64 {
    let bounded = values.map(|value| value.clamp(-ALPHABET, ALPHABET - 1));
    let (low, high) = bounded.clone().fold((0, 0), |(low, high), value| (low.min(value), high.max(value)));
    let (mut length, mut model) = (CodeLength::default(), AdaptiveModel::new((high - low + 1) as usize));
    bounded.for_each(|value| _ = model.code(&mut length, (value - low) as usize));
    length.bits
}

/// Bytes that say which children cells have, and three bits a level below the octree.
fn occupancy(voxels: &[u64], depth: u8) -> f64 {
    let octree = depth.min(octree_depth(voxels.len()));
    let (mut length, mut model) = (CodeLength::default(), AdaptiveModel::new(256));
    for level in (depth - octree..depth).rev() {
        let mut children = voxels.iter().map(|voxel| voxel >> (3 * level)).peekable();
        while let Some(first) = children.next() {
            let mut byte = 1 << (first & 7);
            while let Some(brother) = children.next_if(|child| child >> 3 == first >> 3) {
                byte |= 1 << (brother & 7);
            }
            model.code(&mut length, byte);
        }
    }
    length.bits + f64::from(3 * (depth - octree)) * voxels.len() as f64
}
