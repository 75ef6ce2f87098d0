//! Surfaces as Wavefront OBJ, whose material and picture are files beside it.

use super::Surface;
use crate::files::output_folder::refused;
use crate::files::unfinished::UnfinishedFile;
use crate::{Error, Result, atomic_write, read_text};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// The first line of materials that are written here.
const MARK: &str = "# SplatWeaver: the texture of a mesh";

/// The files beside an OBJ: material and picture.
fn beside(path: &Path) -> [PathBuf; 2] {
    ["mtl", "png"].map(|ending| path.with_extension(ending))
}

/// Refuses to replace a material or a picture of others.
pub fn check(path: &Path) -> Result<()> {
    let [material, picture] = beside(path);
    let own = material.is_file() && read_text(&material).is_ok_and(|text| text.starts_with(MARK));
    let expected = format!("no file, or one that came with an earlier {}", path.display());
    match [material, picture].into_iter().find(|file| file.symlink_metadata().is_ok() && !own) {
        Some(file) => Err(refused(&file, expected, "another one")),
        None => Ok(()),
    }
}

pub fn write(path: &Path, surface: &Surface<'_>) -> Result<()> {
    let Some(texture) = surface.texture else { return atomic_write(path, |w| text(w, surface, None)) };
    let [material, picture] = beside(path);
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let png = texture.picture.to_png().map_err(Error::io(&picture))?;
    // All are complete before any has its name: a disk that is full leaves the earlier ones.
    let complete = |path: &Path, write: &dyn Fn(&mut dyn Write) -> io::Result<()>| {
        let written = || {
            let mut file = UnfinishedFile::begin(path)?;
            let mut w = BufWriter::new(file.as_file());
            write(&mut w)?;
            w.flush()?;
            drop(w);
            file.flush()?;
            Ok(file)
        };
        written().map_err(Error::io(path))
    };
    let files = [
        (&*picture, complete(&picture, &|w| w.write_all(&png))?),
        (
            &*material,
            complete(&material, &|w| {
                let picture = name(&picture);
                write!(w, "{MARK}\nnewmtl texture\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {picture}\n")
            })?,
        ),
        (path, complete(path, &|w| text(w, surface, Some(&name(&material))))?),
    ];
    // Without it there is no surface, so that no reader finds a partly replaced one.
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(Error::io(path)(error)),
        _ => {}
    }
    files.into_iter().try_for_each(|(path, file)| file.persist().map_err(Error::io(path)))
}

/// The lines of an OBJ, whose numbers count from 1 and whose pictures begin at the lower left corner.
fn text(w: &mut dyn Write, surface: &Surface<'_>, material: Option<&str>) -> io::Result<()> {
    writeln!(w, "# SplatWeaver")?;
    if let Some(material) = material {
        writeln!(w, "mtllib {material}\nusemtl texture")?;
    }
    for (i, [x, y, z]) in surface.vertices.iter().enumerate() {
        write!(w, "v {x} {y} {z}")?;
        match surface.colors.get(i).filter(|_| material.is_none()) {
            Some(color) => {
                let [r, g, b] = color.map(|c| f32::from(c) / 255.0);
                writeln!(w, " {r:.4} {g:.4} {b:.4}")?;
            }
            None => writeln!(w)?,
        }
    }
    let texture = surface.texture.filter(|_| material.is_some());
    for [u, v] in texture.iter().flat_map(|texture| texture.coordinates) {
        writeln!(w, "vt {u} {}", 1.0 - v)?;
    }
    for (i, corners) in surface.triangles.iter().enumerate() {
        write!(w, "f")?;
        for (k, vertex) in corners.iter().enumerate() {
            match texture {
                Some(texture) => write!(w, " {}/{}", vertex + 1, texture.corners[i][k] + 1)?,
                None => write!(w, " {}", vertex + 1)?,
            }
        }
        writeln!(w)?;
    }
    Ok(())
}
