//! Meshes from range images of any camera, simplified and painted, and how far a mesh is from a surface; without files.
//!
//! - [`DrawnScene`] has the range images that cameras see of a scene of Gaussians.
//! - A [`DistanceField`] averages truncated signed distances of range images in blocks of 8 x 8 x 8 cells near
//!   surfaces.
//! - [`DistanceField::mesh`] is its zero level by surface nets: one vertex in each cell that the surface crosses.
//! - [`DistanceField::closed`] fills space that nothing saw, so that the surface is closed, and [`Mesh::manifold`]
//!   gives every edge at most two triangles.
//! - [`Mesh::simplified`] has fewer triangles, [`Texture::paint`] a picture from photos.
//! - [`compare`] has accuracy, completeness, Chamfer distance and F-score of a mesh and a cloud.
//! - [`mesh_chamfer`] and [`point_chamfer`] are the distances of benchmarks such as DTU.

mod benchmark;
mod blocks;
mod closing;
mod comparison;
mod field;
mod manifold;
mod mesh;
mod nets;
mod pieces;
mod scale;
mod scene;
mod simplification;
mod texture;

pub use benchmark::{Benchmark, Chamfer, mesh_chamfer, point_chamfer, spread};
pub use comparison::{FAR, MeshErrors, compare, thinned};
pub use field::{DistanceField, FieldProgress, MeshError, RangeView};
pub use mesh::Mesh;
pub use scale::SceneScale;
pub use scene::DrawnScene;
pub use texture::{PhotoView, Texture};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
