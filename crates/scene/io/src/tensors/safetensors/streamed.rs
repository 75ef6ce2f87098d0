//! Writes safetensors files of any size, one tensor after another.

use crate::{Error, Result, atomic_write};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

/// The description of a tensor to be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Planned {
    /// Its name.
    pub name: String,
    /// The type's name in safetensors headers, such as `BF16`.
    pub dtype: &'static str,
    /// Bytes for each value.
    pub width: usize,
    /// Its dimensions.
    pub shape: Vec<usize>,
}

impl Planned {
    /// Bytes of all values.
    pub fn bytes(&self) -> usize {
        self.shape.iter().product::<usize>() * self.width
    }
}

/// Writes a safetensors file of any size atomically, calling `fill` for each tensor in turn to write its little-endian
/// values.
///
/// Only the memory of `fill` itself is used.
///
/// # Errors
/// When the file cannot be written, `fill` fails, or it writes another number of bytes than planned.
pub fn write_weights(
    path: impl AsRef<Path>,
    metadata: &BTreeMap<String, String>,
    tensors: &[Planned],
    mut fill: impl FnMut(&Planned, &mut dyn Write) -> io::Result<()>,
) -> Result<()> {
    let path = path.as_ref();
    // Wide types first, so that every tensor is aligned in the file.
    let mut order: Vec<&Planned> = tensors.iter().collect();
    order.sort_by_key(|tensor| std::cmp::Reverse(tensor.width));
    let mut header: BTreeMap<&str, Value> = BTreeMap::new();
    if !metadata.is_empty() {
        header.insert("__metadata__", json!(metadata));
    }
    let mut offset = 0;
    for tensor in &order {
        let end = offset + tensor.bytes();
        let entry = json!({"data_offsets": [offset, end], "dtype": tensor.dtype, "shape": tensor.shape});
        if header.insert(&tensor.name, entry).is_some() {
            return Err(Error::invalid(path, format!("tensor {}", tensor.name), "one of that name", "two"));
        }
        offset = end;
    }
    atomic_write(path, |w| {
        let mut header = serde_json::to_vec(&header)?;
        header.resize(header.len().next_multiple_of(8), b' ');
        w.write_all(&(header.len() as u64).to_le_bytes())?;
        w.write_all(&header)?;
        for tensor in &order {
            let mut counted = Counted { to: w, bytes: 0 };
            fill(tensor, &mut counted)?;
            if counted.bytes != tensor.bytes() {
                let found = format!("{}: {} bytes written, {} planned", tensor.name, counted.bytes, tensor.bytes());
                return Err(io::Error::other(found));
            }
        }
        Ok(())
    })
}

struct Counted<'a> {
    to: &'a mut dyn Write,
    bytes: usize,
}

impl Write for Counted<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.to.write(bytes)?;
        self.bytes += written;
        Ok(written)
    }
    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}
