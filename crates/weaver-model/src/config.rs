//! Everything about the network that can be set.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use weaver_kernels::nearest_neighbors::MAX_NEIGHBORS;

/// Sizes and switches of a SplatWeaver; see [`ModelConfig::preset`] for the ready-made ones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// Image width in pixels, a multiple of `patch`.
    pub width: usize,
    /// Image height in pixels, a multiple of `patch`.
    pub height: usize,
    /// Side of a patch, pixels.
    pub patch: usize,
    /// Patch encoder and alternating-attention aggregator.
    pub backbone: BackboneConfig,
    /// Camera head and pose code.
    pub camera: CameraConfig,
    /// Depth head and Gaussian feature trunk.
    pub dense: DenseConfig,
    /// Router, experts, neighbor attention and decoding.
    pub gaussians: GaussianConfig,
    /// Rasterizer.
    pub raster: RasterConfig,
}

/// Patch encoder and aggregator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BackboneConfig {
    /// Token width D.
    pub dim: usize,
    /// Attention heads of the patch encoder.
    pub encoder_heads: usize,
    /// Blocks of the patch encoder.
    pub encoder_depth: usize,
    /// Attention heads of the aggregator; D over this must be divisible by 4.
    pub heads: usize,
    /// Rounds of frame and global attention.
    pub rounds: usize,
    /// Register tokens, of the encoder and of the aggregator alike.
    pub registers: usize,
    /// Rows and columns of the encoder's position table, which is resized to other grids; 0 makes it the grid of the
    /// configured image.
    #[serde(default)]
    pub position_table: [usize; 2],
    /// Initial LayerScale of the aggregator.
    pub layer_scale: f64,
    /// Standard deviation of the initial weights.
    pub weight_std: f64,
    /// Standard deviation of the initial position table.
    pub position_std: f64,
    /// Standard deviation of the initial class, camera and register tokens.
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
    /// Attention heads; the width is 2 D.
    pub heads: usize,
    /// Blocks of the trunk.
    pub depth: usize,
    /// Refinement iterations.
    pub iterations: usize,
    /// Initial LayerScale.
    pub layer_scale: f64,
    /// The world frame of the predicted cameras.
    pub pose_frame: PoseFrame,
    /// Field of view, in radians, that the first refinement starts from; 0 starts from nothing, as published.
    pub base_fov: f64,
}

/// Depth head and Gaussian feature trunk.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DenseConfig {
    /// The four aggregator rounds that feed the heads; repeats are allowed.
    pub layers: [usize; 4],
    /// Channels of the four levels, each divisible by 4.
    pub out_channels: [usize; 4],
    /// Channels of the fusion stages.
    pub features: usize,
    /// Channels of the depth head's fusion stages, where they differ: half of them are then its full-resolution
    /// channels. 0 makes both heads alike.
    #[serde(default)]
    pub depth_features: usize,
    /// Channels of the full-resolution maps E and F, divisible by 4.
    pub channels: usize,
    /// Hidden channels of the depth head's tail.
    pub depth_hidden: usize,
    /// Bound on |log depth|; 0 leaves it free, as published.
    pub log_depth_limit: f64,
    /// Where in a pixel its ray passes: 0.5 is the center, 0 the published corner.
    pub pixel_center: f64,
    /// Hidden channels of the image skip.
    pub merger: usize,
    /// Hidden channels of the wavelet guidance.
    pub wave: usize,
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

/// How raw numbers become Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ParametrizationKind {
    /// Offsets and scales in world units, colors from the network alone.
    Published,
    /// Offsets and scales in units of the pixel's footprint, colors relative to the pixel's own.
    Footprint,
}

/// Router, experts, neighbor attention and decoding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GaussianConfig {
    /// M: the largest number of Gaussians of a pixel.
    pub experts: usize,
    /// Degree of the spherical harmonics, 0 to 4.
    pub sh_degree: usize,
    /// Hidden width of the router.
    pub router_hidden: usize,
    /// Temperature of the straight-through softmax.
    pub temperature: f64,
    /// Width of the projected pixel feature.
    pub projector: usize,
    /// Neighbors of a Gaussian, beside itself.
    pub neighbors: usize,
    /// Width of the neighbor attention.
    pub predictor: usize,
    /// Whether Gaussians attend to their neighbors (an ablation switch).
    pub neighbor_attention: bool,
    /// Whether the router sees the wavelet prior (an ablation switch).
    pub frequency_prior: bool,
    /// The prior's wavelet.
    pub wavelet: WaveletKind,
    /// How raw numbers become Gaussians.
    pub parametrization: ParametrizationKind,
    /// Published: reach of an offset, world units. Footprint: the same in pixels.
    pub offset_reach: f64,
    /// Published: world units per softplus. Footprint: scale over pixel footprint at the start.
    pub scale_multiplier: f64,
    /// Published: largest scale, world units. Footprint: ignored.
    pub scale_max: f64,
    /// Factor on the initial output layers of the experts.
    pub expert_gain: f64,
    /// Whether the neighbor predictor starts as the identity (its last layer zero).
    pub zero_predictor: bool,
}

/// Rasterizer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RasterConfig {
    /// Near plane, scene units.
    pub near: f64,
    /// Largest opacity of a Gaussian at a pixel.
    pub alpha_max: f64,
    /// Background color.
    pub background: [f64; 3],
}

/// Names of the presets.
pub const PRESETS: [&str; 4] = ["micro", "tiny", "tiny-published", "small"];

impl ModelConfig {
    /// The network of a preset: `micro` (seconds, for tests), `tiny` (64x48, what learns on a CPU), `tiny-published`
    /// (the same size with the published parametrization), `small` (128x96 and wider), and `splatweaver-1b`, the
    /// published network, which is loaded rather than trained.
    pub fn preset(name: &str) -> Option<Self> {
        match name {
            "tiny" => Some(Self::tiny()),
            "tiny-published" => Some(Self::tiny_published()),
            "micro" => Some(Self::micro()),
            "small" => Some(Self::small()),
            "splatweaver-1b" => Some(Self::splatweaver_1b()),
            _ => None,
        }
    }

    fn tiny() -> Self {
        Self {
            width: 64,
            height: 48,
            patch: 8,
            backbone: BackboneConfig {
                dim: 96,
                encoder_heads: 3,
                encoder_depth: 2,
                heads: 3,
                rounds: 4,
                registers: 2,
                position_table: [0; 2],
                layer_scale: 0.2,
                weight_std: 0.02,
                position_std: 0.3,
                token_std: 0.02,
            },
            camera: CameraConfig {
                heads: 6,
                depth: 2,
                iterations: 4,
                layer_scale: 0.2,
                pose_frame: PoseFrame::FirstCamera,
                base_fov: 1.0,
            },
            dense: DenseConfig {
                layers: [0, 1, 2, 3],
                out_channels: [24, 48, 96, 96],
                features: 32,
                depth_features: 0,
                channels: 32,
                depth_hidden: 32,
                log_depth_limit: 4.0,
                pixel_center: 0.5,
                merger: 8,
                wave: 8,
            },
            gaussians: GaussianConfig {
                experts: 3,
                sh_degree: 1,
                router_hidden: 16,
                temperature: 0.5,
                projector: 16,
                neighbors: 8,
                predictor: 16,
                neighbor_attention: true,
                frequency_prior: true,
                wavelet: WaveletKind::Db2,
                parametrization: ParametrizationKind::Footprint,
                offset_reach: 2.0,
                scale_multiplier: 0.7,
                scale_max: 0.4,
                expert_gain: 0.3,
                zero_predictor: true,
            },
            raster: RasterConfig { near: 0.02, alpha_max: 0.99, background: [1.0; 3] },
        }
    }

    fn tiny_published() -> Self {
        let mut config = Self::tiny();
        config.backbone = BackboneConfig {
            encoder_depth: 4,
            layer_scale: 0.01,
            position_std: 0.02,
            token_std: 1e-6,
            ..config.backbone
        };
        config.camera = CameraConfig { heads: 4, layer_scale: 0.01, pose_frame: PoseFrame::Network, ..config.camera };
        config.dense = DenseConfig { features: 64, log_depth_limit: 0.0, ..config.dense };
        config.gaussians = GaussianConfig {
            parametrization: ParametrizationKind::Published,
            offset_reach: 0.035,
            scale_multiplier: 0.007,
            expert_gain: 1.0,
            zero_predictor: false,
            ..config.gaussians
        };
        config.raster = RasterConfig { near: 1e-10, alpha_max: 0.999, ..config.raster };
        config
    }

    fn micro() -> Self {
        let mut config = Self::tiny();
        (config.width, config.height) = (32, 32);
        config.backbone =
            BackboneConfig { dim: 32, encoder_heads: 2, heads: 1, rounds: 2, registers: 1, ..config.backbone };
        config.camera = CameraConfig { heads: 1, depth: 1, iterations: 2, ..config.camera };
        config.dense = DenseConfig {
            layers: [0, 1, 1, 1],
            out_channels: [8, 16, 16, 16],
            features: 16,
            channels: 16,
            depth_hidden: 16,
            merger: 4,
            wave: 4,
            ..config.dense
        };
        config.gaussians = GaussianConfig {
            sh_degree: 0,
            router_hidden: 8,
            projector: 8,
            neighbors: 4,
            predictor: 8,
            ..config.gaussians
        };
        config
    }

    fn small() -> Self {
        let mut config = Self::tiny();
        (config.width, config.height) = (128, 96);
        config.backbone =
            BackboneConfig { dim: 192, encoder_depth: 4, encoder_heads: 6, heads: 6, registers: 4, ..config.backbone };
        config.camera = CameraConfig { heads: 12, ..config.camera };
        config.dense = DenseConfig {
            out_channels: [48, 96, 192, 192],
            features: 64,
            channels: 64,
            merger: 16,
            wave: 16,
            ..config.dense
        };
        config.gaussians =
            GaussianConfig { sh_degree: 2, router_hidden: 32, projector: 32, predictor: 32, ..config.gaussians };
        config
    }

    /// The published network: VGGT-1B and the Gaussian head.
    pub fn splatweaver_1b() -> Self {
        let published = Self::tiny_published();
        Self {
            width: 448,
            height: 448,
            patch: 14,
            backbone: BackboneConfig {
                dim: 1024,
                encoder_heads: 16,
                encoder_depth: 24,
                heads: 16,
                rounds: 24,
                registers: 4,
                position_table: [37; 2],
                ..published.backbone
            },
            camera: CameraConfig { heads: 16, depth: 4, base_fov: 0.0, ..published.camera },
            dense: DenseConfig {
                layers: [4, 11, 17, 23],
                out_channels: [256, 512, 1024, 1024],
                features: 256,
                channels: 128,
                pixel_center: 0.0,
                merger: 32,
                wave: 32,
                ..published.dense
            },
            gaussians: GaussianConfig {
                sh_degree: 2,
                router_hidden: 32,
                projector: 32,
                predictor: 32,
                offset_reach: 0.005,
                scale_multiplier: 0.001,
                ..published.gaussians
            },
            raster: published.raster,
        }
    }

    /// Checks that the sizes fit together; the message names the key, what was expected and what was found.
    pub fn check(&self) -> Result<(), String> {
        let positive = [
            ("patch", self.patch),
            ("backbone.dim", self.backbone.dim),
            ("backbone.encoder_heads", self.backbone.encoder_heads),
            ("backbone.heads", self.backbone.heads),
            ("backbone.rounds", self.backbone.rounds),
            ("camera.heads", self.camera.heads),
            ("camera.iterations", self.camera.iterations),
            ("dense.features", self.dense.features),
            ("dense.depth_hidden", self.dense.depth_hidden),
            ("dense.merger", self.dense.merger),
            ("dense.wave", self.dense.wave),
            ("gaussians.experts", self.gaussians.experts),
            ("gaussians.router_hidden", self.gaussians.router_hidden),
            ("gaussians.projector", self.gaussians.projector),
            ("gaussians.predictor", self.gaussians.predictor),
        ];
        for (key, value) in positive {
            if value == 0 {
                return Err(format!("model.{key}: expected a positive number, found 0"));
            }
        }
        let multiples = [
            ("width", self.width, self.patch),
            ("height", self.height, self.patch),
            ("backbone.dim", self.backbone.dim, self.backbone.encoder_heads),
            ("backbone.dim", self.backbone.dim, 4 * self.backbone.heads),
            ("camera: twice backbone.dim", 2 * self.backbone.dim, self.camera.heads),
            ("dense.channels", self.dense.channels, 4),
        ];
        let levels = self.dense.out_channels.map(|c| ("dense.out_channels", c, 4));
        for (key, value, of) in multiples.into_iter().chain(levels) {
            if value == 0 || value % of != 0 {
                return Err(format!("model.{key}: expected a positive multiple of {of}, found {value}"));
            }
        }
        if let Some(layer) = self.dense.layers.iter().find(|&&l| l >= self.backbone.rounds) {
            return Err(format!("model.dense.layers: expected rounds below {}, found {layer}", self.backbone.rounds));
        }
        if self.gaussians.neighbors > MAX_NEIGHBORS {
            let found = self.gaussians.neighbors;
            return Err(format!("model.gaussians.neighbors: expected at most {MAX_NEIGHBORS}, found {found}"));
        }
        if self.gaussians.sh_degree > 4 {
            return Err(format!("model.gaussians.sh_degree: expected 0 to 4, found {}", self.gaussians.sh_degree));
        }
        let above_zero = [("gaussians.temperature", self.gaussians.temperature), ("raster.near", self.raster.near)];
        for (key, value) in above_zero {
            if value.is_nan() || value <= 0.0 {
                return Err(format!("model.{key}: expected a positive number, found {value}"));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_are_consistent() {
        for name in PRESETS.into_iter().chain(["splatweaver-1b"]) {
            let config = ModelConfig::preset(name).expect("listed presets exist");
            assert_eq!(config.check(), Ok(()), "{name}");
        }
    }

    #[test]
    fn a_wrong_size_is_named() {
        let mut config = ModelConfig::tiny();
        config.width = 63;
        assert_eq!(config.check().unwrap_err(), "model.width: expected a positive multiple of 8, found 63");
    }
}
