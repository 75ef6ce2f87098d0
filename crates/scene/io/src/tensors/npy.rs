//! NumPy's array files.

use crate::files::mapped_file::MappedFile;
use crate::tensors::safetensors::Array;
use crate::{Error, Result, atomic_write};
use ::safetensors::Dtype;
use half::f16;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// First bytes of every such file, before two bytes of the version.
const MAGIC: &[u8] = b"\x93NUMPY";

/// An `.npy` file of numbers in C order, mapped into memory: its shape is read at once, its numbers on demand.
///
/// `float16`, `float32`, `float64`, `uint8` and `bool`. Arrays of Python objects, which are pickled, are refused.
///
/// ```
/// use weaver_io::{Npy, write_npy};
/// let folder = tempfile::tempdir().unwrap();
/// let path = folder.path().join("a.npy");
/// write_npy(&path, &[2, 2], &[1.0, 2.0, 3.0, 4.0])?;
/// let array = Npy::open(&path)?;
/// assert_eq!((array.shape(), array.numbers(2..4)), (&[2, 2][..], vec![3.0, 4.0]));
/// # Ok::<(), weaver_io::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Npy {
    file: Arc<MappedFile>,
    data: Range<usize>,
    dtype: Dtype,
    shape: Vec<usize>,
}

/// Types of numbers by their names in headers, and the bytes that each takes.
const KINDS: [(&str, Dtype, usize); 5] = [
    ("<f4", Dtype::F32, 4),
    ("<f2", Dtype::F16, 2),
    ("<f8", Dtype::F64, 8),
    ("|u1", Dtype::U8, 1),
    ("|b1", Dtype::BOOL, 1),
];

impl Npy {
    /// Opens a file.
    ///
    /// # Errors
    /// When it cannot be read, is not a complete NPY file, or holds other types of numbers or another order.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::of(MappedFile::open(path.as_ref())?)
    }

    /// The array of a file that is in memory.
    pub(crate) fn of(file: MappedFile) -> Result<Self> {
        Self::of_kinds(file, &KINDS, "one of <f2 <f4 <f8 |u1 |b1")
    }

    fn of_kinds(file: MappedFile, kinds: &[(&str, Dtype, usize)], expected: &str) -> Result<Self> {
        let (path, file) = (&file.path().to_path_buf(), Arc::new(file));
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
        let (header, data) =
            header.ok_or_else(|| broken(format!("{} bytes, fewer than its header says", file.len())))?;
        let header = String::from_utf8_lossy(header);
        let value = |key: &str| {
            let (_, after) = header.split_once(&format!("'{key}'"))?;
            Some(after.trim_start().strip_prefix(':')?.trim_start())
        };
        let missing = |key: &str| broken(format!("a header without {key}: {}", header.trim()));
        let descr = value("descr").and_then(|text| text.strip_prefix('\'')?.split_once('\''));
        let descr = descr.ok_or_else(|| missing("descr"))?.0;
        let Some(&(_, dtype, width)) = kinds.iter().find(|(name, ..)| *name == descr) else {
            let pickled = if descr.contains('O') { ", Python objects, which are pickled" } else { "" };
            return Err(invalid("descr", expected, format!("{descr}{pickled}")));
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
        let data = file.len() - data.len()..file.len();
        Ok(Self { file, data, dtype, shape })
    }

    /// Its dimensions.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// Number of its numbers.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// True if it has none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Numbers `range` of it, row-major; `float64` rounded, `bool` as 0 and 1.
    ///
    /// # Panics
    /// When the range ends beyond [`len`](Self::len).
    pub fn numbers(&self, range: Range<usize>) -> Vec<f32> {
        let bytes = self.bytes(range);
        match self.dtype {
            Dtype::F16 => bytes.as_chunks().0.iter().map(|b| f16::from_le_bytes(*b).to_f32()).collect(),
            Dtype::F32 => bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect(),
            Dtype::F64 => bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b) as f32).collect(),
            _ => bytes.iter().map(|b| f32::from(*b)).collect(),
        }
    }

    /// Numbers `range` of it, row-major, none of them rounded.
    ///
    /// # Panics
    /// When the range ends beyond [`len`](Self::len).
    pub fn doubles(&self, range: Range<usize>) -> Vec<f64> {
        match self.dtype {
            Dtype::F64 => self.bytes(range).as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect(),
            _ => self.numbers(range).into_iter().map(f64::from).collect(),
        }
    }

    fn bytes(&self, range: Range<usize>) -> &[u8] {
        let width = self.data.len() / self.len().max(1);
        &self.file[self.data.clone()][range.start * width..range.end * width]
    }
}

/// Opens an `.npy` file of floating-point numbers of 16 or 32 bits; they are mapped into memory and read in place when
/// needed.
///
/// # Errors
/// When the file cannot be read, is not a complete NPY file, or holds anything but little-endian `float16` or `float32`
/// in C order.
pub(crate) fn read_npy(path: &Path) -> Result<Array> {
    let Npy { file, data, dtype, shape } =
        Npy::of_kinds(MappedFile::open(path)?, &KINDS[..2], "<f4 or <f2, as array.astype(numpy.float32) is")?;
    let name = path.file_stem().map_or(String::new(), |stem| stem.to_string_lossy().into_owned());
    Ok(Array::new(name, dtype, shape, file, data))
}

/// Writes numbers as `float32` in C order, atomically.
///
/// # Errors
/// When the file cannot be written.
///
/// # Panics
/// When the shape does not fit the numbers.
pub fn write_npy(path: impl AsRef<Path>, shape: &[usize], numbers: &[f32]) -> Result<()> {
    assert_eq!(shape.iter().product::<usize>(), numbers.len(), "numbers for {shape:?}");
    // A tuple of one element has a comma, too.
    let sides: String = shape.iter().map(|side| format!("{side},")).collect();
    let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({sides}), }}");
    let before = MAGIC.len() + 4;
    // The numbers begin at a multiple of 64 bytes, after a line break.
    let length = (before + header.len() + 1).next_multiple_of(64) - before;
    header.extend(std::iter::repeat_n(' ', length - 1 - header.len()));
    header.push('\n');
    atomic_write(path, |w| {
        w.write_all(MAGIC)?;
        w.write_all(&[1, 0])?;
        w.write_all(&(length as u16).to_le_bytes())?;
        w.write_all(header.as_bytes())?;
        numbers.iter().try_for_each(|x| w.write_all(&x.to_le_bytes()))
    })
}
