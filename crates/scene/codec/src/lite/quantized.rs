//! From Gaussians to symbols.

use super::blocks::split;
use super::colors::Block;
use super::head::{Head, LARGEST, MOST_LEVELS, UNIT};
use super::quality::Quality;
use super::rotation::{imaginary_part, sort_axes};
use super::symbols::{Symbols, ln_opacities};
use crate::error::CodecError;
use crate::morton::morton3;
use crate::octree::DEEPEST;
use crate::quantizer::Quantizer;
use rayon::prelude::*;
use weaver_scene::Gaussians;

/// Checks that every number can be stored.
fn check(gaussians: &Gaussians) -> Result<(), CodecError> {
    if !gaussians.lengths_agree() {
        return Err(CodecError::invalid("Gaussians", "fields of one length, a degree up to 4", "others"));
    }
    let per_row = 3 * gaussians.coefficients();
    for i in 0..gaussians.len() {
        let fields: [(&str, &[f32]); 4] = [
            ("position", &gaussians.means[i]),
            ("scale", &gaussians.log_scales[i]),
            ("rotation", &gaussians.quats[i]),
            ("color", &gaussians.sh[i * per_row..][..per_row]),
        ];
        if let Some((name, values)) = fields.iter().find(|(_, values)| !values.iter().all(|x| x.is_finite())) {
            return Err(CodecError::invalid(format!("Gaussian {i}, {name}"), "finite numbers", format!("{values:?}")));
        }
        if gaussians.opacity_logits[i].is_nan() {
            return Err(CodecError::invalid(format!("Gaussian {i}, opacity"), "a number", "NaN"));
        }
    }
    Ok(())
}

/// A scene as symbols.
pub(super) struct Quantized {
    pub(super) head: Head,
    pub(super) blocks: Vec<Block>,
    /// Numbers of its Gaussians, block by block.
    pub(super) order: Vec<usize>,
}

/// Quantizes Gaussians: the symbols of blocks, each in the order of a curve through the grid.
pub(super) fn quantize(gaussians: &Gaussians, quality: &Quality) -> Result<Quantized, CodecError> {
    check(gaussians)?;
    if !(1..=MOST_LEVELS).contains(&quality.opacity_levels) {
        return Err(CodecError::invalid("opacity levels", "1 to 4095", quality.opacity_levels));
    }
    let mut head = Head::new(quality);
    place(&mut head, gaussians, quality);
    let mut order: Vec<(u64, usize)> =
        gaussians.means.par_iter().enumerate().map(|(i, mean)| (head.voxel(*mean), i)).collect();
    order.par_sort_unstable();
    let scale = Quantizer { step: f64::from(head.scale_step) / UNIT, dead_zone: 0.0 };
    let shape = |&(_, i): &(u64, usize)| {
        let (log_scales, quat) = sort_axes(gaussians.log_scales[i], gaussians.quats[i]);
        let share = 1.0 / (1.0 + (-f64::from(gaussians.opacity_logits[i])).exp());
        let scales = log_scales.map(|s| bounded(scale.symbol(f64::from(s))));
        ((scales, (share * f64::from(head.opacity_levels)).round() as i32), imaginary_part(quat))
    };
    let (shapes, turned): (Vec<_>, Vec<[f64; 3]>) = order.par_iter().map(shape).unzip();
    let (scales, opacities) = shapes.into_iter().unzip();
    let voxels = order.iter().map(|(voxel, _)| *voxel).collect();
    let mut symbols = Symbols { voxels, scales, opacities, ..Symbols::default() };
    let logs = ln_opacities(head.opacity_levels);
    refer(&mut head, &symbols, &logs);
    symbols.rotations = (0..order.len())
        .into_par_iter()
        .map(|at| {
            let scales = symbols.scales[at];
            let steps = head.steps(scales, head.shows(scales, symbols.opacities[at], &logs));
            turned[at].map(|part| bounded(Quantizer { step: steps.rotation, dead_zone: 0.0 }.symbol(part)))
        })
        .collect();
    let indices = split(&head, &symbols);
    let block = |indices: &Vec<usize>| {
        let numbers: Vec<usize> = indices.iter().map(|&at| order[at].1).collect();
        Block::new(&head, symbols.select(indices), gaussians, (&numbers, quality.dead_zone))
    };
    let blocks = indices.par_iter().map(block).collect::<Result<_, _>>()?;
    Ok(Quantized { head, blocks, order: indices.iter().flatten().map(|&at| order[at].1).collect() })
}

/// Places the grid about all positions.
fn place(head: &mut Head, gaussians: &Gaussians, quality: &Quality) {
    if gaussians.is_empty() {
        return;
    }
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for mean in &gaussians.means {
        for axis in 0..3 {
            low[axis] = low[axis].min(mean[axis]);
            high[axis] = high[axis].max(mean[axis]);
        }
    }
    let extent = (0..3).map(|axis| f64::from(high[axis]) - f64::from(low[axis])).fold(0.0, f64::max);
    let logs = gaussians.log_scales.as_flattened();
    let mean_log = logs.iter().map(|s| f64::from(*s)).sum::<f64>() / logs.len() as f64;
    let wanted = quality.position * mean_log.exp();
    let finest = extent / f64::from((1_u32 << DEEPEST) - 1);
    let cell = wanted.clamp(finest, f64::from(f32::MAX)).max(f64::from(f32::MIN_POSITIVE));
    head.origin = low;
    head.cell = cell as f32;
    // Rounding to f32 may have made the cell smaller, by less than one of 2^21 steps.
    let steps = (extent / f64::from(head.cell)).round().min(f64::from((1_u32 << DEEPEST) - 1)) as u32;
    head.depth = (u32::BITS - steps.leading_zeros()) as u8;
}

/// Sets the reference of adaptive steps, and the means that predictions begin with.
fn refer(head: &mut Head, symbols: &Symbols, logs: &[i64]) {
    let count = symbols.scales.len().max(1) as f64;
    let mut squares = 0.0;
    for (&scales, &opacity) in symbols.scales.iter().zip(&symbols.opacities) {
        let log = head.shows(scales, opacity, logs) as f64 / UNIT;
        squares += (2.0 * log.clamp(-150.0, 150.0)).exp();
    }
    let root_mean = 0.5 * (squares / count).max(f64::MIN_POSITIVE).ln();
    head.reference = (root_mean * UNIT).round() as i32;
    let mean = |sum: f64| (sum / count).round() as i32;
    head.scale_mean = mean(symbols.scales.iter().map(|s| f64::from(s[0])).sum());
    head.opacity_mean = mean(symbols.opacities.iter().map(|s| f64::from(*s)).sum());
}

fn bounded(symbol: i32) -> i32 {
    symbol.clamp(-LARGEST, LARGEST)
}

impl Head {
    fn voxel(&self, mean: [f32; 3]) -> u64 {
        let end = (1_u64 << self.depth) - 1;
        let place = |axis: usize| {
            let distance = f64::from(mean[axis]) - f64::from(self.origin[axis]);
            ((distance / f64::from(self.cell)).round() as u64).min(end) as u32
        };
        morton3([place(0), place(1), place(2)])
    }
}
