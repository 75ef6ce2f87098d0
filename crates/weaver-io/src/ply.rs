//! PLY files: Gaussians in the form of the reference 3DGS implementation, and plain point clouds.

mod points;
mod splats;
mod table;

pub use points::write_points;
pub use splats::SplatPly;
pub(crate) use splats::check;
pub(crate) use table::Table;
