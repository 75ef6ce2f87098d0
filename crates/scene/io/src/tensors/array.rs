//! Single arrays of numbers, as programs in Python write them.

use super::npy::read_npy;
use super::safetensors::{Array, Mapped};
use crate::{Error, Result};
use std::path::Path;

/// Opens the array in an `.npy` or `.safetensors` file; the numbers are mapped into memory and read in place when
/// needed.
///
/// A safetensors file has it as `features`, or as its only tensor.
///
/// # Errors
/// On any other extension, when the file cannot be read or is not complete, when it is not clear which tensor is meant,
/// and for an NPY file of anything but little-endian `float16` or `float32` in C order.
///
/// ```
/// use weaver_io::{open_array, safetensors::Tensors};
/// let folder = tempfile::tempdir().unwrap();
/// let path = folder.path().join("photo.safetensors");
/// let mut tensors = Tensors::default();
/// tensors.insert("dino", &[1, 2, 2], vec![1.0f32, 2.0, 3.0, 4.0]);
/// tensors.write(&path).unwrap();
/// let array = open_array(&path).unwrap();
/// assert_eq!((array.name(), array.shape()), ("dino", &[1, 2, 2][..]));
/// ```
pub fn open_array(path: impl AsRef<Path>) -> Result<Array> {
    let path = path.as_ref();
    match path.extension().map(|e| e.to_string_lossy().to_lowercase()).as_deref() {
        Some("npy") => read_npy(path),
        Some("safetensors") => {
            let weights = Mapped::open(path)?;
            let only = || weights.iter().next().filter(|_| weights.iter().len() == 1);
            weights.get("features").or_else(only).cloned().ok_or_else(|| {
                let found = format!("{} others", weights.iter().len());
                Error::invalid(path, "tensors", "one of the name `features`, or a single one", found)
            })
        }
        _ => Err(Error::invalid(path, "file name", ".npy or .safetensors", "another")),
    }
}
