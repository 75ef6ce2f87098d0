//! PyTorch checkpoints: ZIP archives of a pickled description and raw numbers.

mod pickle;

use crate::tensors::safetensors::Planned;
use crate::{Error, Result, available_memory};
use pickle::{Machine, Node, Tensor};
use std::collections::BTreeMap;
use std::fmt::Display;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use zip::ZipArchive;
use zip::result::ZipError;

/// The largest description that is read; numbers are not part of it.
const LARGEST_PICKLE: u64 = 1 << 28;
/// Where checkpoints keep their tensors, if not at the top.
const STATE: [&str; 3] = ["state_dict", "model", "model_state_dict"];

/// Tensors that a description lists.
const SHOWN: usize = 30;

/// An open PyTorch checkpoint (`.pt`, `.pth`, `.ckpt`, `.bin`; of PyTorch 1.6 or later).
///
/// The description is a program for Python's pickle machine. The interpreter here makes lists, dictionaries and tensors
/// and never calls a function; everything else becomes a placeholder that is left out.
#[derive(Debug)]
pub struct TorchCheckpoint {
    path: PathBuf,
    archive: ZipArchive<File>,
    /// The folder inside the archive.
    root: String,
    tensors: BTreeMap<String, Tensor>,
    remarks: Vec<String>,
}

impl TorchCheckpoint {
    /// Opens a checkpoint and reads its description.
    ///
    /// # Errors
    /// When it cannot be read, is not such an archive, or describes no tensors.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let file = File::open(path).map_err(Error::io(path))?;
        let mut archive = ZipArchive::new(file).map_err(|e| {
            let expected = "a checkpoint of PyTorch 1.6 or later (a ZIP archive)";
            match path.extension().is_some_and(|extension| extension == "safetensors") {
                true => Error::invalid(path, "file name", expected, "a .safetensors file, which is what this makes"),
                false => Error::invalid(path, "content", expected, e),
            }
        })?;
        let description = archive.file_names().find(|n| n.ends_with("/data.pkl")).map(str::to_string);
        let Some(description) = description else {
            return Err(Error::invalid(path, "archive", "data.pkl", "other files"));
        };
        let root = description.trim_end_matches("data.pkl").to_string();
        let bytes = entry(path, &mut archive, &description, LARGEST_PICKLE)?;
        if let Ok(order) = entry(path, &mut archive, &format!("{root}byteorder"), 16)
            && order != b"little"
        {
            return Err(Error::invalid(path, "byteorder", "little", String::from_utf8_lossy(&order)));
        }
        let machine = Machine::run(&bytes).map_err(|fault| Error::invalid(path, "data.pkl", "a pickle", fault))?;
        let mut checkpoint =
            Self { path: path.to_path_buf(), archive, root, tensors: BTreeMap::new(), remarks: Vec::new() };
        checkpoint.collect(&machine)?;
        Ok(checkpoint)
    }

    /// Finds the dictionary of tensors.
    fn collect(&mut self, machine: &Machine) -> Result<()> {
        let mut top = machine.result();
        let entries = |id| match machine.node(id) {
            Node::Dict(entries) => Some(entries),
            _ => None,
        };
        for (key, value) in entries(top).into_iter().flatten() {
            let named = matches!(machine.node(*key), Node::Text(key) if STATE.contains(&key.as_str()));
            if named && entries(*value).is_some() {
                top = *value;
                break;
            }
        }
        let Some(entries) = entries(top) else {
            return Err(self.invalid("data.pkl", "a dictionary of tensors", "something else"));
        };
        let mut others = Vec::new();
        for (key, value) in entries {
            match (machine.node(*key), machine.node(*value)) {
                (Node::Text(key), Node::Tensor(tensor)) => {
                    self.tensors.insert(key.clone(), tensor.clone());
                }
                (Node::Text(key), _) => others.push(key.clone()),
                _ => others.push("an entry without a name".into()),
            }
        }
        if self.tensors.is_empty() {
            return Err(self.invalid("data.pkl", "a dictionary of tensors", "one without"));
        }
        if !others.is_empty() {
            self.remarks.push(format!("left out, being no tensors: {}", others.join(", ")));
        }
        Ok(())
    }

    /// The tensors, as they will be written.
    ///
    /// # Errors
    /// When one is of a type that safetensors files do not have.
    pub fn tensors(&self) -> Result<Vec<Planned>> {
        let plan = |(name, tensor): (&String, &Tensor)| {
            let (dtype, width) = tensor.storage.dtype().ok_or_else(|| {
                let place = format!("tensor {name}");
                self.invalid(place, "numbers of a known type", &tensor.storage.kind)
            })?;
            Ok(Planned { name: name.clone(), dtype, width, shape: tensor.shape.clone() })
        };
        self.tensors.iter().map(plan).collect()
    }

    /// A description for people: the first thirty tensors, a line each, and the remarks.
    ///
    /// # Errors
    /// As [`tensors`](Self::tensors).
    pub fn describe(&self) -> Result<String> {
        let tensors = self.tensors()?;
        let bytes: usize = tensors.iter().map(|tensor| tensor.bytes()).sum();
        let mut text = format!("PyTorch checkpoint, {} tensors, {:.3} MB\n", tensors.len(), bytes as f64 / 1e6);
        for tensor in tensors.iter().take(SHOWN) {
            text += &format!("{} {} {:?}\n", tensor.name, tensor.dtype, tensor.shape);
        }
        if tensors.len() > SHOWN {
            text += &format!("and {} others\n", tensors.len() - SHOWN);
        }
        Ok(self.remarks.iter().fold(text, |text, remark| text + remark + "\n"))
    }

    /// Remarks on entries that are no tensors and were left out.
    pub fn remarks(&self) -> &[String] {
        &self.remarks
    }

    /// Writes the numbers of a tensor, row-major and little-endian. They are passed on as they are read; only a tensor
    /// whose numbers lie in another order, a transposed one say, is in memory whole.
    ///
    /// # Errors
    /// When they are not in the archive, do not fit into memory, or `out` fails.
    pub fn write(&mut self, name: &str, out: &mut dyn Write) -> io::Result<()> {
        let tensor = self.tensors.get(name).ok_or_else(|| io::Error::other(format!("no tensor {name}")))?;
        let width = tensor.storage.dtype().map_or(1, |(_, width)| width);
        let size = tensor.storage.len.saturating_mul(width as u64);
        let outside = || io::Error::other(format!("tensor {name} reaches beyond its {size} bytes"));
        let bytes_of = |count: usize| count.checked_mul(width).map(|bytes| bytes as u64).ok_or_else(outside);
        let start = bytes_of(tensor.offset)?;
        let length = bytes_of(tensor.span().ok_or_else(outside)?)?;
        if start.checked_add(length).is_none_or(|end| end > size) {
            return Err(outside());
        }
        let in_archive = format!("{}data/{}", self.root, tensor.storage.key);
        // Checksums are ignored: PyTorch can leave them out.
        let mut file = self.archive.by_name_seek(&in_archive).map_err(io::Error::other)?;
        file.seek(SeekFrom::Start(start))?;
        let mut numbers = file.take(length);
        if tensor.is_contiguous() {
            return if io::copy(&mut numbers, out)? == length { Ok(()) } else { Err(outside()) };
        }
        let count: usize = tensor.shape.iter().product();
        if count > REPEATED && bytes_of(count)? > length {
            let message =
                format!("tensor {name}: expected at most {REPEATED} numbers that repeat others, found {count}");
            return Err(io::Error::new(io::ErrorKind::InvalidData, message));
        }
        check_memory(name, length, available_memory())?;
        let mut bytes = Vec::new();
        bytes.try_reserve_exact(length as usize).map_err(io::Error::other)?;
        numbers.read_to_end(&mut bytes)?;
        for i in 0..count {
            let at = tensor.position(i) * width;
            out.write_all(bytes.get(at..at + width).ok_or_else(outside)?)?;
        }
        Ok(())
    }

    fn invalid(&self, place: impl Display, expected: impl Display, found: impl Display) -> Error {
        Error::invalid(&self.path, place, expected, found)
    }
}

/// The most numbers of a tensor that has fewer in its file, as one that was expanded: a few bytes may stand for any
/// number of them.
const REPEATED: usize = 1 << 24;

/// An error that names the figures, if a tensor that is to be put in order does not fit into memory.
fn check_memory(name: &str, needed: u64, available: Option<u64>) -> io::Result<()> {
    let Some(available) = available.filter(|available| *available < needed) else { return Ok(()) };
    let [needed, available] = [needed, available].map(|bytes| bytes as f64 / 1e9);
    let purpose = "its numbers are not in row-major order";
    let message = format!("tensor {name} needs {needed:.1} GB of memory and {available:.1} GB is free: {purpose}");
    Err(io::Error::new(io::ErrorKind::OutOfMemory, message))
}

/// The bytes of a file in the archive, no more than `limit`.
fn entry(path: &Path, archive: &mut ZipArchive<File>, name: &str, limit: u64) -> Result<Vec<u8>> {
    let mut file = archive.by_name(name).map_err(|e| match e {
        ZipError::Io(source) => Error::Io { path: path.to_path_buf(), source },
        other => Error::invalid(path, name, "a file in the archive, not compressed", other),
    })?;
    if file.size() > limit {
        return Err(Error::invalid(path, name, format!("at most {limit} bytes"), file.size()));
    }
    let mut bytes = Vec::new();
    file.by_ref().take(limit).read_to_end(&mut bytes).map_err(Error::io(path))?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_refused_with_figures() {
        let refusal = check_memory("a.turned", 5_000_000_000, Some(1_000_000_000)).unwrap_err().to_string();
        for part in ["a.turned", "5.0 GB", "1.0 GB", "row-major"] {
            assert!(refusal.contains(part), "{refusal}");
        }
        assert!(check_memory("a", 5, Some(5)).is_ok() && check_memory("a", 5, None).is_ok());
    }
}
