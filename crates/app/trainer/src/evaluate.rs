//! Evaluation on held-out views, beside two baselines: the nearest context view copied, and the mean color.

mod align;
mod drawn;
mod light;
mod networks;
mod run;

pub use align::Alignment;
pub use light::LookOf;
pub use networks::load_lpips;
pub(crate) use networks::{image_networks, lpips_for};
pub use run::evaluate;

use crate::{CameraMode, LooksConfig};
use weaver_data::Scene;
use weaver_inference::Density;

/// The least side of an image, pixels: the size of the windows of SSIM, which every evaluation measures.
pub(crate) const LEAST_SIDE: usize = 11;

/// The photos that judge, and the cameras that draw them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Targets {
    /// Held-out photos, from the data's cameras.
    #[default]
    Data,
    /// Held-out photos, from cameras that are predicted along with the context's, from these photos themselves; with
    /// predicted cameras only.
    Joint,
    /// Held-out photos, from the data's cameras carried over by the similarity between the context's centers, the
    /// data's and the predicted; as [`Data`](Self::Data) where these do not determine one. With predicted cameras only.
    Centers,
    /// The context photos, from their own cameras: a measure of how well the Gaussians show the photos that they were
    /// made of.
    Context,
}

/// Options of an evaluation.
#[derive(Clone, Debug)]
pub struct Options {
    /// Context views for each held-out view.
    pub context_views: usize,
    /// Source of the cameras.
    pub cameras: CameraMode,
    /// The photos that judge.
    pub targets: Targets,
    /// True if depth is brought to the points that the context views see; with given cameras only.
    pub points: bool,
    /// Estimates the cameras of context views from these photos, in place of other sources; depth is brought to the
    /// estimated points.
    pub matching: Option<Matching>,
    /// Which pixels get Gaussians, and how many; the predictor fills unset fields.
    pub density: Density,
    /// Alignment of held-out views' cameras with their photos, for figures beside the others.
    pub align: Option<Alignment>,
    /// Light and passers-by that photos are given, as the run's were.
    pub planted: Option<LooksConfig>,
    /// The photo in whose light held-out views are drawn, for models with light.
    pub look: Option<LookOf>,
    /// Seed of allocations that draw random numbers.
    pub seed: u64,
    /// Optimizer steps that the weights were trained for.
    pub step: usize,
}

impl Default for Options {
    /// Four context views with given cameras, and nothing out of the ordinary.
    fn default() -> Self {
        Self {
            context_views: 4,
            cameras: CameraMode::Given,
            targets: Targets::Data,
            points: false,
            matching: None,
            density: Density::default(),
            align: None,
            planted: None,
            look: None,
            seed: 0,
            step: 0,
        }
    }
}

/// Inputs that cameras are estimated from.
#[derive(Clone, Debug)]
pub struct Matching {
    /// The same scenes with the same views in the same order, at the size for matching.
    pub scenes: Vec<Scene>,
    /// True if focal lengths are given, as by EXIF.
    pub focal_known: bool,
}
