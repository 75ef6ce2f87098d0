//! Tests of compression.

mod quality;
mod scenes;
