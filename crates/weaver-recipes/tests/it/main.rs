//! SplatWeaver through the trainer, on the micro preset, which takes seconds.

mod allocations;
mod configuration;
mod determinism;
mod experts;
mod ranges;
mod switch_off;
