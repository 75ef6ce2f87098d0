//! Tests of layers, optimiser, schedules and averages.

mod layers;
mod training;
