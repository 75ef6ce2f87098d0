//! `splatweaver lidar`, `eval-trajectory` and `eval-mesh`: odometry and mapping of lidar scans in a folder, meshes of
//! the maps, and errors of both.
//!
//! | file | content |
//! |---|---|
//! | `run.json` | the settings |
//! | `checkpoint.safetensors` | everything for resuming |
//! | `trajectory.txt` | time, position and quaternion of each scan (TUM); times are the scans' numbers |
//! | `keyframes.toml` | keyframes with their poses, and the edges between consecutive ones |
//! | `map.ply` | the surfels as Gaussians of no thickness |
//! | `summary.json`, `report.html` | the outcome, for programs and for people |
//! | `metrics.jsonl`, `events/` | logged values, also for TensorBoard |
//!
//! Odometry and mapping are the library's; here are the run, the files around it and the report.
//!
//! ```no_run
//! use clap::Parser;
//! use weaver_command::{Console, Interrupt};
//! use weaver_lidar::command::{Lidar, run};
//!
//! #[derive(Parser)]
//! struct Line {
//!     #[command(flatten)]
//!     lidar: Lidar,
//! }
//!
//! let line = Line::parse_from(["lidar", "scans", "--out", "runs/street"]);
//! let (mut out, mut notes) = (std::io::stdout(), std::io::stderr());
//! let mut console = Console::new(&mut out, &mut notes, false);
//! if let Err(failure) = run(&line.lidar, &mut console, &Interrupt::new()) {
//!     eprintln!("{}", failure.line().unwrap_or_default());
//! }
//! ```

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
pub use meshing::{EvalMesh, SurfaceBenchmark, eval_mesh, map_views};
pub use plan::LidarPlan;
pub use results::Summary;
pub use run::{KIND, Lidar, run};
