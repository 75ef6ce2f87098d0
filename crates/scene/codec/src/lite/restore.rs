//! Gaussians of symbols.

use super::colors::Block;
use super::head::{Head, UNIT};
use super::rotation::with_real_part;
use super::symbols::{ln_opacities, opacity};
use crate::exact::ln;
use crate::morton::from_morton3;
use rayon::prelude::*;
use weaver_scene::Gaussians;

/// Gaussians of blocks that are complete, one block behind the other.
pub(super) fn restore(head: &Head, blocks: &[Block], degree: usize) -> Gaussians {
    let count = blocks.iter().map(|block| block.symbols.voxels.len()).sum();
    let mut gaussians = Gaussians { degree, ..Gaussians::default() };
    let row = 3 * gaussians.coefficients();
    gaussians.means = vec![[0.0; 3]; count];
    gaussians.log_scales = vec![[0.0; 3]; count];
    gaussians.quats = vec![[0.0; 4]; count];
    gaussians.opacity_logits = vec![0.0; count];
    gaussians.sh = vec![0.0; row * count];
    let values = Values::new(head);
    let mut rest = Rows {
        means: &mut gaussians.means,
        log_scales: &mut gaussians.log_scales,
        quats: &mut gaussians.quats,
        opacity_logits: &mut gaussians.opacity_logits,
        sh: &mut gaussians.sh,
    };
    let mut parts = Vec::with_capacity(blocks.len());
    for block in blocks {
        let rows;
        (rows, rest) = rest.split(block.symbols.voxels.len(), row);
        parts.push((block, rows));
    }
    parts.into_par_iter().for_each(|(block, rows)| values.restore(block, rows));
    gaussians
}

/// Numbers of some Gaussians.
struct Rows<'a> {
    means: &'a mut [[f32; 3]],
    log_scales: &'a mut [[f32; 3]],
    quats: &'a mut [[f32; 4]],
    opacity_logits: &'a mut [f32],
    sh: &'a mut [f32],
}

impl Rows<'_> {
    /// The first ones, and the others; a row has so many harmonics.
    fn split(self, count: usize, row: usize) -> (Self, Self) {
        let (means, other_means) = self.means.split_at_mut(count);
        let (log_scales, other_log_scales) = self.log_scales.split_at_mut(count);
        let (quats, other_quats) = self.quats.split_at_mut(count);
        let (opacity_logits, other_opacity_logits) = self.opacity_logits.split_at_mut(count);
        let (sh, other_sh) = self.sh.split_at_mut(row * count);
        let others = Self {
            means: other_means,
            log_scales: other_log_scales,
            quats: other_quats,
            opacity_logits: other_opacity_logits,
            sh: other_sh,
        };
        (Self { means, log_scales, quats, opacity_logits, sh }, others)
    }
}

/// Values that symbols stand for.
struct Values<'a> {
    head: &'a Head,
    /// Of opacities: their logarithms in parts of 2^16, and their logits.
    logs: Vec<i64>,
    logits: Vec<f32>,
}

impl<'a> Values<'a> {
    fn new(head: &'a Head) -> Self {
        let logit = |symbol: u32| {
            let share = opacity(symbol as i32, head.opacity_levels);
            ln(share / (1.0 - share)) as f32
        };
        let logits = (0..=head.opacity_levels).map(logit).collect();
        Self { head, logs: ln_opacities(head.opacity_levels), logits }
    }

    /// Restores the Gaussians of a block.
    fn restore(&self, block: &Block, rows: Rows) {
        let (head, symbols) = (self.head, &block.symbols);
        let scale_step = f64::from(head.scale_step) / UNIT;
        for i in 0..symbols.voxels.len() {
            let scales = symbols.scales[i];
            let steps = head.steps(scales, head.shows(scales, symbols.opacities[i], &self.logs));
            rows.means[i] = head.mean(symbols.voxels[i]);
            rows.log_scales[i] = scales.map(|symbol| (f64::from(symbol) * scale_step) as f32);
            rows.opacity_logits[i] = self.logits[symbols.opacities[i] as usize];
            let part = symbols.rotations[i].map(|symbol| f64::from(symbol) * steps.rotation);
            rows.quats[i] = with_real_part(part).map(|x| x as f32);
        }
        block.restore_colors(head, rows.sh);
    }
}

impl Head {
    /// The position of a voxel.
    fn mean(&self, voxel: u64) -> [f32; 3] {
        let place = from_morton3(voxel);
        std::array::from_fn(|axis| {
            let position = f64::from(self.origin[axis]) + f64::from(self.cell) * f64::from(place[axis]);
            position.clamp(-f64::from(f32::MAX), f64::from(f32::MAX)) as f32
        })
    }
}
