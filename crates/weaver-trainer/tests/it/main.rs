//! Tests of the trainer on the micro preset, which takes seconds.

mod determinism;
