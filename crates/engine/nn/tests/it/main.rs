//! Tests of layers, optimizer, schedules and averages.

mod allocation;
mod layers;
mod messages;
mod radam;
mod rows;
mod training;
