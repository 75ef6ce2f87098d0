//! SplatWeaver through the trainer, on the micro preset, which takes seconds.

mod allocations;
mod configuration;
mod determinism;
mod presets;
mod switch_off;
mod switches;
