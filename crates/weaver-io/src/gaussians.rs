//! Files of Gaussians in any of the supported formats.

use crate::ply::{read_ply, write_ply};
use crate::splat::{read_splat, write_splat};
use crate::spz::{read_spz, write_spz};
use crate::{Error, Result};
use std::path::Path;
use weaver_scene::Gaussians;

/// The formats, by extension.
enum Format {
    Ply,
    Splat,
    Spz,
}

impl Format {
    fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        match extension.as_deref() {
            Some("ply") => Ok(Self::Ply),
            Some("splat") => Ok(Self::Splat),
            Some("spz") => Ok(Self::Spz),
            other => {
                let found = other.map_or("no extension".into(), |e| format!(".{e}"));
                Err(Error::invalid(path, "file name", ".ply, .splat or .spz", found))
            }
        }
    }
}

/// Reads Gaussians from a `.ply`, `.splat` or `.spz` file; the extension selects the format.
///
/// # Errors
/// On any other extension, and as [`read_ply`], [`read_splat`] and [`read_spz`].
pub fn read_gaussians(path: impl AsRef<Path>) -> Result<Gaussians> {
    let path = path.as_ref();
    match Format::of(path)? {
        Format::Ply => read_ply(path),
        Format::Splat => read_splat(path),
        Format::Spz => read_spz(path),
    }
}

/// Writes Gaussians as a `.ply`, `.splat` or `.spz` file; the extension selects the format.
///
/// PLY keeps every bit, the other formats round.
///
/// # Errors
/// On any other extension, and as [`write_ply`], [`write_splat`] and [`write_spz`].
pub fn write_gaussians(path: impl AsRef<Path>, gaussians: &Gaussians) -> Result<()> {
    let path = path.as_ref();
    match Format::of(path)? {
        Format::Ply => write_ply(path, gaussians),
        Format::Splat => write_splat(path, gaussians),
        Format::Spz => write_spz(path, gaussians),
    }
}
