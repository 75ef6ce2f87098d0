//! Safetensors files read one tensor at a time.

use crate::{Error, Result};
use safetensors::Dtype;
use safetensors::tensor::Metadata;
use std::fmt::Display;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Longest header that is read; the format allows no longer one.
const LONGEST_HEADER: u64 = 100_000_000;
/// Values that are decoded at a time.
const CHUNK: usize = 1 << 14;

/// An open safetensors file, whose tensors are read when asked for.
///
/// Only the header is kept in memory. [`Tensors`](crate::checkpoint::Tensors) reads a whole file at once, of any type.
///
/// ```
/// use weaver_io::{TensorFile, checkpoint::Tensors};
/// let folder = tempfile::tempdir().unwrap();
/// let path = folder.path().join("a.safetensors");
/// let mut tensors = Tensors::default();
/// tensors.insert("weight", &[2, 1], vec![1.0f32, 2.0]);
/// tensors.write(&path).unwrap();
///
/// let mut file = TensorFile::open(&path).unwrap();
/// assert_eq!(file.shape("weight").unwrap(), [2, 1]);
/// assert_eq!(file.f32s("weight").unwrap(), [1.0, 2.0]);
/// ```
#[derive(Debug)]
pub struct TensorFile {
    path: PathBuf,
    file: File,
    header: Metadata,
    /// Bytes before the first tensor.
    start: u64,
}

impl TensorFile {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// When the file cannot be read, is not a safetensors file, or its length differs from what its header says.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let mut file = File::open(path).map_err(Error::io(path))?;
        let length = file.metadata().map_err(Error::io(path))?.len();
        let invalid = |found: String| Error::invalid(path, "header", "a complete safetensors file", found);
        let mut size = [0; 8];
        file.read_exact(&mut size).map_err(|e| match e.kind() {
            io::ErrorKind::UnexpectedEof => invalid(format!("{length} bytes")),
            _ => Error::io(path)(e),
        })?;
        let size = u64::from_le_bytes(size);
        if size > LONGEST_HEADER || size > length.saturating_sub(8) {
            return Err(invalid(format!("a header of {size} bytes in a file of {length}")));
        }
        let mut header = vec![0; size as usize];
        file.read_exact(&mut header).map_err(Error::io(path))?;
        let header: Metadata = serde_json::from_slice(&header).map_err(|e| invalid(e.to_string()))?;
        let (start, tensors) = (8 + size, header.data_len() as u64);
        if start.checked_add(tensors) != Some(length) {
            return Err(invalid(format!("{} bytes of tensors, {tensors} according to the header", length - start)));
        }
        Ok(Self { path: path.to_path_buf(), file, header, start })
    }

    /// A string of the header.
    pub fn metadata(&self, key: &str) -> Option<&str> {
        self.header.metadata().as_ref()?.get(key).map(String::as_str)
    }

    /// Whether there is a tensor of that name.
    pub fn contains(&self, key: &str) -> bool {
        self.header.info(key).is_some()
    }

    /// The shape of the tensor of that name.
    ///
    /// # Errors
    /// When there is none.
    pub fn shape(&self, key: &str) -> Result<&[usize]> {
        match self.header.info(key) {
            Some(info) => Ok(&info.shape),
            None => {
                let found = format!("none of that name among {}", self.header.offset_keys().len());
                Err(self.invalid(format!("tensor {key}"), "a tensor", found))
            }
        }
    }

    /// The values of the F32 tensor of that name.
    ///
    /// # Errors
    /// When there is none, it is of another type, or the file cannot be read.
    pub fn f32s(&mut self, key: &str) -> Result<Vec<f32>> {
        self.shape(key)?;
        let info = self.header.info(key).expect("it has a shape");
        if info.dtype != Dtype::F32 {
            return Err(self.invalid(format!("tensor {key}"), "F32", format!("{:?}", info.dtype)));
        }
        let (begin, end) = info.data_offsets;
        let mut values = vec![0.0; (end - begin) / size_of::<f32>()];
        self.file.seek(SeekFrom::Start(self.start + begin as u64)).map_err(Error::io(&self.path))?;
        let mut bytes = vec![0; CHUNK.min(values.len()) * size_of::<f32>()];
        for values in values.chunks_mut(CHUNK) {
            let bytes = &mut bytes[..size_of_val(values)];
            self.file.read_exact(bytes).map_err(Error::io(&self.path))?;
            for (value, bytes) in values.iter_mut().zip(bytes.as_chunks().0) {
                *value = f32::from_le_bytes(*bytes);
            }
        }
        Ok(values)
    }

    /// An error that names the file and `place`, for content that is not what the caller expects.
    pub fn invalid(&self, place: impl Display, expected: impl Display, found: impl Display) -> Error {
        Error::invalid(&self.path, place, expected, found)
    }
}
