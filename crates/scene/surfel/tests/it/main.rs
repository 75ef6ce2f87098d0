//! Integration tests.

mod analytic;
mod gradients;
mod scene;
mod twin;
