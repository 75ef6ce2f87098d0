//! Where scenes come from, and which views make a tuple.

use super::{MOST, MOST_VIEWS};
use crate::{Augmentation, LooksConfig};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use weaver_data::Sampler;
use weaver_kernels::random::Stream;

/// Where scenes come from, and which views make a tuple.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DataConfig {
    /// Folders of captures; empty trains on the built-in procedural scenes.
    pub folders: Vec<PathBuf>,
    /// Procedural scenes only: train on varied scenes without end in place of the fixed default set. Sixteen are kept;
    /// every so many steps a fresh one takes the place of the oldest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = MOST))]
    pub endless: Option<usize>,
    /// Captures without points: the mean distance from camera 0 to what the cameras see, in the capture's units.
    /// Without it, such a capture is an error where its scale is needed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub scene_scale: Option<f64>,
    /// For folders of photos without cameras: a published checkpoint, VGGT's or SplatWeaver's, from which they get
    /// cameras and depth. Its predictions are kept beside the photos, in teacher.safetensors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub teacher: Option<PathBuf>,
    /// Captures only: leaves out what is black in masks (`mask_path` of transforms.json, a file in `masks/` named as
    /// the photo, or its alpha): no loss counts it, and it gets no Gaussians.
    #[serde(default)]
    pub masks: bool,
    /// Context views of a tuple: the photos that the network sees.
    #[schemars(range(min = 2, max = MOST_VIEWS))]
    pub context_views: usize,
    /// Target views of a tuple: rendered and compared, not seen.
    #[schemars(range(min = 1, max = MOST_VIEWS))]
    pub target_views: usize,
    /// With this, each step draws how many context views its tuples have, from `context_views` to so many, all equally
    /// likely.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 2, max = MOST_VIEWS))]
    pub most_context_views: Option<usize>,
    /// Which training views make a tuple.
    #[serde(default)]
    pub sampler: SamplerKind,
    /// Number of its nearest training views that a view's context is drawn from, by the sampler `nearest`.
    #[schemars(range(min = 2, max = MOST))]
    pub pool: usize,
    /// Variation of tuples from the photos.
    #[serde(default)]
    pub augmentation: Augmentation,
    /// Light and passers-by that photos are given; none leaves photos as they were taken.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub looks: Option<LooksConfig>,
}

/// Which training views make a tuple.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SamplerKind {
    /// Some of the views nearest to a random one, in random order.
    #[default]
    Nearest,
    /// As published for videos: two views whose distance in the order of paths is bounded, and random ones between
    /// them.
    BoundedGap,
    /// Context views evenly spread over all, in the order of paths; targets are others.
    Uniform,
}

impl DataConfig {
    /// Sampler of tuples.
    pub fn sampler(&self) -> Sampler {
        match self.sampler {
            SamplerKind::Nearest => Sampler::Nearest { pool: self.pool },
            SamplerKind::BoundedGap => Sampler::BoundedGap,
            SamplerKind::Uniform => Sampler::Uniform,
        }
    }

    /// The most context views that a tuple may have.
    pub fn most_context(&self) -> usize {
        self.most_context_views.unwrap_or(self.context_views)
    }

    /// Number of context views in the tuples of a step.
    pub(crate) fn context_of(&self, seed: u64, step: usize) -> usize {
        let more = self.most_context() - self.context_views;
        self.context_views + Stream::new(seed, step as u64, "views").below(0, more + 1)
    }
}

impl Default for DataConfig {
    fn default() -> Self {
        Self {
            folders: Vec::new(),
            endless: None,
            scene_scale: None,
            teacher: None,
            masks: false,
            context_views: 4,
            target_views: 2,
            most_context_views: None,
            sampler: SamplerKind::Nearest,
            pool: 6,
            augmentation: Augmentation::default(),
            looks: None,
        }
    }
}
