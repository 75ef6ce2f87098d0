//! The weights of a network: a safetensors file or several, mapped into memory and not copied.

use super::header_fault::header_fault;
use crate::Checksum;
use crate::files::json::not_json;
use crate::files::mapped_file::MappedFile;
use crate::{Error, Result};
use ::safetensors::{Dtype, SafeTensors};
use half::{bf16, f16};
use std::collections::BTreeMap;
use std::fmt::{self, Display};
use std::marker::PhantomData;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use zerocopy::{FromBytes, Immutable, KnownLayout};

/// Named tensors in one safetensors file or in the files that an index names.
///
/// Opening reads only the headers; the numbers are mapped into memory and read in place when needed.
///
/// ```
/// use weaver_io::safetensors::{Mapped, Storage, Tensors};
/// let folder = tempfile::tempdir().unwrap();
/// let path = folder.path().join("model.safetensors");
/// let mut tensors = Tensors::default();
/// tensors.insert("head.bias", &[2], vec![1.0f32, 2.0]);
/// tensors.write(&path).unwrap();
///
/// let weights = Mapped::open(&path).unwrap();
/// let Ok(Storage::F32(bias)) = weights.get("head.bias").unwrap().storage() else { panic!() };
/// assert_eq!(bias.as_ref(), [1.0, 2.0]);
/// ```
#[derive(Clone, Debug)]
pub struct Mapped {
    weights: BTreeMap<String, Array>,
    files: Vec<Arc<MappedFile>>,
    metadata: BTreeMap<String, String>,
    path: PathBuf,
    bytes: u64,
}

/// One tensor of [`Mapped`].
#[derive(Clone, Debug)]
pub struct Array {
    name: String,
    dtype: Dtype,
    shape: Vec<usize>,
    file: Arc<MappedFile>,
    range: Range<usize>,
}

/// Numbers in a mapped file, or in memory where the file has them in another form.
pub struct Slice<E> {
    file: Arc<MappedFile>,
    range: Range<usize>,
    kind: PhantomData<fn() -> E>,
}

/// The numbers of a weight, in the type that the file has them in.
#[derive(Debug)]
pub enum Storage {
    /// Single precision, in the file.
    F32(Slice<f32>),
    /// The upper half of single precision, in the file.
    Bf16(Slice<bf16>),
    /// Half precision, in the file.
    F16(Slice<f16>),
    /// Widened in memory, where the file has them unaligned or the machine has another byte order.
    Widened(Vec<f32>),
}

impl<E> fmt::Debug for Slice<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "bytes {:?} of {}", self.range, self.file.path().display())
    }
}

impl<E: FromBytes + Immutable + KnownLayout> AsRef<[E]> for Slice<E> {
    fn as_ref(&self) -> &[E] {
        <[E]>::ref_from_bytes(&self.file[self.range.clone()]).expect("checked when the slice was made")
    }
}

/// The name of a folder's only file of weights, and the name of the index where there are several.
const NAMES: [&str; 2] = ["model.safetensors", "model.safetensors.index.json"];

impl Mapped {
    /// Opens a `.safetensors` file, an index (`.json`) that names several, or a folder with one of them.
    ///
    /// # Errors
    /// When a file cannot be read or is not a complete safetensors file, or an index names tensors that are missing.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let mut path = path.as_ref().to_path_buf();
        if path.is_dir() {
            let found = NAMES.iter().map(|name| path.join(name)).find(|file| file.is_file());
            let missing = || Error::invalid(&path, "folder", NAMES.join(" or "), "neither");
            path = found.ok_or_else(missing)?;
        }
        let (weights, metadata) = Default::default();
        let mut weights = Self { weights, files: Vec::new(), metadata, path: path.clone(), bytes: 0 };
        match path.extension().and_then(|e| e.to_str()) {
            Some("json") => weights.add_index(&path)?,
            Some("pt" | "pth" | "ckpt" | "bin") => {
                let expected = "a .safetensors file; `splatweaver convert-weights` makes one of it";
                return Err(Error::invalid(&path, "file name", expected, "a PyTorch checkpoint"));
            }
            _ => weights.add_file(&path)?,
        }
        Ok(weights)
    }

    fn add_file(&mut self, path: &Path) -> Result<()> {
        let file = Arc::new(MappedFile::open(path)?);
        let invalid = |found: String| Error::invalid(path, "header", "a complete safetensors file", found);
        let (length, header) = SafeTensors::read_metadata(&file).map_err(|e| invalid(header_fault(e)))?;
        let start = length + size_of::<u64>();
        let expected = start + header.data_len();
        if expected != file.len() {
            return Err(invalid(format!("{} bytes where the header tells of {expected}", file.len())));
        }
        for (name, info) in header.tensors() {
            let (from, to) = info.data_offsets;
            let range = start + from..start + to;
            let weight =
                Array { name: name.clone(), dtype: info.dtype, shape: info.shape.clone(), file: file.clone(), range };
            if self.weights.insert(name.clone(), weight).is_some() {
                return Err(Error::invalid(path, format!("tensor {name}"), "one file with it", "a second one"));
            }
        }
        self.metadata.extend(header.metadata().iter().flatten().map(|(k, v)| (k.clone(), v.clone())));
        self.bytes += file.len() as u64;
        self.files.push(file);
        Ok(())
    }

    /// The files of an index, and that they hold its tensors.
    fn add_index(&mut self, path: &Path) -> Result<()> {
        let text = crate::read_text(path)?;
        let json: serde_json::Value = serde_json::from_str(&text)
            .map_err(|e| Error::invalid(path, "index", "JSON", not_json(&e, text.as_bytes())))?;
        let map = json["weight_map"].as_object();
        let map = map.ok_or_else(|| Error::invalid(path, "weight_map", "files by tensor name", "none"))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut files: Vec<&str> = Vec::new();
        for (tensor, file) in map {
            let plain = |name: &&str| Path::new(name).components().count() == 1 && *name != "..";
            let Some(name) = file.as_str().filter(plain) else {
                let place = format!("weight_map, {tensor}");
                return Err(Error::invalid(path, place, "the name of a file beside the index", file));
            };
            if !files.contains(&name) {
                files.push(name);
            }
        }
        for name in files {
            self.add_file(&folder.join(name))?;
        }
        let absent: Vec<&str> = map.keys().map(String::as_str).filter(|t| !self.weights.contains_key(*t)).collect();
        if !absent.is_empty() {
            let expected = "tensors that are in the files";
            return Err(Error::invalid(path, "weight_map", expected, format!("also {}", absent.join(", "))));
        }
        Ok(())
    }

    /// The file, or the index.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes of all files.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Strings of the headers.
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }

    /// The tensor of that name.
    pub fn get(&self, name: &str) -> Option<&Array> {
        self.weights.get(name)
    }

    /// The tensor of that name, which must be there.
    ///
    /// # Errors
    /// When it is not.
    pub fn array(&self, name: &str) -> Result<&Array> {
        self.get(name).ok_or_else(|| {
            let found = format!("none of that name among {}", self.weights.len());
            self.invalid(format!("tensor {name}"), "a tensor", found)
        })
    }

    /// An error that names the file and `place`, for content that the caller does not expect.
    pub fn invalid(&self, place: impl Display, expected: impl Display, found: impl Display) -> Error {
        Error::invalid(&self.path, place, expected, found)
    }

    /// Releases the memory of everything read so far. It stays readable: the system reads it from the files again when
    /// needed.
    pub fn forget(&self) {
        self.files.iter().for_each(|file| file.forget());
    }

    /// The checksum of all files, which are read for it.
    pub fn checksum(&self) -> String {
        let mut sum = Checksum::default();
        self.files.iter().for_each(|file| sum.bytes(file));
        self.forget();
        sum.to_string()
    }

    /// All tensors, by name.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &Array> {
        self.weights.values()
    }
}

impl Array {
    /// Numbers at `range` of a file; as many as the shape says.
    pub(crate) fn new(
        name: String,
        dtype: Dtype,
        shape: Vec<usize>,
        file: Arc<MappedFile>,
        range: Range<usize>,
    ) -> Self {
        Self { name, dtype, shape, file, range }
    }

    /// Its name in the file.
    pub fn name(&self) -> &str {
        &self.name
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

    /// The type's name in safetensors headers.
    pub fn dtype(&self) -> String {
        format!("{:?}", self.dtype)
    }

    /// Bytes in the file.
    pub fn bytes(&self) -> usize {
        self.range.len()
    }

    /// Its numbers.
    ///
    /// # Errors
    /// When they are not floating-point numbers of 16 or 32 bits.
    pub fn storage(&self) -> Result<Storage> {
        let bytes = &self.file[self.range.clone()];
        let little = cfg!(target_endian = "little");
        match self.dtype {
            Dtype::F32 => match self.slice() {
                Some(slice) if little => Ok(Storage::F32(slice)),
                _ => Ok(Storage::Widened(bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect())),
            },
            Dtype::BF16 => match self.slice() {
                Some(slice) if little => Ok(Storage::Bf16(slice)),
                _ => {
                    Ok(Storage::Widened(bytes.as_chunks().0.iter().map(|b| bf16::from_le_bytes(*b).to_f32()).collect()))
                }
            },
            Dtype::F16 => match self.slice() {
                Some(slice) if little => Ok(Storage::F16(slice)),
                _ => {
                    Ok(Storage::Widened(bytes.as_chunks().0.iter().map(|b| f16::from_le_bytes(*b).to_f32()).collect()))
                }
            },
            _ => {
                let place = format!("tensor {}", self.name);
                Err(Error::invalid(self.file.path(), place, "F32, F16 or BF16", self.dtype()))
            }
        }
    }

    /// Its numbers, copied.
    ///
    /// # Errors
    /// When they are not of type F32.
    pub fn f32s(&self) -> Result<Vec<f32>> {
        if self.dtype != Dtype::F32 {
            let place = format!("tensor {}", self.name);
            return Err(Error::invalid(self.file.path(), place, "F32", self.dtype()));
        }
        Ok(self.file[self.range.clone()].as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect())
    }

    /// The numbers in the mapped file, if their alignment allows that.
    fn slice<E: FromBytes + Immutable + KnownLayout>(&self) -> Option<Slice<E>> {
        let slice = Slice { file: self.file.clone(), range: self.range.clone(), kind: PhantomData };
        <[E]>::ref_from_bytes(&self.file[self.range.clone()]).is_ok().then_some(slice)
    }
}

impl Storage {
    /// True if every number is finite: neither NaN nor infinite.
    pub fn is_finite(&self) -> bool {
        // A comparison of bits, which compilers do many at a time.
        let wide = |x: &f32| u32::from(x.to_bits() & 0x7f80_0000 == 0x7f80_0000);
        match self {
            Self::F32(slice) => slice.as_ref().chunks(4096).all(|c| c.iter().map(wide).sum::<u32>() == 0),
            Self::Widened(values) => values.chunks(4096).all(|c| c.iter().map(wide).sum::<u32>() == 0),
            Self::Bf16(slice) => {
                let narrow = |x: &bf16| u32::from(x.to_bits() & 0x7f80 == 0x7f80);
                slice.as_ref().chunks(4096).all(|c| c.iter().map(narrow).sum::<u32>() == 0)
            }
            Self::F16(slice) => {
                let narrow = |x: &f16| u32::from(x.to_bits() & 0x7c00 == 0x7c00);
                slice.as_ref().chunks(4096).all(|c| c.iter().map(narrow).sum::<u32>() == 0)
            }
        }
    }
}
