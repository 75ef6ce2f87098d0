//! Everything about WildSplatter that can be set.

use crate::{AppearanceEncoderConfig, LookDecoderConfig};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use weaver_model::check::{MAX_SIZE, cameras, ensure, multiple, not_negative, positive};
use weaver_model::{BackboneConfig, CameraConfig, ModelConfig, RasterConfig};
use weaver_nn::WeightInit;
use weaver_vggt::{DepthHeadConfig, DptConfig, FeatureHeadConfig, VggtConfig};

/// Sizes and switches of [`Wild`](crate::Wild); [`WildConfig::preset`] has the ready-made ones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WildConfig {
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
    pub dense: WildDenseConfig,
    /// One Gaussian for each pixel.
    pub gaussians: WildGaussianConfig,
    /// Embeddings of looks, and what they do to colors.
    pub looks: LookConfig,
    /// Rasterizer.
    pub raster: RasterConfig,
}

/// Depth head and feature head.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WildDenseConfig {
    /// The four rounds of the aggregator that feed the heads, counted from 0, each below `backbone.rounds`; repeats are
    /// allowed.
    pub layers: [usize; 4],
    /// Channels of the four levels: positive multiples of 4.
    pub out_channels: [usize; 4],
    /// Channels of the fusion stages: at least 1.
    pub features: usize,
    /// Channels of the full-resolution feature maps: a positive multiple of 4.
    pub channels: usize,
    /// Hidden channels of the depth head's last layers: at least 1.
    pub depth_hidden: usize,
    /// Bound on the absolute value of log depth: positive.
    pub log_depth_limit: f64,
}

/// Decoding of a pixel's numbers to a Gaussian.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum WildParametrization {
    /// Relative to what a pixel covers at its depth: offsets along the ray and scales in footprints.
    #[default]
    Footprint,
    /// As published: a decoder of its own says how much farther than its depth a Gaussian lies, 0 to 1, and scales are
    /// (1e-5 + (30 - 1e-5) sigmoid(raw)) depth 0.1 (1/fx + 1/fy).
    Published,
}

/// One Gaussian for each pixel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WildGaussianConfig {
    /// Degree of the spherical harmonics of color, 0 to 4: 2 as published.
    pub sh_degree: usize,
    /// Decoding of a pixel's numbers to a Gaussian.
    #[serde(default)]
    pub parametrization: WildParametrization,
    /// Largest offset of a Gaussian from its pixel's depth along the ray, in footprints (a pixel's width at its depth):
    /// not negative. Not of the published parametrization.
    pub offset_reach: f64,
    /// Scale of a raw 0, in footprints: positive. Not of the published parametrization.
    pub scale: f64,
    /// Factor on the initial weights of the last layer: not negative.
    pub gain: f64,
    /// True if the feature head sees each photo standardized, and colors begin with it under the contrast and the
    /// middle of a look; `false` as published, where tokens carry the texture.
    pub recolor: bool,
    /// Hidden channels of the path by which the feature head sees the standardized photo: at least 1.
    pub image_skip_hidden: usize,
}

/// Embeddings of looks, and what they do to colors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LookConfig {
    /// Numbers of an embedding, at least 1: 32 as published.
    pub embedding: usize,
    /// Transformer blocks over a photo's patches, 2 as published.
    pub blocks: usize,
    /// Hidden widths, each at least 1, of the perceptron that makes the embedding: 512 and 512 as published.
    pub hidden: Vec<usize>,
    /// Hidden channels of the convolutions that make colors: at least 1.
    pub decoder_hidden: usize,
}

/// Hidden width of a transformer block's perceptron over its width.
const MLP_RATIO: usize = 4;
/// Standard deviation of the depth head's last weights: depth then starts near 1.
const LAST_DEPTH_STD: f64 = 0.02;

impl WildConfig {
    /// Names of the presets.
    pub const PRESETS: [&str; 2] = ["tiny", "micro"];

    /// The network of a preset, if there is one of this name: `tiny` (64x48 pixels) learns on a CPU, `micro` is for
    /// tests.
    ///
    /// ```
    /// let config = weaver_wild::WildConfig::preset("tiny").unwrap();
    /// assert_eq!((config.width, config.looks.embedding, config.check()), (64, 16, Ok(())));
    /// ```
    pub fn preset(name: &str) -> Option<Self> {
        let known = Self::PRESETS.contains(&name);
        let ModelConfig { width, height, patch, backbone, camera, dense, raster, .. } =
            ModelConfig::preset(name).filter(|_| known)?;
        let dense = WildDenseConfig {
            layers: dense.layers,
            out_channels: dense.out_channels,
            features: dense.features,
            channels: dense.channels,
            depth_hidden: dense.depth_hidden,
            log_depth_limit: dense.log_depth_limit.unwrap_or(4.0),
        };
        let gaussians = WildGaussianConfig {
            sh_degree: 1,
            parametrization: WildParametrization::Footprint,
            offset_reach: 2.0,
            scale: 0.7,
            gain: 0.3,
            recolor: true,
            image_skip_hidden: 8,
        };
        let looks = LookConfig { embedding: 16, blocks: 1, hidden: vec![64], decoder_hidden: 32 };
        let looks = match name {
            "micro" => LookConfig { embedding: 4, hidden: vec![8], decoder_hidden: 8, ..looks },
            _ => looks,
        };
        Some(Self { width, height, patch, backbone, camera, dense, gaussians, looks, raster })
    }

    /// Checks that every setting is in its range and that the sizes fit together.
    ///
    /// # Errors
    /// The first setting out of range: its key, the expected value and the value found.
    pub fn check(&self) -> Result<(), String> {
        let (d, g, l) = (&self.dense, &self.gaussians, &self.looks);
        let sides = [("patch", self.patch), ("width", self.width), ("height", self.height)];
        cameras("", (&self.backbone, &self.camera), sides)?;
        let at_least_one = [
            ("dense.features", d.features),
            ("dense.channels", d.channels),
            ("dense.depth_hidden", d.depth_hidden),
            ("gaussians.image_skip_hidden", g.image_skip_hidden),
            ("looks.embedding", l.embedding),
            ("looks.decoder_hidden", l.decoder_hidden),
        ];
        for (key, value) in at_least_one.into_iter().chain(l.hidden.iter().map(|n| ("looks.hidden", *n))) {
            ensure((1..=MAX_SIZE).contains(&value), key, format_args!("1 to {MAX_SIZE}"), value)?;
        }
        ensure(l.blocks <= MAX_SIZE, "looks.blocks", format_args!("0 to {MAX_SIZE}"), l.blocks)?;
        ensure(g.sh_degree <= 4, "gaussians.sh_degree", "0 to 4", g.sh_degree)?;
        let rounds = self.backbone.rounds;
        for layer in d.layers {
            let expected = format_args!("rounds below backbone.rounds, {rounds}");
            ensure(layer < rounds, "dense.layers", expected, layer)?;
        }
        d.out_channels.into_iter().try_for_each(|n| multiple("dense.out_channels", n, 4))?;
        multiple("dense.channels", d.channels, 4)?;
        positive("dense.log_depth_limit", d.log_depth_limit)?;
        not_negative("gaussians.offset_reach", g.offset_reach)?;
        positive("gaussians.scale", g.scale)?;
        not_negative("gaussians.gain", g.gain)?;
        self.raster.check()
    }

    fn dpt(&self) -> DptConfig {
        let WildDenseConfig { out_channels, features, channels, .. } = self.dense;
        DptConfig { dim: 2 * self.backbone.dim, out_channels, features, width: channels }
    }

    pub(super) fn vggt(&self) -> VggtConfig {
        let (layers, limit) = (self.dense.layers.to_vec(), self.dense.log_depth_limit);
        VggtConfig {
            cameras: self.camera.network(&self.backbone, self.patch, [self.height, self.width], layers),
            depth_head: DepthHeadConfig {
                dpt: self.dpt(),
                hidden: self.dense.depth_hidden,
                log_depth_bounds: Some((-limit, limit)),
                last: WeightInit::TruncatedNormal(LAST_DEPTH_STD),
            },
        }
    }

    pub(super) fn feature_head(&self) -> FeatureHeadConfig {
        let g = &self.gaussians;
        FeatureHeadConfig { dpt: self.dpt(), merger: g.recolor.then_some(g.image_skip_hidden) }
    }

    pub(super) fn encoder(&self) -> AppearanceEncoderConfig {
        let LookConfig { embedding, blocks, ref hidden, .. } = self.looks;
        AppearanceEncoderConfig {
            width: self.backbone.dim,
            heads: self.backbone.heads,
            blocks,
            mlp_ratio: MLP_RATIO,
            layer_scale: 1.0,
            hidden: hidden.clone(),
            embedding,
            init: WeightInit::FanIn,
        }
    }

    pub(super) fn decoder(&self) -> LookDecoderConfig {
        LookDecoderConfig {
            features: self.dense.channels,
            embedding: self.looks.embedding,
            hidden: self.looks.decoder_hidden,
            sh_degree: self.gaussians.sh_degree,
            recolor: self.gaussians.recolor,
        }
    }
}
