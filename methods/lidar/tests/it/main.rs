//! Integration tests.

#[cfg(feature = "command")]
mod commands;
mod hall;
#[cfg(feature = "command")]
mod meshes;
mod real_scans;
mod registration;
mod track;
#[cfg(feature = "command")]
mod trajectories;
