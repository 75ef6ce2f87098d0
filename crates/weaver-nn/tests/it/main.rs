//! Tests of layers, optimizer, schedules and averages.

mod allocation;
mod layers;
mod messages;
mod rows;
mod training;
