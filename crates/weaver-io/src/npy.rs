//! NumPy's array files.

use crate::mapped_file::MappedFile;
use crate::weights::Weight;
use crate::{Error, Result};
use safetensors::Dtype;
use std::path::Path;
use std::sync::Arc;

/// What every such file begins with, before two bytes of the version.
const MAGIC: &[u8] = b"\x93NUMPY";

/// Opens an `.npy` file of floating-point numbers; they are mapped into memory and read in place when needed.
///
/// # Errors
/// When the file cannot be read, is not a complete NPY file, or holds anything but little-endian `float16` or `float32` in C order.
pub(crate) fn read_npy(path: &Path) -> Result<Weight> {
    let file = Arc::new(MappedFile::open(path)?);
    let invalid = |place: &str, expected: &str, found: String| Error::invalid(path, place, expected, found);
    let broken = |found: String| invalid("header", "a complete NPY file", found);
    let Some(([major, _minor], rest)) = file.strip_prefix(MAGIC).and_then(|rest| rest.split_first_chunk()) else {
        return Err(broken(format!("{} bytes that begin with something else", file.len())));
    };
    // The header's length has two bytes in the first version, four in later ones.
    let length = match major {
        1 => rest.split_first_chunk().map(|(length, rest)| (usize::from(u16::from_le_bytes(*length)), rest)),
        2 | 3 => rest.split_first_chunk().map(|(length, rest)| (u32::from_le_bytes(*length) as usize, rest)),
        _ => return Err(invalid("version", "1, 2 or 3", major.to_string())),
    };
    let header = length.and_then(|(length, rest)| rest.split_at_checked(length));
    let (header, data) = header.ok_or_else(|| broken(format!("{} bytes, fewer than its header says", file.len())))?;
    let header = String::from_utf8_lossy(header);
    let value = |key: &str| {
        let (_, after) = header.split_once(&format!("'{key}'"))?;
        Some(after.trim_start().strip_prefix(':')?.trim_start())
    };
    let missing = |key: &str| broken(format!("a header without {key}: {}", header.trim()));
    let kind =
        value("descr").and_then(|text| text.strip_prefix('\'')?.split_once('\'')).ok_or_else(|| missing("descr"))?.0;
    let (dtype, width) = match kind {
        "<f4" => (Dtype::F32, 4),
        "<f2" => (Dtype::F16, 2),
        _ => return Err(invalid("descr", "<f4 or <f2, as array.astype(numpy.float32) is", kind.into())),
    };
    let order = value("fortran_order").ok_or_else(|| missing("fortran_order"))?;
    if !order.starts_with("False") {
        return Err(invalid("fortran_order", "False, as numpy.ascontiguousarray gives", "True".into()));
    }
    let sides =
        value("shape").and_then(|text| text.strip_prefix('(')?.split_once(')')).ok_or_else(|| missing("shape"))?.0;
    let sides = sides.split(',').map(str::trim).filter(|side| !side.is_empty()).map(str::parse);
    let shape = sides.collect::<std::result::Result<Vec<usize>, _>>().map_err(|_| missing("shape"))?;
    let bytes = shape.iter().try_fold(width, |bytes: usize, side| bytes.checked_mul(*side));
    if bytes != Some(data.len()) {
        let found = format!("{} bytes of numbers in a file of shape {shape:?}", data.len());
        return Err(broken(found));
    }
    let range = file.len() - data.len()..file.len();
    let name = path.file_stem().map_or(String::new(), |stem| stem.to_string_lossy().into_owned());
    Ok(Weight::new(name, dtype, shape, file, range))
}
