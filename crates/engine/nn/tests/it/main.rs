//! Tests of layers, optimizer, schedules and averages.

mod adamw;
mod allocation;
mod layers;
mod messages;
mod radam;
mod training;
