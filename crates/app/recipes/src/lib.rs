//! How the models of this workspace are trained, and where they are found by name.

mod splatweaver;
mod two_experts;
mod wild;

pub use splatweaver::{
    BudgetForm, EvaluationSettings, Losses, Objective, RouterLosses, SplatWeaverRecipe, StageAllocation, StageSettings,
};
pub use two_experts::{TwoExpertsEvaluation, TwoExpertsLosses, TwoExpertsRecipe, TwoExpertsStage};
pub use wild::{WildEvaluation, WildLosses, WildRecipe, WildStage};

use std::path::Path;
use weaver_inference::{Checkpoint, Network, Predictor, SplatWeaverPredictor};
use weaver_trainer::{CameraMode, DataConfig, Error, OpenRun, Registry, Sources};
use weaver_two_experts::{TwoExperts, TwoExpertsPredictor};
use weaver_wild::{Wild, WildPredictor};

/// The models that the command line knows.
pub fn registry() -> Registry {
    Registry::new().with::<SplatWeaverRecipe>().with::<TwoExpertsRecipe>().with::<WildRecipe>()
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
        planned: checkpoint.step,
        seed: checkpoint.defaults().seed,
        data: DataConfig::default(),
        cameras: CameraMode::Given,
        sources: Sources::default(),
    })
}

/// A file of weights, as if it were a run's: a run's checkpoint, small weights made of one, or a published checkpoint that makes
/// Gaussians.
///
/// # Errors
/// When it cannot be read, is of another model, or makes no Gaussians.
pub fn open_weights(path: &Path) -> Result<OpenRun, Error> {
    if !weaver_inference::is_of_run(path)? {
        return Ok(OpenRun {
            predictor: Box::new(SplatWeaverPredictor::open_published(path)?),
            step: 0,
            planned: 0,
            seed: 0,
            data: DataConfig::default(),
            cameras: CameraMode::Predicted,
            sources: Sources::default(),
        });
    }
    let checkpoint = Checkpoint::read(path)?;
    let predictor: Box<dyn Predictor> = match checkpoint.architecture() {
        TwoExperts::NAME => Box::new(TwoExpertsPredictor::from_checkpoint(&checkpoint)?),
        Wild::NAME => Box::new(WildPredictor::from_checkpoint(&checkpoint)?),
        // Another model's name is an error of its own there.
        _ => Box::new(SplatWeaverPredictor::from_checkpoint(&checkpoint)?),
    };
    Ok(OpenRun {
        predictor,
        step: checkpoint.step,
        planned: checkpoint.step,
        seed: checkpoint.defaults().seed,
        data: DataConfig::default(),
        cameras: CameraMode::Predicted,
        sources: Sources::default(),
    })
}

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
