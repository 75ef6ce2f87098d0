//! SplatWeaver through the trainer, on the micro preset, which takes seconds.

mod allocations;
mod configuration;
mod determinism;
mod mutated;
#[path = "../../../weaver-io/tests/it/mutations.rs"]
mod mutations;
mod presets;
mod switch_off;
mod switches;
