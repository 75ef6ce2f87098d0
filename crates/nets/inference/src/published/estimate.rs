//! Estimates the memory that a scene will need.

use super::Opened;
use crate::Error;
use weaver_experts::{NeighborFusion, slot_width};
use weaver_io::Advice;
use weaver_model::ModelConfig;

/// Bytes that running a checkpoint on `views` photos of `size` (H, W) takes, weights included.
///
/// The largest memory in use at once: the weights with the tokens and the widest layer of a transformer block, or with
/// the dense heads' maps of one view beside the results of all views; or, when the backbone's weights have left memory,
/// the attention of the Gaussians over their neighbors.
pub fn bytes(opened: &Opened, views: usize, size: [usize; 2]) -> u64 {
    let [dense, neighbors] = activations(&opened.config, opened.has_gaussians, views as u64, size);
    (opened.bytes() + dense).max(opened.bytes_after_backbone() + neighbors)
}

/// Bytes of activations (without weights) while the network processes photos, and while Gaussians attend to their
/// neighbors.
pub fn activations(config: &ModelConfig, gaussians: bool, views: u64, [height, width]: [usize; 2]) -> [u64; 2] {
    const NUMBER: u64 = 4;
    let [height, width, patch, dim] = [height, width, config.patch, config.backbone.dim].map(|n| n as u64);
    let pixels = height * width;
    let patches = pixels / (patch * patch);
    let tokens = views * (patches + 1 + config.backbone.registers as u64);
    // The four levels that the dense heads read are twice as wide as a token.
    let levels = 4 * 2 * tokens * dim;
    // Input, normalized input, and a hidden layer of four times the width before and after its activation.
    let block = (2 + 2 * 4) * tokens * dim;
    let features = config.dense.features as u64;
    let channels = config.dense.channels as u64;
    // The finest fused maps are at 8 times the patch grid; a residual unit holds some of them a quarter as large.
    let fused = 64 * patches * features * 2;
    let windows = 16 * pixels.max(64 * patches);
    let heads = fused + windows + pixels * (if gaussians { 5 } else { 2 } * channels);
    let kept = if gaussians { views * pixels * (channels + 16) } else { views * pixels * 8 };
    let dense = NUMBER * (levels + block.max(heads + kept));
    if !gaussians || !config.gaussians.neighbor_attention {
        return [dense, 0];
    }
    // The number of Gaussians is not known in advance; published scenes have fewer than 0.6 per pixel. Each has its
    // pixel's features, its raw parameters in several layouts, and its projections for the attention. Pairs of
    // neighbors exist for one chunk of the Gaussians at a time, in some six tensors. The pool's buffers are an eighth
    // larger than requested, on average. Compared with measurements at the published size, the larger of both parts
    // with its weights is 17, 20 and 20 % too much for 2, 4 and 8 photos; for a small network, where this part decides,
    // 20 and 1 % for 8 and 16.
    let drawn = views * pixels * 6 / 10;
    let slot = slot_width(config.gaussians.sh_degree) as u64;
    let [neighbors, width] = [config.gaussians.neighbors, config.gaussians.predictor].map(|n| n as u64);
    let each = 2 * channels + 6 * slot + 8 * width + 6 * neighbors;
    let pairs = drawn.min(NeighborFusion::PART as u64) * (neighbors + 1) * width;
    [dense, NUMBER * (kept + drawn * each + 6 * pairs) * 9 / 8]
}

/// Checks that the free memory suffices, if it is known.
///
/// # Errors
/// [`Error::Memory`] with the figures.
pub fn check(needed: u64, available: Option<u64>, gaussians: bool) -> Result<(), Error> {
    match available {
        Some(available) if available < needed => {
            Err(Error::Memory { needed, available, source: Advice::LessMemory { gaussians } })
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_little_memory_is_refused_with_figures() {
        let refusal = check(5_000_000_000, Some(1_000_000_000), true).unwrap_err().to_string();
        assert!(refusal.contains("5.0 GB") && refusal.contains("1.0 GB"), "{refusal}");
        assert!(check(5, Some(6), true).is_ok() && check(5, None, true).is_ok());
    }

    /// Pairs of neighbors exist for one chunk of the Gaussians at a time: memory grows with the number of Gaussians,
    /// not of pairs.
    #[test]
    fn pairs_of_neighbors_are_not_all_there_at_once() {
        let mut config = ModelConfig::splatweaver_1b();
        let of = |config: &ModelConfig, views| activations(config, true, views, [252, 448])[1] as f64;
        let few = of(&config, 8);
        config.gaussians.neighbors = 32;
        let many = of(&config, 8);
        assert!(many / few < 1.5, "{}", many / few);
    }

    #[test]
    fn more_views_and_more_pixels_need_more() {
        let config = ModelConfig::splatweaver_1b();
        let of = |views, size| activations(&config, true, views, size);
        for part in 0..2 {
            assert!(of(2, [252, 448])[part] < of(4, [252, 448])[part]);
            assert!(of(4, [252, 448])[part] < of(4, [448, 448])[part]);
        }
    }
}
