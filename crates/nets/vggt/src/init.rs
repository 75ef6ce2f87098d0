//! Initial values of a backbone.

use weaver_nn::{Init, WeightInit};

/// Initial values of a backbone's parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BackboneInit {
    /// Weights of linear layers; the convolution that embeds patches has PyTorch's default.
    pub weight: WeightInit,
    /// Learned position tables.
    pub position: Init,
    /// Class, camera and register tokens.
    pub token: Init,
    /// LayerScale of the alternating blocks; the patch encoder's is 1.
    pub layer_scale: f64,
}

impl BackboneInit {
    /// The published initial values, meant to be overwritten by pretrained weights.
    pub const PUBLISHED: Self = Self {
        weight: WeightInit::TruncatedNormal(0.02),
        position: Init::TruncatedNormal(0.02),
        token: Init::Normal(1e-6),
        layer_scale: 0.01,
    };

    /// Initial values from which a small backbone learns without pretraining: distinct tokens, positions of the order
    /// of the features, and residual branches that contribute from the first step.
    pub const FROM_SCRATCH: Self = Self {
        weight: WeightInit::TruncatedNormal(0.02),
        position: Init::Normal(0.3),
        token: Init::Normal(0.02),
        layer_scale: 0.2,
    };
}
