//! Surfaces of triangles.

use super::table::{Table, faces};
use crate::files::file::read_bytes;
use crate::{Error, Result, atomic_write};
use std::path::Path;

/// Vertices and triangles.
pub type Triangles = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// Writes a surface as a binary little-endian PLY file; `colors` are the vertices', or none.
///
/// # Errors
/// When the file cannot be written.
///
/// # Panics
/// When there are colors, and not one for each vertex.
pub fn write_triangles(
    path: impl AsRef<Path>,
    vertices: &[[f32; 3]],
    colors: &[[u8; 3]],
    triangles: &[[u32; 3]],
) -> Result<()> {
    assert!(colors.is_empty() || colors.len() == vertices.len(), "a color for each vertex, or none");
    atomic_write(path, |w| {
        writeln!(w, "ply\nformat binary_little_endian 1.0\nelement vertex {}", vertices.len())?;
        for name in ["x", "y", "z"] {
            writeln!(w, "property float {name}")?;
        }
        for name in ["red", "green", "blue"].iter().filter(|_| !colors.is_empty()) {
            writeln!(w, "property uchar {name}")?;
        }
        let faces = triangles.len();
        writeln!(w, "element face {faces}\nproperty list uchar int vertex_indices\nend_header")?;
        for (i, vertex) in vertices.iter().enumerate() {
            vertex.iter().try_for_each(|x| w.write_all(&x.to_le_bytes()))?;
            w.write_all(colors.get(i).map_or(&[], |color| &color[..]))?;
        }
        triangles.iter().try_for_each(|corners| {
            w.write_all(&[3])?;
            corners.iter().try_for_each(|i| w.write_all(&i.to_le_bytes()))
        })
    })
}

/// Reads a surface from a PLY file, ASCII or binary little-endian; faces with more corners are cut into triangles.
///
/// # Errors
/// When it cannot be read, is malformed, or faces have corners that are no vertices.
pub fn read_triangles(path: impl AsRef<Path>) -> Result<Triangles> {
    let path = path.as_ref();
    let data = read_bytes(path)?;
    let table = Table::read(path, &data)?;
    let [x, y, z] = [table.column("x")?, table.column("y")?, table.column("z")?];
    let vertices: Vec<[f32; 3]> = (0..table.rows).map(|row| [x, y, z].map(|c| table.row(row)[c])).collect();
    let mut triangles = Vec::new();
    for (number, face) in faces(path, &data)?.iter().enumerate() {
        if let Some(corner) = face.iter().find(|i| **i as usize >= vertices.len()) {
            let expected = format!("corners below {}", vertices.len());
            return Err(Error::invalid(path, format!("face {number}"), expected, corner));
        }
        triangles.extend((2..face.len()).map(|i| [face[0], face[i - 1], face[i]]));
    }
    Ok((vertices, triangles))
}
