//! Features for the Gaussians of a finished scene, such that drawing them gives the features of photos.
//!
//! Geometry is frozen, so that drawing is linear in the features, and finding them is linear algebra: no training.
//!
//! - [`lift`] finds them, by one of four [`Solver`]s, from [`Observations`] through an [`Operator`]: the rasterizer
//!   ([`Raster`]) or a matrix ([`Dense`]). [`guide`] makes opacities more decided before.
//! - [`cluster()`] and [`aggregate`] clean features that come from masks: [`Pca`], [`hdbscan`], one feature per
//!   cluster.
//! - [`scores`] compares features with prompts; drawing the scores answers a query.
//! - [`metrics`] judges labels of Gaussians and of pixels.
//!
//! Same bits at any number of threads.

mod aggregate;
mod cluster;
#[cfg(feature = "command")]
pub mod command;
mod dense;
mod error;
mod guidance;
mod hdbscan;
mod lift;
pub mod metrics;
mod observations;
mod operator;
mod passes;
mod pca;
mod query;
mod raster;
mod rows;
mod solver;
mod statistics;

pub use aggregate::{AggregateOptions, Aggregation, Mask, aggregate, label_maps};
pub use cluster::{ClusterOptions, cluster};
pub use dense::Dense;
pub use error::LiftError;
pub use guidance::guide;
pub use hdbscan::{HdbscanOptions, hdbscan};
pub use lift::{LiftOptions, Lifted, lift, to_unit_length};
pub use observations::{Maps, Observations};
pub use operator::Operator;
pub use pca::Pca;
pub use query::scores;
pub use raster::Raster;
pub use solver::{Descent, Solver, Stop};
pub use statistics::Coverage;

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
