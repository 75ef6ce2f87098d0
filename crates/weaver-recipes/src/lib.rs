//! How the models of this workspace are trained, and where they are found by name.

mod splatweaver;

pub use splatweaver::{BudgetForm, Losses, Objective, RouterLosses, SplatWeaverRecipe, StageAllocation, StageSettings};

use weaver_inference::{Checkpoint, SplatWeaverPredictor};
use weaver_trainer::{CameraMode, DataConfig, Error, EvaluationConfig, OpenRun, Registry};

/// The models that the command line knows.
pub fn registry() -> Registry {
    Registry::new().with::<SplatWeaverRecipe>()
}

/// The weights that come with the program, as if they were a run's. They are for cameras that are given or estimated.
///
/// # Errors
/// Never, unless the program is damaged.
///
/// ```
/// let run = weaver_recipes::built_in()?;
/// assert_eq!(run.predictor.image_size(), [48, 64]);
/// # Ok::<(), weaver_trainer::Error>(())
/// ```
pub fn built_in() -> Result<OpenRun, Error> {
    let checkpoint = Checkpoint::built_in()?;
    Ok(OpenRun {
        predictor: Box::new(SplatWeaverPredictor::from_checkpoint(&checkpoint)?),
        step: checkpoint.step,
        seed: checkpoint.defaults().seed,
        data: DataConfig::default(),
        evaluation: EvaluationConfig { cameras: CameraMode::Given, allocation: None, budget: None },
    })
}

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
