//! Tests of the trainer on the micro preset, which takes seconds.

mod allocations;
mod determinism;
mod switch_off;
