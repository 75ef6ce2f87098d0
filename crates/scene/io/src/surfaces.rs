//! Surfaces of triangles with colors or a texture: `.ply`, `.glb` and `.obj`, by the ending of the name.

mod glb;
mod obj;

use crate::ply::write_triangles;
use crate::{Bitmap, Error, Result};
use std::path::Path;

/// Endings of files of surfaces.
pub const SURFACE_FORMATS: &[&str] = &["ply", "glb", "obj"];

/// A surface to be written.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    /// Vertices `[N]`.
    pub vertices: &'a [[f32; 3]],
    /// Corners of triangles, counterclockwise from outside, `[M]`.
    pub triangles: &'a [[u32; 3]],
    /// Colors of the vertices, sRGB, `[N]` or none.
    pub colors: &'a [[u8; 3]],
    /// A picture on it.
    pub texture: Option<SurfaceTexture<'a>>,
}

/// A picture on a surface.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceTexture<'a> {
    /// Places on the picture from its upper left corner, in its sides, `[K]`.
    pub coordinates: &'a [[f32; 2]],
    /// The vertex of each place, `[K]`.
    pub vertices: &'a [u32],
    /// The places of the corners of each triangle, `[M]`.
    pub corners: &'a [[u32; 3]],
    /// The picture.
    pub picture: &'a Bitmap,
}

impl Surface<'_> {
    /// Writes the surface in the format of the name's ending, atomically.
    ///
    /// `.ply` has vertices with colors and takes no texture. `.glb` is glTF 2.0 with a JPEG of the texture inside, or
    /// linear colors of vertices; its up is +y, so that x and y are negated, as in files of Gaussians. `.obj` has
    /// colors behind the coordinates of vertices, or names a material `.mtl` and its picture `.png`, which are written
    /// beside it under the same name.
    ///
    /// # Errors
    /// When a file cannot be written, as [`check`](Self::check), for a texture without pixels, and for one in a PLY.
    ///
    /// # Panics
    /// When there are colors, and not one for each vertex.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        assert!(self.colors.is_empty() || self.colors.len() == self.vertices.len(), "a color for each vertex, or none");
        Self::check(path, self.texture.is_some())?;
        match ending(path).as_str() {
            "glb" => glb::write(path, self),
            "obj" => obj::write(path, self),
            _ => write_triangles(path, self.vertices, self.colors, self.triangles),
        }
    }

    /// Checks before long work that a surface can be written under this name.
    ///
    /// # Errors
    /// When a format of this ending is unknown or takes no texture, and when a file would be replaced beside an `.obj`
    /// that is not its own.
    pub fn check(path: impl AsRef<Path>, textured: bool) -> Result<()> {
        let path = path.as_ref();
        match (ending(path).as_str(), textured) {
            ("ply", true) => Err(Error::invalid(path, "texture", "a name that ends with .glb or .obj", ".ply")),
            ("obj", true) => obj::check(path),
            (known, _) if SURFACE_FORMATS.contains(&known) => Ok(()),
            (other, _) => Err(Error::invalid(path, "ending", "ply, glb or obj", other)),
        }
    }
}

/// The ending of a name, in lower case.
fn ending(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}
