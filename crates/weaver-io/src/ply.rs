//! PLY files: Gaussians in the form of the reference 3DGS implementation, and plain point clouds.

mod gaussians;
mod points;
mod table;

pub use gaussians::{read_ply, write_ply};
pub use points::{read_points, write_points};
pub(crate) use table::Table;
