//! The ready-made networks.

use super::{
    BackboneConfig, CameraConfig, DenseConfig, GaussianConfig, ModelConfig, ParametrizationConfig, PixelPoint,
    PoseFrame, RasterConfig, StereoConfig, WaveletKind,
};

/// Names of the presets for [`ModelConfig::preset`]. The last one is the published network: it is loaded rather than
/// trained.
pub const PRESETS: [&str; 8] =
    ["micro", "tiny", "tiny-endless", "tiny-published", "generalist", "small", "medium", "splatweaver-1b"];

impl ModelConfig {
    /// The network of a preset, if there is one of this name.
    ///
    /// `micro` is for tests and runs in seconds; `tiny` (64x48 pixels) learns on a CPU; `tiny-published` has its size
    /// and the published parametrization; `generalist` makes one Gaussian of each pixel, to be compared with two
    /// experts; `tiny-endless`, `small` (128x96) and `medium` (256x192) have its size, too, and compare views to
    /// correct depth, and the latter two's Gaussians stand for patches of surface; `splatweaver-1b` is the published
    /// network.
    pub fn preset(name: &str) -> Option<Self> {
        match name {
            "tiny" => Some(Self::tiny()),
            "tiny-published" => Some(Self::tiny_published()),
            "generalist" => Some(Self::generalist()),
            "micro" => Some(Self::micro()),
            "tiny-endless" => Some(Self::tiny_endless()),
            "small" => Some(Self::larger(128, 96, 8)),
            "medium" => Some(Self::larger(256, 192, 16)),
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
                position_table: None,
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
                base_fov: Some(1.0),
                tangent_offset: 1e-3,
            },
            dense: DenseConfig {
                layers: [0, 1, 2, 3],
                out_channels: [24, 48, 96, 96],
                features: 32,
                depth_features: None,
                channels: 32,
                depth_hidden: 32,
                log_depth_limit: Some(4.0),
                pixel_point: PixelPoint::Center,
                image_skip_hidden: 8,
                guidance_hidden: 8,
                stereo: None,
            },
            gaussians: GaussianConfig {
                max_per_pixel: 3,
                sh_degree: 1,
                router_hidden: 16,
                temperature: 0.5,
                projector: 16,
                neighbors: 8,
                predictor: 16,
                neighbor_attention: true,
                frequency_prior: true,
                wavelet: WaveletKind::Db2,
                parametrization: ParametrizationConfig::Footprint { offset_reach: 2.0, scale: 0.7 },
                expert_gain: 0.3,
                zero_predictor: true,
            },
            raster: RasterConfig { near: 0.02, alpha_max: 0.99, background: [1.0; 3] },
        }
    }

    /// One network for everything, one Gaussian for each pixel: as many parameters as two experts have.
    fn generalist() -> Self {
        let mut config = Self::tiny();
        config.dense.features = 36;
        config.gaussians =
            GaussianConfig { max_per_pixel: 1, neighbor_attention: false, frequency_prior: false, ..config.gaussians };
        config
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
        config.dense = DenseConfig { features: 64, log_depth_limit: None, ..config.dense };
        config.gaussians = GaussianConfig {
            parametrization: ParametrizationConfig::Published {
                offset_reach: 0.035,
                scale_multiplier: 0.007,
                scale_max: 0.4,
            },
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
            image_skip_hidden: 4,
            guidance_hidden: 4,
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

    fn tiny_endless() -> Self {
        let tiny = Self::tiny();
        Self { dense: DenseConfig { stereo: Some(StereoConfig::default()), ..tiny.dense }, ..tiny }
    }

    /// `tiny-endless` for larger photos, and for cells of all sizes. Its table of positions is sized for 64 x 48
    /// pixels, so that it can start from weights for these.
    fn larger(width: usize, height: usize, patch: usize) -> Self {
        let tiny = Self::tiny_endless();
        let backbone = BackboneConfig { position_table: Some([6, 8]), ..tiny.backbone };
        let parametrization = ParametrizationConfig::Patch { offset_reach: 2.0, scale: 0.7 };
        let gaussians = GaussianConfig { parametrization, ..tiny.gaussians };
        Self { width, height, patch, backbone, gaussians, ..tiny }
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
                position_table: Some([37; 2]),
                ..published.backbone
            },
            camera: CameraConfig { heads: 16, depth: 4, base_fov: None, ..published.camera },
            dense: DenseConfig {
                layers: [4, 11, 17, 23],
                out_channels: [256, 512, 1024, 1024],
                features: 256,
                channels: 128,
                pixel_point: PixelPoint::Corner,
                image_skip_hidden: 32,
                guidance_hidden: 32,
                ..published.dense
            },
            gaussians: GaussianConfig {
                sh_degree: 2,
                router_hidden: 32,
                projector: 32,
                predictor: 32,
                parametrization: ParametrizationConfig::Published {
                    offset_reach: 0.005,
                    scale_multiplier: 0.001,
                    scale_max: 0.4,
                },
                ..published.gaussians
            },
            raster: published.raster,
        }
    }
}
