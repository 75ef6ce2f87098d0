//! Integration tests.

mod commands;
mod meshes;
