//! The configurations of the network's parts, from the configuration of the whole.

use crate::{
    BackboneConfig, CameraConfig, GaussianConfig, ModelConfig, ParametrizationConfig, PixelPoint, PoseFrame,
    WaveletKind,
};
use weaver_experts::{HeadConfig, NeighborConfig, Parametrization};
use weaver_nn::{Init, WeightInit};
use weaver_vggt::{
    AggregatorConfig, BackboneInit, CameraHeadConfig, CameraNetworkConfig, DepthHeadConfig, DptConfig,
    FeatureHeadConfig, VggtConfig, VisionTransformerConfig,
};
use weaver_wavelet::Wavelet;

/// Hidden width of a transformer block's perceptron over its width.
const MLP_RATIO: usize = 4;
/// Standard deviation of the depth head's last weights: depth then starts near 1.
const LAST_DEPTH_STD: f64 = 0.02;

impl BackboneConfig {
    fn aggregator(&self, patch: usize, [height, width]: [usize; 2], layers: Vec<usize>) -> AggregatorConfig {
        AggregatorConfig {
            encoder: VisionTransformerConfig {
                patch,
                dim: self.dim,
                depth: self.encoder_depth,
                heads: self.encoder_heads,
                mlp_ratio: MLP_RATIO,
                registers: self.registers,
                table: self.position_table.unwrap_or([height / patch, width / patch]),
            },
            rounds: self.rounds,
            heads: self.heads,
            mlp_ratio: MLP_RATIO,
            registers: self.registers,
            layers,
        }
    }

    fn init(&self) -> BackboneInit {
        BackboneInit {
            weight: WeightInit::TruncatedNormal(self.weight_std),
            position: Init::Normal(self.position_std),
            token: Init::Normal(self.token_std),
            layer_scale: self.layer_scale,
        }
    }
}

impl CameraConfig {
    /// Backbone and camera head for images of `size` (H, W) in patches; `layers` are the rounds that dense heads read.
    pub fn network(
        &self,
        backbone: &BackboneConfig,
        patch: usize,
        size: [usize; 2],
        layers: Vec<usize>,
    ) -> CameraNetworkConfig {
        CameraNetworkConfig {
            aggregator: backbone.aggregator(patch, size, layers),
            init: backbone.init(),
            camera_head: CameraHeadConfig {
                dim: 2 * backbone.dim,
                depth: self.depth,
                heads: self.heads,
                mlp_ratio: MLP_RATIO,
                iterations: self.iterations,
                layer_scale: self.layer_scale,
                weight: WeightInit::TruncatedNormal(backbone.weight_std),
                token: Init::Normal(backbone.token_std),
                base_fov: self.base_fov,
                relative: self.pose_frame == PoseFrame::FirstCamera,
            },
            tangent_offset: self.tangent_offset,
        }
    }
}

impl ModelConfig {
    /// The configuration of the dense network: backbone, camera head and depth head.
    ///
    /// The configuration should have passed [`check`](Self::check).
    pub fn vggt(&self) -> VggtConfig {
        let layers = self.dense.layers.to_vec();
        let cameras = self.camera.network(&self.backbone, self.patch, [self.height, self.width], layers);
        VggtConfig { cameras, depth_head: self.depth_head() }
    }

    pub(crate) fn wavelet(&self) -> Wavelet {
        self.gaussians.wavelet.wavelet()
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
        FeatureHeadConfig { dpt: self.dpt(), merger: Some(self.dense.image_skip_hidden) }
    }

    pub(crate) fn head(&self) -> HeadConfig {
        self.gaussians.head(self.dense.channels)
    }
}

impl GaussianConfig {
    /// The configuration of the head that turns so many channels of pixel features into Gaussians.
    ///
    /// The configuration should have passed [`check`](Self::check).
    pub fn head(&self, features: usize) -> HeadConfig {
        HeadConfig {
            features,
            router_hidden: self.router_hidden,
            max_per_pixel: self.max_per_pixel,
            sh_degree: self.sh_degree,
            neighbors: self.neighbor_attention.then_some(NeighborConfig {
                count: self.neighbors,
                projector: self.projector,
                width: self.predictor,
                zero_head: self.zero_predictor,
            }),
            expert_output_gain: self.expert_gain,
            parametrization: self.parametrization.parametrization(),
        }
    }
}

impl WaveletKind {
    /// The wavelet itself.
    pub fn wavelet(self) -> Wavelet {
        match self {
            Self::Haar => Wavelet::Haar,
            Self::Db2 => Wavelet::Db2,
        }
    }
}

impl ParametrizationConfig {
    /// The decoding itself.
    pub fn parametrization(self) -> Parametrization {
        match self {
            Self::Published { offset_reach, scale_multiplier, scale_max } => {
                Parametrization::Published { offset_reach, scale_multiplier, scale_max }
            }
            Self::Footprint { offset_reach, scale } => Parametrization::Footprint { offset_reach, scale },
            Self::Patch { offset_reach, scale } => Parametrization::Patch { offset_reach, scale },
        }
    }
}
