//! Safetensors files read and written whole.

use super::header_fault::header_fault;
use crate::files::file::read_bytes;
use crate::{Error, Result, atomic_write};
use ::safetensors::{Dtype, SafeTensors};
use half::{bf16, f16};
use serde_json::{Value, json};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// The content of a safetensors file, owned.
///
/// ```
/// use weaver_io::safetensors::Tensors;
/// let folder = tempfile::tempdir().unwrap();
/// let path = folder.path().join("a.safetensors");
/// let mut tensors = Tensors::default();
/// tensors.metadata.insert("step".into(), "7".into());
/// tensors.insert("weight", &[2, 1], vec![1.0f32, 2.0]);
/// tensors.write(&path).unwrap();
///
/// let tensors = Tensors::read(&path).unwrap();
/// assert_eq!(tensors.values::<f32>("weight", &[2, 1]).unwrap(), [1.0, 2.0]);
/// assert!(tensors.values::<f32>("weight", &[2, 2]).is_err());
/// ```
#[derive(Clone, Debug, Default)]
pub struct Tensors {
    /// Free-form strings of the header.
    pub metadata: BTreeMap<String, String>,
    /// The tensors by name.
    pub tensors: BTreeMap<String, Tensor>,
    /// The file they were read from, for messages.
    origin: PathBuf,
}

/// An array of numbers, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Length of each dimension; their product is the number of values.
    pub shape: Vec<usize>,
    /// The values.
    pub data: TensorData,
}

/// A type of number that tensors may hold.
pub trait Element: Copy + 'static {
    /// The values, if they are of this type.
    fn slice(data: &TensorData) -> Option<&[Self]>;
    /// The values as data of this type.
    fn wrap(values: Vec<Self>) -> TensorData;
    /// The type's name in safetensors headers.
    const NAME: &'static str;
}

macro_rules! elements {
    ($($name:ident $t:ty),*) => {
        /// The values of a tensor, in the type the file has.
        #[derive(Clone, Debug, PartialEq)]
        pub enum TensorData {
            $(#[doc = concat!("Values of type `", stringify!($t), "`.")] $name(Vec<$t>),)*
        }

        impl TensorData {
            /// Number of values.
            pub fn len(&self) -> usize {
                match self { $(Self::$name(values) => values.len(),)* }
            }

            /// The type's name in safetensors headers.
            pub fn dtype(&self) -> &'static str {
                match self { $(Self::$name(_) => stringify!($name),)* }
            }

            /// Bytes for each value.
            fn width(&self) -> usize {
                match self { $(Self::$name(_) => size_of::<$t>(),)* }
            }

            fn write(&self, w: &mut dyn Write) -> io::Result<()> {
                match self {
                    $(Self::$name(values) => values.iter().try_for_each(|x| w.write_all(&x.to_le_bytes())),)*
                }
            }

            fn decode(dtype: Dtype, bytes: &[u8]) -> Option<Self> {
                match dtype {
                    $(Dtype::$name => {
                        let (chunks, _) = bytes.as_chunks();
                        Some(Self::$name(chunks.iter().map(|c| <$t>::from_le_bytes(*c)).collect()))
                    })*
                    _ => None,
                }
            }
        }

        $(impl Element for $t {
            const NAME: &'static str = stringify!($name);

            fn slice(data: &TensorData) -> Option<&[Self]> {
                match data {
                    TensorData::$name(values) => Some(values),
                    _ => None,
                }
            }

            fn wrap(values: Vec<Self>) -> TensorData {
                TensorData::$name(values)
            }
        })*
    };
}

elements!(F32 f32, F64 f64, F16 f16, BF16 bf16, U64 u64, I64 i64, U32 u32, I32 i32, U8 u8);

impl TensorData {
    /// True if there are no values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The values of an F32, F16 or BF16 tensor as f32, without loss; `None` for other types.
    pub fn widened(&self) -> Option<Cow<'_, [f32]>> {
        match self {
            Self::F32(values) => Some(Cow::Borrowed(values)),
            Self::F16(values) => Some(values.iter().map(|x| x.to_f32()).collect()),
            Self::BF16(values) => Some(values.iter().map(|x| x.to_f32()).collect()),
            _ => None,
        }
    }
}

impl Tensors {
    /// Reads a whole file.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        Self::from_bytes(&read_bytes(path.as_ref())?, path.as_ref())
    }

    /// The content of a safetensors file in memory; messages call it `origin`.
    ///
    /// # Errors
    /// As [`Tensors::read`].
    pub fn from_bytes(bytes: &[u8], origin: impl AsRef<Path>) -> Result<Self> {
        let path = origin.as_ref();
        let invalid = |e| Error::invalid(path, "header", "a complete safetensors file", header_fault(e));
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(invalid)?;
        let file = SafeTensors::deserialize(bytes).map_err(invalid)?;
        let mut tensors = BTreeMap::new();
        for (key, view) in file.iter() {
            let data = TensorData::decode(view.dtype(), view.data()).ok_or_else(|| {
                let expected = "one of F32 F64 F16 BF16 U64 I64 U32 I32 U8";
                Error::invalid(path, format!("tensor {key}"), expected, format!("{:?}", view.dtype()))
            })?;
            tensors.insert(key.to_string(), Tensor { shape: view.shape().to_vec(), data });
        }
        let metadata = header.metadata().iter().flatten().map(|(k, v)| (k.clone(), v.clone())).collect();
        Ok(Self { metadata, tensors, origin: path.to_path_buf() })
    }

    /// Writes a file; equal content gives equal bytes.
    ///
    /// # Errors
    /// When a shape does not fit its values or the file cannot be written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        for (key, tensor) in &self.tensors {
            if key == METADATA {
                return Err(Error::invalid(path, format!("tensor {key}"), "another name", "the reserved one"));
            }
            let len = tensor.data.len();
            if tensor.shape.iter().try_fold(1, |n: usize, &d| n.checked_mul(d)) != Some(len) {
                let expected = format!("values for {:?}", tensor.shape);
                return Err(Error::invalid(path, format!("tensor {key}"), expected, len));
            }
        }
        // Wide types first, so that every tensor is aligned in the file; by name within a type.
        let mut order: Vec<(&String, &Tensor)> = self.tensors.iter().collect();
        order.sort_by_key(|(_, tensor)| std::cmp::Reverse(tensor.data.width()));

        let mut header: BTreeMap<&str, Value> = BTreeMap::new();
        if !self.metadata.is_empty() {
            header.insert(METADATA, json!(self.metadata));
        }
        let mut offset = 0;
        for (key, tensor) in &order {
            let end = offset + tensor.data.len() * tensor.data.width();
            let entry = json!({
                "data_offsets": [offset, end],
                "dtype": tensor.data.dtype(),
                "shape": tensor.shape,
            });
            header.insert(key, entry);
            offset = end;
        }
        atomic_write(path, |w| {
            let mut header = serde_json::to_vec(&header)?;
            header.resize(header.len().next_multiple_of(8), b' ');
            w.write_all(&(header.len() as u64).to_le_bytes())?;
            w.write_all(&header)?;
            order.iter().try_for_each(|(_, tensor)| tensor.data.write(w))
        })
    }

    /// The file that the tensors were read from; empty if they were made here.
    pub fn origin(&self) -> &Path {
        &self.origin
    }

    /// Adds a tensor, or replaces an earlier one under its name.
    ///
    /// # Panics
    /// When the shape does not fit the values.
    pub fn insert<E: Element>(&mut self, key: impl Into<String>, shape: &[usize], values: Vec<E>) {
        assert_eq!(shape.iter().product::<usize>(), values.len(), "values for {shape:?}");
        let tensor = Tensor { shape: shape.to_vec(), data: E::wrap(values) };
        self.tensors.insert(key.into(), tensor);
    }

    /// The tensor of that name, of any shape.
    pub fn get(&self, key: &str) -> Result<&Tensor> {
        self.tensors.get(key).ok_or_else(|| {
            let found = format!("none of that name among {}", self.tensors.len());
            self.invalid(key, "a tensor", found)
        })
    }

    /// The values of a tensor of that name, shape and type.
    pub fn values<E: Element>(&self, key: &str, shape: &[usize]) -> Result<&[E]> {
        let tensor = self.shaped(key, shape)?;
        E::slice(&tensor.data).ok_or_else(|| self.invalid(key, E::NAME, tensor.data.dtype()))
    }

    /// The values of an F32, F16 or BF16 tensor of that name and shape, as f32.
    pub fn widened(&self, key: &str, shape: &[usize]) -> Result<Cow<'_, [f32]>> {
        let tensor = self.shaped(key, shape)?;
        tensor.data.widened().ok_or_else(|| self.invalid(key, "F32, F16 or BF16", tensor.data.dtype()))
    }

    fn shaped(&self, key: &str, shape: &[usize]) -> Result<&Tensor> {
        let tensor = self.get(key)?;
        if tensor.shape != shape {
            return Err(self.invalid(key, format!("{shape:?}"), format!("{:?}", tensor.shape)));
        }
        Ok(tensor)
    }

    fn invalid(&self, key: &str, expected: impl std::fmt::Display, found: impl std::fmt::Display) -> Error {
        let made_here = self.origin.as_os_str().is_empty();
        let path = if made_here { Path::new("tensors in memory") } else { &self.origin };
        Error::invalid(path, format!("tensor {key}"), expected, found)
    }
}

/// The header's entry for free-form strings.
const METADATA: &str = "__metadata__";
