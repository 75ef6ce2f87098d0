//! SplatWeaver through the trainer, on the micro preset, which takes seconds.

mod allocations;
mod capture;
mod configuration;
mod determinism;
mod experts;
mod masks;
mod mutated;
#[path = "../../../../scene/io/tests/it/mutations.rs"]
mod mutations;
mod perceptual;
mod presets;
mod ranges;
mod stages;
mod switch_off;
mod switches;
mod two_experts;
mod wild;
