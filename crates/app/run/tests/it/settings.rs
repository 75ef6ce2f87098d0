//! Tests of settings in layers.

mod layers;
mod ranges;
mod reference;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// One of everything that settings may hold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Settings {
    /// Seed of the random numbers.
    seed: u64,
    /// Learning rate.
    #[schemars(extend("exclusiveMinimum" = 0))]
    rate: f64,
    /// Where results go.
    folder: PathBuf,
    /// Color behind the scene.
    #[schemars(inner(range(min = 0.0, max = 1.0)))]
    background: [f64; 3],
    /// Seconds after which to stop.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0))]
    limit: Option<f64>,
    /// Which cameras are used.
    cameras: Cameras,
    /// Strategy of adding Gaussians.
    strategy: Strategy,
    /// The stages, one after the other.
    stages: Vec<Stage>,
}

/// Source of the cameras.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum Cameras {
    /// Those of the data.
    Given,
    /// Those that are found.
    Found,
}

/// Strategy of adding Gaussians.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
enum Strategy {
    /// Where the gradient is large.
    Split {
        /// Steps between looks.
        every: usize,
        /// From which gradient on.
        #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 1))]
        threshold: f64,
    },
    /// By moving dead ones.
    Relocate {
        /// Steps between looks.
        every: usize,
        /// The most there may be.
        #[serde(default)]
        cap: usize,
    },
}

/// A part of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Stage {
    /// Its name in logs.
    name: String,
    /// Optimizer steps.
    #[schemars(range(min = 1, max = 1000))]
    steps: usize,
}

fn defaults() -> Settings {
    let stage = |name: &str, steps| Stage { name: name.into(), steps };
    Settings {
        seed: 0,
        rate: 0.5,
        folder: "runs/a".into(),
        background: [1.0; 3],
        limit: None,
        cameras: Cameras::Given,
        strategy: Strategy::Split { every: 100, threshold: 2e-4 },
        stages: vec![stage("coarse", 10), stage("fine", 20)],
    }
}
