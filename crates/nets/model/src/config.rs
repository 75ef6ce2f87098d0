//! Everything about the network that can be set.

pub mod check;
mod presets;

pub use presets::PRESETS;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use weaver_splat::RasterSettings;

/// Sizes and switches of a [`SplatWeaver`](crate::SplatWeaver); [`ModelConfig::preset`] has the ready-made ones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// Width of the network's images in pixels: a positive multiple of `patch`.
    pub width: usize,
    /// Height of the network's images in pixels: a positive multiple of `patch`.
    pub height: usize,
    /// Side of the square patches that become tokens, in pixels: at least 1.
    pub patch: usize,
    /// Patch encoder and alternating-attention aggregator.
    pub backbone: BackboneConfig,
    /// Camera head.
    pub camera: CameraConfig,
    /// Depth head and feature head.
    pub dense: DenseConfig,
    /// Router, experts, neighbor attention and decoding.
    pub gaussians: GaussianConfig,
    /// Rasterizer.
    pub raster: RasterConfig,
}

/// Patch encoder and alternating-attention aggregator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BackboneConfig {
    /// Width D of a token: a positive multiple of `encoder_heads` and of 4 times `heads`.
    pub dim: usize,
    /// Attention heads of the patch encoder: at least 1.
    pub encoder_heads: usize,
    /// Transformer blocks of the patch encoder; 0 leaves the patch embedding alone.
    pub encoder_depth: usize,
    /// Attention heads of the aggregator: at least 1.
    pub heads: usize,
    /// Rounds of the aggregator, each a block of attention within every view and one across all views: at least 1.
    pub rounds: usize,
    /// Register tokens per view, in the patch encoder and in the aggregator alike: 0 or more.
    pub registers: usize,
    /// Rows and columns of the patch encoder's position table, which is resized to other grids of patches: at
    /// least 1 each. Without it the table has the grid of the configured image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position_table: Option<[usize; 2]>,
    /// Initial value of the aggregator's LayerScale factors: not negative.
    pub layer_scale: f64,
    /// Standard deviation of the initial weights: not negative.
    pub weight_std: f64,
    /// Standard deviation of the initial position table: not negative.
    pub position_std: f64,
    /// Standard deviation of the initial class, camera and register tokens: not negative.
    pub token_std: f64,
}

/// The world frame of the predicted cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PoseFrame {
    /// The frame that the network chooses, as published.
    Network,
    /// The frame of each scene's first camera: emitted camera i is `E_i E_0^-1`, and camera 0 the identity.
    FirstCamera,
}

/// Camera head.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraConfig {
    /// Attention heads: a divisor of twice `backbone.dim`, which is the camera head's width.
    pub heads: usize,
    /// Transformer blocks of the trunk: 0 or more.
    pub depth: usize,
    /// Refinements of the pose codes, all with the same weights: at least 1.
    pub iterations: usize,
    /// Initial value of the trunk's LayerScale factors: not negative.
    pub layer_scale: f64,
    /// World frame of the predicted cameras.
    pub pose_frame: PoseFrame,
    /// Field of view in radians, between 0 and pi, of the code that the first refinement is added to. Without it the
    /// first refinement is the first code, as published.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_fov: Option<f64>,
    /// Added to the tangent of half the field of view where focal lengths are decoded, 0 to 1: 0.001 as published with
    /// SplatWeaver, 0 with VGGT.
    #[serde(default = "tangent_offset")]
    pub tangent_offset: f64,
}

/// Value in configurations that are older than the key.
fn tangent_offset() -> f64 {
    1e-3
}

/// The point of a pixel that its ray passes through.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PixelPoint {
    /// The center, (u + 0.5, v + 0.5).
    Center,
    /// The corner, (u, v), as published.
    Corner,
}

/// Depth head and feature head, and the wavelet guidance of the latter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DenseConfig {
    /// The four rounds of the aggregator that feed the heads, counted from 0, each below `backbone.rounds`; repeats are
    /// allowed.
    pub layers: [usize; 4],
    /// Channels of the four levels: positive multiples of 4.
    pub out_channels: [usize; 4],
    /// Channels of the fusion stages: at least 1.
    pub features: usize,
    /// Channels of the depth head's fusion stages, a positive multiple of 8; half of them are then its full-resolution
    /// channels. Without it the depth head has the sizes of the feature head.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_features: Option<usize>,
    /// Channels C of the full-resolution feature maps E and F: a positive multiple of 4.
    pub channels: usize,
    /// Hidden channels of the depth head's last layers: at least 1.
    pub depth_hidden: usize,
    /// Bound on the absolute value of log depth: positive. Without it depth is unbounded, as published.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log_depth_limit: Option<f64>,
    /// Point of a pixel that its ray passes through.
    pub pixel_point: PixelPoint,
    /// Hidden channels of the path that adds the photo itself to the feature maps: at least 1.
    pub image_skip_hidden: usize,
    /// Hidden channels of the wavelet guidance: at least 1.
    pub guidance_hidden: usize,
    /// Correction of depth by comparing the views. Without it the depth head has the last word, as published.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stereo: Option<StereoConfig>,
}

/// Correction of depth by comparing the views at multiples of it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct StereoConfig {
    /// Channels that are compared: at least 1.
    pub channels: usize,
    /// Hidden channels: at least 1.
    pub hidden: usize,
    /// Depths that are tried for each pixel: at least 2.
    pub depths: usize,
    /// Largest factor between a depth that is tried and the predicted one: above 1.
    pub reach: f64,
}

impl Default for StereoConfig {
    /// Eight channels compared at seventeen depths, from two thirds to one and a half of the predicted one.
    fn default() -> Self {
        Self { channels: 8, hidden: 24, depths: 17, reach: 1.5 }
    }
}

/// The wavelet of the high-frequency prior.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum WaveletKind {
    /// Haar, 2 taps.
    Haar,
    /// Daubechies 2, 4 taps, as published.
    Db2,
}

/// Decoding of the experts' raw numbers to Gaussians, with the constants in each parametrization's own units.
///
/// In a file this is a table whose key `kind` names the parametrization. [`weaver_experts::Parametrization`] has the
/// formulas.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum ParametrizationConfig {
    /// As published: offsets and scales in world units, colors from the network alone.
    Published {
        /// Largest offset of a Gaussian from its pixel's point along each axis, in world units: not negative.
        offset_reach: f64,
        /// Scale per unit of softplus of the raw number, in world units: positive.
        scale_multiplier: f64,
        /// Largest scale, in world units: positive.
        scale_max: f64,
    },
    /// Offsets and scales in footprints (a pixel's width at its depth), colors relative to the pixel's own.
    Footprint {
        /// Largest offset of a Gaussian from its pixel's point along each axis, in footprints: not negative.
        offset_reach: f64,
        /// Scale of a raw 0 where each pixel has one Gaussian, in footprints: positive.
        scale: f64,
    },
    /// Offsets and scales in extents of the patch of surface that a Gaussian stands for, along its axes; colors
    /// relative to its mean color.
    Patch {
        /// Largest offset of a Gaussian along each axis of its patch, in extents: not negative.
        offset_reach: f64,
        /// Scale of a raw 0, in extents: positive.
        scale: f64,
    },
}

/// Router, experts, neighbor attention and decoding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GaussianConfig {
    /// Largest number M of Gaussians that one pixel can have, 1 to 255; there are E = M + 1 experts, one of which makes
    /// none.
    pub max_per_pixel: usize,
    /// Degree of the spherical harmonics of color: 0 to 4.
    pub sh_degree: usize,
    /// Hidden width of the router: at least 1.
    pub router_hidden: usize,
    /// Temperature of the straight-through softmax that trains the router: positive.
    pub temperature: f64,
    /// Width of the projected pixel feature that the neighbor attention reads: at least 1.
    pub projector: usize,
    /// Nearest neighbors that each Gaussian attends to besides itself: 0 to 63.
    pub neighbors: usize,
    /// Width of the neighbor attention: at least 1.
    pub predictor: usize,
    /// True if Gaussians attend to their nearest neighbors before they are decoded; `false` is for ablations.
    pub neighbor_attention: bool,
    /// True if the router sees the wavelet prior; `false` is for ablations.
    pub frequency_prior: bool,
    /// Wavelet of the prior.
    pub wavelet: WaveletKind,
    /// Decoding of raw numbers to Gaussians.
    pub parametrization: ParametrizationConfig,
    /// Factor on the initial output layers of the experts, 1 as published: not negative.
    pub expert_gain: f64,
    /// True if the neighbor attention starts as the identity, with its last layer zero.
    pub zero_predictor: bool,
}

impl GaussianConfig {
    /// The number of experts E = M + 1, the one that makes no Gaussian included.
    pub fn experts(&self) -> usize {
        self.max_per_pixel + 1
    }
}

/// Rasterizer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RasterConfig {
    /// Distance of the near plane from the camera, in world units: positive.
    pub near: f64,
    /// Largest opacity of a single Gaussian at a pixel: above 0 and below 1.
    pub alpha_max: f64,
    /// Background color as red, green and blue, each 0 to 1.
    pub background: [f64; 3],
}

impl RasterConfig {
    /// The rules that images of this model are drawn by.
    pub fn settings(&self) -> RasterSettings {
        RasterSettings { near: self.near, alpha_max: self.alpha_max, ..RasterSettings::default() }
    }
}
