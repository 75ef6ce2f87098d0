//! The backbone: a DINOv2-style patch encoder, VGGT's aggregator of alternating attention, and dense heads on top.
//!
//! Parameter names follow the published checkpoints (`aggregator.*`, `depth_head.*`, `gaussian_param_head.*`). The
//! encoder's `mask_token`, which nothing uses, has no counterpart here.

mod aggregator;
mod camera_head;
mod depth_head;
mod dpt;
mod feature_head;
mod fusion;
mod init;
mod normalize;
mod position;
mod vggt;
mod vision_transformer;

pub use aggregator::{Aggregated, Aggregator, AggregatorConfig};
pub use camera_head::{CameraHead, CameraHeadConfig, PoseEstimate};
pub use depth_head::{DepthHead, DepthHeadConfig, DepthMaps};
pub use dpt::{DenseTokens, DptConfig, DptHead};
pub use feature_head::{FeatureHead, FeatureHeadConfig, PixelFeatures};
pub use fusion::{FusionBlock, ResidualConvUnit};
pub use init::BackboneInit;
pub use normalize::{IMAGENET_MEAN, IMAGENET_STD, normalize_image};
pub use position::{POSITION_WEIGHT, add_position};
pub use vggt::{CameraNetwork, CameraNetworkConfig, Encoded, Vggt, VggtConfig};
pub use vision_transformer::{PatchEmbed, VisionTransformer, VisionTransformerConfig};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
