//! Everything about the two experts that can be set.

use crate::{OpacityDegree, Parametrization, PyramidConfig};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use weaver_model::check::{MAX_SIZE, cameras, ensure, multiple, not_negative, positive};
use weaver_model::{BackboneConfig, CameraConfig, ModelConfig, RasterConfig};
use weaver_vggt::CameraNetworkConfig;

/// Sizes and switches of [`TwoExperts`](crate::TwoExperts); [`TwoExpertsConfig::preset`] has the ready-made ones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TwoExpertsConfig {
    /// Width of the network's images in pixels: a positive multiple of `geometry.patch` and of four times
    /// `appearance.patch`.
    pub width: usize,
    /// Height of the network's images in pixels: as their width.
    pub height: usize,
    /// The network that says where the cameras are.
    pub geometry: GeometryConfig,
    /// The network that is told, and makes the Gaussians.
    pub appearance: AppearanceConfig,
    /// Rasterizer.
    pub raster: RasterConfig,
}

/// The network that says where the cameras are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GeometryConfig {
    /// Side of the square patches that become tokens, in pixels: at least 1.
    pub patch: usize,
    /// Patch encoder and alternating-attention aggregator.
    pub backbone: BackboneConfig,
    /// Camera head.
    pub camera: CameraConfig,
}

/// The network that makes the Gaussians: a pyramid of three levels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AppearanceConfig {
    /// Side of the square patches of the finest level, in pixels: at least 1.
    pub patch: usize,
    /// Width of a token of the finest level, a positive multiple of `head`; each further level has twice as wide ones.
    pub width: usize,
    /// Transformer blocks of the three levels.
    pub blocks: [usize; 3],
    /// Width of an attention head: a positive multiple of 8.
    pub head: usize,
    /// Hidden width of a block's perceptron over the token's: at least 1.
    pub mlp_ratio: usize,
    /// Register tokens per view.
    pub registers: usize,
    /// Neighboring views that attend to one another at the middle level; a divisor of the number of context views: at
    /// least 1.
    pub group: usize,
    /// Channels in which the levels are added up: a positive multiple of 4.
    pub features: usize,
    /// True if attention across views knows the cameras; `false` is for ablations.
    pub camera_attention: bool,
    /// True if rays are given in the world; `false`, in the frame of their own camera, is for ablations.
    pub world_rays: bool,
    /// Degree of the harmonics by which opacity depends on where a Gaussian is seen from: 0, where it does not, or 2 as
    /// published.
    #[serde(default)]
    pub opacity_degree: usize,
    /// Scale of a raw 0, in footprints (a pixel's width at its distance): positive.
    pub scale: f64,
    /// Factor on the initial weights of the last layer: not negative.
    pub gain: f64,
}

impl TwoExpertsConfig {
    /// Names of the presets.
    pub const PRESETS: [&str; 2] = ["tiny", "micro"];

    /// The network of a preset, if there is one of this name: `tiny` (64x48 pixels) learns on a CPU, `micro` is for
    /// tests.
    ///
    /// ```
    /// let config = weaver_two_experts::TwoExpertsConfig::preset("tiny").unwrap();
    /// assert_eq!((config.width, config.appearance.width, config.check()), (64, 32, Ok(())));
    /// ```
    pub fn preset(name: &str) -> Option<Self> {
        let ModelConfig { width, height, patch, backbone, camera, raster, .. } = ModelConfig::preset(name)?;
        let appearance = AppearanceConfig {
            patch: 4,
            width: 32,
            blocks: [1, 2, 2],
            head: 16,
            mlp_ratio: 4,
            registers: 2,
            group: 2,
            features: 48,
            camera_attention: true,
            world_rays: true,
            opacity_degree: 0,
            scale: 0.7,
            gain: 0.3,
        };
        let appearance = match name {
            "tiny" => appearance,
            "micro" => AppearanceConfig { width: 16, head: 8, features: 16, mlp_ratio: 2, ..appearance },
            _ => return None,
        };
        Some(Self { width, height, geometry: GeometryConfig { patch, backbone, camera }, appearance, raster })
    }

    /// Checks that every setting is in its range and that the sizes fit together.
    ///
    /// # Errors
    /// The first setting out of range: its key, the expected value and the value found.
    pub fn check(&self) -> Result<(), String> {
        let (g, a) = (&self.geometry, &self.appearance);
        let sides = [("width", self.width), ("height", self.height)];
        cameras("geometry.", (&g.backbone, &g.camera), [("geometry.patch", g.patch), sides[0], sides[1]])?;
        let at_least_one = [
            ("appearance.patch", a.patch),
            ("appearance.width", a.width),
            ("appearance.head", a.head),
            ("appearance.mlp_ratio", a.mlp_ratio),
            ("appearance.group", a.group),
            ("appearance.features", a.features),
        ];
        for (key, value) in at_least_one {
            ensure((1..=MAX_SIZE).contains(&value), key, format_args!("1 to {MAX_SIZE}"), value)?;
        }
        let counts = [("appearance.registers", a.registers)].into_iter();
        for (key, value) in counts.chain(a.blocks.map(|n| ("appearance.blocks", n))) {
            ensure(value <= MAX_SIZE, key, format_args!("0 to {MAX_SIZE}"), value)?;
        }
        let side = self.pyramid().side();
        let expected = format_args!("a positive multiple of {side}, four times appearance.patch");
        for (key, value) in sides {
            ensure(value.is_multiple_of(side), key, expected, value)?;
        }
        multiple("appearance.head", a.head, 8)?;
        multiple("appearance.width", a.width, a.head)?;
        // Positions are added to tokens of all levels.
        multiple("appearance.features", a.features, 4)?;
        ensure([0, 2].contains(&a.opacity_degree), "appearance.opacity_degree", "0 or 2", a.opacity_degree)?;
        positive("appearance.scale", a.scale)?;
        not_negative("appearance.gain", a.gain)?;
        self.raster.check()
    }

    pub(super) fn camera_network(&self) -> CameraNetworkConfig {
        let g = &self.geometry;
        g.camera.network(&g.backbone, g.patch, [self.height, self.width], Vec::new())
    }

    pub(super) fn pyramid(&self) -> PyramidConfig {
        let a = &self.appearance;
        PyramidConfig {
            patch: a.patch,
            width: a.width,
            blocks: a.blocks,
            head: a.head,
            mlp_ratio: a.mlp_ratio,
            registers: a.registers,
            group: a.group,
            features: a.features,
            cameras: a.camera_attention,
            world_rays: a.world_rays,
            opacity: if a.opacity_degree == 0 { OpacityDegree::Constant } else { OpacityDegree::Two },
            gain: a.gain,
        }
    }

    pub(super) fn parametrization(&self) -> Parametrization {
        Parametrization::Footprint { scale: self.appearance.scale }
    }
}
