//! Everything about the network that can be set.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use weaver_model::check::{MAX_SIZE, ensure, multiple};
use weaver_model::{GaussianConfig, ModelConfig, RasterConfig};

/// Levels of the network: 1, 1/2, 1/4, 1/8 and 1/16 of the photos' size.
pub(crate) const LEVELS: usize = 5;

/// Sizes and switches of [`PhotoNetwork`](crate::PhotoNetwork); [`PhotoConfig::preset`] has the ready-made ones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PhotoConfig {
    /// Width of the photos that it is trained and evaluated with, pixels; it takes photos of any size.
    pub width: usize,
    /// Height of the photos that it is trained and evaluated with, pixels.
    pub height: usize,
    /// Channels at 1, 1/2, 1/4, 1/8 and 1/16 of the photos' size: each at least 1, the last one a multiple of `head`.
    pub channels: [usize; LEVELS],
    /// Residual blocks of each level but the first, on the way down; on the way up there is one.
    pub blocks: usize,
    /// Rounds of attention at 1/16: within each photo, then across all of them.
    pub rounds: usize,
    /// Width of an attention head: a positive multiple of 8.
    pub head: usize,
    /// Hidden width of an attention block's perceptron over the token's: at least 1.
    pub mlp_ratio: usize,
    /// Channels of the features that experts and router see: at least 3.
    pub features: usize,
    /// Router, experts, neighbor attention and decoding. The decoding is relative: `footprint` or `patch`.
    pub gaussians: GaussianConfig,
    /// Rasterizer.
    pub raster: RasterConfig,
}

impl PhotoConfig {
    /// Names of the presets: the same network for photos of 64, 128 and 192 pixels, and a small one for tests.
    pub const PRESETS: [&str; 4] = ["photo-64", "photo-128", "photo-192", "micro"];

    /// The network of a preset, if there is one of this name.
    ///
    /// ```
    /// let config = weaver_photo::PhotoConfig::preset("photo-192").unwrap();
    /// assert_eq!((config.width, config.height, config.check()), (192, 144, Ok(())));
    /// ```
    pub fn preset(name: &str) -> Option<Self> {
        let [width, height] = match name {
            "photo-64" => [64, 48],
            "photo-128" => [128, 96],
            "photo-192" => [192, 144],
            "micro" => [40, 28],
            _ => return None,
        };
        let ModelConfig { gaussians, raster, .. } = ModelConfig::preset("medium")?;
        // The last layer of the experts is zero, so that training begins with the photos on the depth of comparison.
        let gaussians = GaussianConfig { sh_degree: 0, expert_gain: 0.0, ..gaussians };
        // Gray where nothing is: nearer to most photos than white.
        let raster = RasterConfig { background: [0.5; 3], ..raster };
        let full = Self {
            width,
            height,
            channels: [16, 32, 48, 80, 128],
            blocks: 2,
            rounds: 2,
            head: 32,
            mlp_ratio: 4,
            features: 32,
            gaussians,
            raster,
        };
        if name != "micro" {
            return Some(full);
        }
        let gaussians = GaussianConfig { router_hidden: 8, projector: 8, neighbors: 4, predictor: 8, ..full.gaussians };
        Some(Self { channels: [4, 8, 8, 8, 16], blocks: 1, rounds: 1, head: 8, features: 8, gaussians, ..full })
    }

    /// Checks that every setting is in its range and that the sizes fit together.
    ///
    /// # Errors
    /// The first setting out of range: its key, the expected value and the value found.
    pub fn check(&self) -> Result<(), String> {
        let sizes = [("width", self.width), ("height", self.height), ("mlp_ratio", self.mlp_ratio)];
        for (key, value) in sizes.into_iter().chain(self.channels.map(|n| ("channels", n))) {
            ensure((1..=MAX_SIZE).contains(&value), key, format_args!("1 to {MAX_SIZE}"), value)?;
        }
        for (key, value) in [("blocks", self.blocks), ("rounds", self.rounds)] {
            ensure(value <= MAX_SIZE, key, format_args!("0 to {MAX_SIZE}"), value)?;
        }
        ensure((3..=MAX_SIZE).contains(&self.features), "features", format_args!("3 to {MAX_SIZE}"), self.features)?;
        multiple("head", self.head, 8)?;
        multiple("channels", self.channels[LEVELS - 1], self.head)?;
        self.gaussians.check()?;
        let relative = self.gaussians.parametrization.parametrization().is_relative();
        ensure(relative, "gaussians.parametrization", "footprint or patch", "published")?;
        self.raster.check()
    }
}
