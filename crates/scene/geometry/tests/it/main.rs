//! Integration tests.

mod align;
mod distortion;
mod geodesy;
mod lie;
mod poses;
mod sh;
mod strategies;
mod trajectory;
