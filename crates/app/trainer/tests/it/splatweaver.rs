//! SplatWeaver through the trainer, on the micro preset, which takes seconds.

mod allocations;
mod configuration;
mod determinism;
mod experts;
mod masks;
mod mutated;
mod presets;
mod ranges;
mod stages;
mod switch_off;
mod switches;
