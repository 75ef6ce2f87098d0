//! PyTorch checkpoints: a ZIP archive of a pickled description and of raw numbers.

mod pickle;

use crate::weights_writer::Planned;
use crate::{Error, Result};
use pickle::{Machine, Node, Storage, Tensor};
use std::collections::BTreeMap;
use std::fmt::Display;
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use zip::ZipArchive;
use zip::result::ZipError;

/// The largest description that is read; numbers are not part of it.
const LARGEST_PICKLE: u64 = 1 << 28;
/// Where checkpoints keep their tensors, if not at the top.
const STATE: [&str; 3] = ["state_dict", "model", "model_state_dict"];

/// An open PyTorch checkpoint (`.pt`, `.pth`, `.ckpt`, `.bin`; of PyTorch 1.6 or later).
///
/// The description is a program for Python's pickle machine. The one here knows how to make lists, dictionaries and
/// tensors, and calls nothing: whatever else the program asks for becomes a placeholder that is left out.
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
    /// When it cannot be read, is no such archive, or describes no tensors.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let file = File::open(path).map_err(Error::io(path))?;
        let mut archive = ZipArchive::new(file).map_err(|e| {
            let expected = "a checkpoint of PyTorch 1.6 or later (a ZIP archive)";
            Error::invalid(path, "content", expected, e)
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

    /// What was left out.
    pub fn remarks(&self) -> &[String] {
        &self.remarks
    }

    /// Writes the numbers of a tensor, row-major and little-endian.
    ///
    /// # Errors
    /// When they are not in the archive, or `out` fails.
    pub fn write(&mut self, name: &str, out: &mut dyn Write) -> io::Result<()> {
        let tensor = self.tensors.get(name).cloned().ok_or_else(|| io::Error::other(format!("no tensor {name}")))?;
        let Storage { key, len, .. } = &tensor.storage;
        let width = tensor.storage.dtype().map_or(1, |(_, width)| width);
        let size = len.checked_mul(width as u64).ok_or_else(|| io::Error::other(format!("{name}: too large")))?;
        let bytes = entry(&self.path, &mut self.archive, &format!("{}data/{key}", self.root), size)
            .map_err(|e| io::Error::other(e.to_string()))?;
        let outside = || io::Error::other(format!("tensor {name} reaches beyond its {} bytes", bytes.len()));
        let count: usize = tensor.shape.iter().product();
        if tensor.is_contiguous() {
            let start = tensor.offset.checked_mul(width).ok_or_else(outside)?;
            let end = count.checked_mul(width).and_then(|n| n.checked_add(start)).ok_or_else(outside)?;
            return out.write_all(bytes.get(start..end).ok_or_else(outside)?);
        }
        for i in 0..count {
            let at = tensor.position(i).and_then(|at| at.checked_mul(width)).ok_or_else(outside)?;
            out.write_all(bytes.get(at..at + width).ok_or_else(outside)?)?;
        }
        Ok(())
    }

    fn invalid(&self, place: impl Display, expected: impl Display, found: impl Display) -> Error {
        Error::invalid(&self.path, place, expected, found)
    }
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
