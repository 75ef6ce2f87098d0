//! Descriptions of files.

use crate::command::read::failure;
use crate::{Coded, decode};
use std::path::Path;
use weaver_command::Failure;

/// Describes a .wgi file in a line.
///
/// # Errors
/// When it cannot be read or is no .wgi file.
pub fn info(path: &Path) -> Result<String, Failure> {
    let bytes = weaver_io::read_bytes(path)?;
    let Coded { width, height, fitted } = decode(&bytes).map_err(|error| failure(path, &error))?;
    let (count, length) = (fitted.gaussians.len(), bytes.len());
    let bits = 8.0 * length as f64 / (width * height) as f64;
    Ok(format!("picture of {width}x{height} pixels, {count} Gaussians, {length} bytes, {bits:.3} bits a pixel"))
}
