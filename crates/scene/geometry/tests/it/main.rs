//! Integration tests.

mod align;
mod distortion;
mod geodesy;
mod lens;
mod lie;
mod poses;
mod sh;
mod strategies;
mod trajectory;
