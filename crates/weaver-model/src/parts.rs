//! The configurations of the network's parts, from that of the whole.

use crate::{ModelConfig, ParametrizationConfig, PixelPoint, PoseFrame, WaveletKind};
use weaver_experts::{HeadConfig, NeighborConfig, Parametrization};
use weaver_nn::{Init, WeightInit};
use weaver_vggt::{
    AggregatorConfig, BackboneInit, CameraHeadConfig, DepthHeadConfig, DptConfig, FeatureHeadConfig, VggtConfig,
    VisionTransformerConfig,
};
use weaver_wavelet::Wavelet;

/// Hidden width of a transformer block's perceptron over its width.
const MLP_RATIO: usize = 4;
/// Standard deviation of the depth head's last weights: depth then starts near 1.
const LAST_DEPTH_STD: f64 = 0.02;

impl ModelConfig {
    /// The configuration of the dense network: backbone, camera head and depth head.
    ///
    /// The configuration should have passed [`check`](Self::check).
    pub fn vggt(&self) -> VggtConfig {
        VggtConfig {
            aggregator: self.aggregator(),
            init: self.backbone_init(),
            camera_head: self.camera_head(),
            depth_head: self.depth_head(),
            tangent_offset: self.camera.tangent_offset,
        }
    }

    fn aggregator(&self) -> AggregatorConfig {
        let b = &self.backbone;
        AggregatorConfig {
            encoder: VisionTransformerConfig {
                patch: self.patch,
                dim: b.dim,
                depth: b.encoder_depth,
                heads: b.encoder_heads,
                mlp_ratio: MLP_RATIO,
                registers: b.registers,
                table: b.position_table.unwrap_or([self.height / self.patch, self.width / self.patch]),
            },
            rounds: b.rounds,
            heads: b.heads,
            mlp_ratio: MLP_RATIO,
            registers: b.registers,
            layers: self.dense.layers.to_vec(),
        }
    }

    fn backbone_init(&self) -> BackboneInit {
        let b = &self.backbone;
        BackboneInit {
            weight: WeightInit::TruncatedNormal(b.weight_std),
            position: Init::Normal(b.position_std),
            token: Init::Normal(b.token_std),
            layer_scale: b.layer_scale,
        }
    }

    fn camera_head(&self) -> CameraHeadConfig {
        let c = &self.camera;
        CameraHeadConfig {
            dim: 2 * self.backbone.dim,
            depth: c.depth,
            heads: c.heads,
            mlp_ratio: MLP_RATIO,
            iterations: c.iterations,
            layer_scale: c.layer_scale,
            weight: WeightInit::TruncatedNormal(self.backbone.weight_std),
            token: Init::Normal(self.backbone.token_std),
            base_fov: c.base_fov,
            relative: c.pose_frame == PoseFrame::FirstCamera,
        }
    }

    pub(crate) fn wavelet(&self) -> Wavelet {
        match self.gaussians.wavelet {
            WaveletKind::Haar => Wavelet::Haar,
            WaveletKind::Db2 => Wavelet::Db2,
        }
    }

    /// Where in a pixel its ray passes, in pixels from the corner.
    pub(crate) fn pixel_offset(&self) -> f64 {
        match self.dense.pixel_point {
            PixelPoint::Center => 0.5,
            PixelPoint::Corner => 0.0,
        }
    }

    fn dpt(&self) -> DptConfig {
        DptConfig {
            dim: 2 * self.backbone.dim,
            out_channels: self.dense.out_channels,
            features: self.dense.features,
            width: self.dense.channels,
        }
    }

    fn depth_head(&self) -> DepthHeadConfig {
        let mut dpt = self.dpt();
        if let Some(features) = self.dense.depth_features {
            (dpt.features, dpt.width) = (features, features / 2);
        }
        DepthHeadConfig {
            dpt,
            hidden: self.dense.depth_hidden,
            log_depth_bounds: self.dense.log_depth_limit.map(|limit| (-limit, limit)),
            last: WeightInit::TruncatedNormal(LAST_DEPTH_STD),
        }
    }

    pub(crate) fn feature_head(&self) -> FeatureHeadConfig {
        FeatureHeadConfig { dpt: self.dpt(), merger: self.dense.image_skip_hidden }
    }

    pub(crate) fn head(&self) -> HeadConfig {
        let g = &self.gaussians;
        HeadConfig {
            features: self.dense.channels,
            router_hidden: g.router_hidden,
            max_per_pixel: g.max_per_pixel,
            sh_degree: g.sh_degree,
            neighbors: g.neighbor_attention.then_some(NeighborConfig {
                count: g.neighbors,
                projector: g.projector,
                width: g.predictor,
                zero_head: g.zero_predictor,
            }),
            expert_output_gain: g.expert_gain,
            parametrization: match g.parametrization {
                ParametrizationConfig::Published { offset_reach, scale_multiplier, scale_max } => {
                    Parametrization::Published { offset_reach, scale_multiplier, scale_max }
                }
                ParametrizationConfig::Footprint { offset_reach, scale } => {
                    Parametrization::Footprint { offset_reach, scale }
                }
                ParametrizationConfig::Patch { offset_reach, scale } => Parametrization::Patch { offset_reach, scale },
            },
        }
    }
}
