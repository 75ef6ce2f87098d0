//! Drawing on the tape.

mod covariance;
mod primitives;
mod rasterize;
mod shelf;
mod statistics;

pub use covariance::covariance;
pub use primitives::{PixelSums, Primitive, RasterizePrimitives, TilesPool};
pub use rasterize::{GaussianVars, Rasterize, RenderedVars, WorkspacePool};
pub use statistics::SharedStatistics;
