//! Cameras that descend through a finished scene.

mod cloud;
mod oracles;
mod planted;
mod refusals;
