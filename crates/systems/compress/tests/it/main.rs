//! Tests of compression.

mod methods;
mod quality;
mod scenes;
mod schedule;
mod surfaces;
