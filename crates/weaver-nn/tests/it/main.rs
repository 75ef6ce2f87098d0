//! Tests of layers, optimiser, schedules and averages.

mod allocation;
mod layers;
mod messages;
mod training;
