//! `splatweaver lidar`, `eval-trajectory` and `eval-mesh`: odometry and mapping of lidar scans in a folder, meshes of the maps, and
//! errors of both.
//!
//! | file | content |
//! |---|---|
//! | `run.json` | what was asked for |
//! | `checkpoint.safetensors` | everything needed to go on |
//! | `trajectory.txt` | time, position and quaternion of each scan (TUM); times are the scans' numbers |
//! | `keyframes.toml` | keyframes with their poses, and the edges between consecutive ones |
//! | `map.ply` | the surfels as Gaussians of no thickness |
//! | `summary.json`, `report.html` | the outcome, for programs and for people |
//! | `metrics.jsonl`, `events/` | logged values, also for TensorBoard |
//!
//! Odometry and mapping are weaver-lidar's; here are the run, the files around it and the report.

mod error;
mod evaluation;
mod job;
mod looks;
mod maps;
mod meshing;
mod plan;
mod report;
mod results;
mod run;
mod sources;

pub use error::LidarRunError;
pub use evaluation::{Errors, EvalTrajectory, eval_trajectory, paired_errors};
pub use job::{LidarJob, ScanRecord};
pub use looks::overview;
pub use meshing::{EvalMesh, SurfaceBenchmark, distance_field, eval_mesh, map_mesh};
pub use plan::LidarPlan;
pub use results::Summary;
pub use run::{KIND, Lidar, run};

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
