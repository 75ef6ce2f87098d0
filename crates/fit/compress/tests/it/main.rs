//! Tests of compression.

mod methods;
mod ops;
mod quality;
mod scenes;
mod schedule;
mod surfaces;
