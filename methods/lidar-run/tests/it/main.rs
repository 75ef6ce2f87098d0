//! Integration tests.

mod commands;
mod meshes;
mod trajectories;
