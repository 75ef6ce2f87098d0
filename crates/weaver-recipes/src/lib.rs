//! How the models of this workspace are trained, and where they are found by name.

mod splatweaver;

pub use splatweaver::{BudgetForm, Losses, Objective, RouterLosses, SplatWeaverRecipe, StageAllocation, StageSettings};

use weaver_trainer::Registry;

/// The models that the command line knows.
pub fn registry() -> Registry {
    Registry::new().with::<SplatWeaverRecipe>()
}

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
