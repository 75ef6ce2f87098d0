//! PLY files: Gaussians in the form of the reference 3DGS implementation or compressed, and plain point clouds.

mod compressed;
mod gaussians;
mod header;
mod points;
mod table;
mod triangles;

pub(crate) use compressed::encode as encode_compressed;
pub(crate) use gaussians::{encode, is_scene, open};
pub use points::{read_points, write_points};
pub(crate) use table::Table;
pub use triangles::{Triangles, read_triangles, write_triangles};
