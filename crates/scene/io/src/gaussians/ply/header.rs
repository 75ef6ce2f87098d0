//! The header of a PLY file: its elements and the types of their properties.

use crate::files::content::Content;
use crate::gaussians::scene_file::Drawing;
use crate::{Error, Result};
use std::path::Path;

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Format {
    Ascii,
    LittleEndian,
}

/// A scalar type: how many bytes, and how to read them.
#[derive(Clone, Copy)]
pub(super) struct Scalar {
    pub name: &'static str,
    pub size: usize,
    pub read: fn(&[u8]) -> f32,
}

macro_rules! scalar {
    ($t:ty) => {
        Scalar {
            name: stringify!($t),
            size: size_of::<$t>(),
            read: |bytes| {
                let chunk = bytes.first_chunk().expect("rows are cut to the sum of their sizes");
                <$t>::from_le_bytes(*chunk) as f32
            },
        }
    };
}

fn scalar(name: &str) -> Option<Scalar> {
    Some(match name {
        "char" | "int8" => scalar!(i8),
        "uchar" | "uint8" => scalar!(u8),
        "short" | "int16" => scalar!(i16),
        "ushort" | "uint16" => scalar!(u16),
        "int" | "int32" => scalar!(i32),
        "uint" | "uint32" => scalar!(u32),
        "float" | "float32" => scalar!(f32),
        "double" | "float64" => scalar!(f64),
        _ => return None,
    })
}

/// Rows of the same properties.
#[derive(Clone)]
pub(super) struct Element {
    pub name: String,
    /// Number of rows.
    pub count: usize,
    pub names: Vec<String>,
    pub types: Vec<Scalar>,
    /// Has a property whose length varies from row to row.
    pub lists: bool,
}

impl Element {
    /// Bytes of a row of a binary file.
    pub fn stride(&self) -> usize {
        self.types.iter().map(|t| t.size).sum()
    }

    /// That rows have a size.
    pub fn check(&self, path: &Path) -> Result<()> {
        if !self.lists && !self.types.is_empty() {
            return Ok(());
        }
        let expected = "scalar properties up to and in the element vertex";
        let found = if self.lists { "a list" } else { "no properties" };
        Err(Error::invalid(path, format!("element {}", self.name), expected, found))
    }

    /// True if there is a property of this name.
    pub fn has(&self, name: &str) -> bool {
        self.names.iter().any(|n| n == name)
    }

    /// The place of a property among all.
    pub fn position(&self, path: &Path, name: &str) -> Result<usize> {
        self.names.iter().position(|n| n == name).ok_or_else(|| {
            let found = format!("only {}", self.names.join(" "));
            Error::invalid(path, format!("element {}", self.name), format!("a property {name}"), found)
        })
    }

    /// Bytes of all rows, of at least `row` bytes each, when the body has room for them.
    pub fn room(&self, path: &Path, body: usize, row: usize) -> Result<usize> {
        match self.count.checked_mul(row) {
            Some(size) if size <= body => Ok(size),
            _ => {
                let found = format!("{body} bytes");
                let expected = format!("{} rows of {row} bytes or more", self.count);
                Err(Error::invalid(path, format!("element {}", self.name), expected, found))
            }
        }
    }

    /// The numbers of rows of a binary file, which are whole.
    pub fn numbers(&self, rows: &[u8]) -> Vec<f32> {
        if self.types.iter().all(|scalar| scalar.name == "f32") {
            // As good as all files, and large ones: a million Gaussians are 62 million numbers.
            return rows.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        }
        let mut values = Vec::with_capacity(rows.len() / self.stride() * self.types.len());
        for mut row in rows.chunks_exact(self.stride()) {
            for scalar in &self.types {
                values.push((scalar.read)(row));
                row = &row[scalar.size..];
            }
        }
        values
    }
}

/// The part of a file before its rows.
pub(super) struct Header {
    pub format: Format,
    pub elements: Vec<Element>,
    /// Antialiasing as a comment of Brush or Postshot states it.
    pub antialiased: bool,
    /// Offset of the body.
    pub end: usize,
}

/// Bytes of the start of a file that are read for its header at first.
const START: usize = 1 << 14;

impl Header {
    /// The header of a file; no more of the file is read than it needs.
    pub fn of(path: &Path, content: &Content<'_>) -> Result<Self> {
        let mut size = START;
        loop {
            let whole = size >= content.len();
            let start = content.part(0..size.min(content.len()))?;
            match Self::parse(path, &start, whole)? {
                Some(header) => return Ok(header),
                None => size *= 2,
            }
        }
    }

    /// The header of a file in memory.
    pub fn read(path: &Path, data: &[u8]) -> Result<Self> {
        Ok(Self::parse(path, data, true)?.expect("a whole file has a header or a fault"))
    }

    /// The header at the start of a file; none if it goes on where the start ends, unless that is the whole file.
    fn parse(path: &Path, data: &[u8], whole: bool) -> Result<Option<Self>> {
        check_kind(path, data)?;
        let mut format = None;
        let mut elements: Vec<Element> = Vec::new();
        let (mut antialiased, mut end) = (false, 0);
        for number in 1.. {
            let invalid = |expected: &str, found: &str| {
                Error::invalid(path, format!("header line {number}"), expected, format!("{found:?}"))
            };
            let Some(length) = data[end..].iter().position(|&b| b == b'\n') else {
                return if whole { Err(invalid("end_header before the end of the file", "")) } else { Ok(None) };
            };
            let line = String::from_utf8_lossy(&data[end..end + length]);
            let line = line.trim();
            end += length + 1;
            let words: Vec<&str> = line.split_whitespace().collect();
            match (number, words.as_slice()) {
                (1, ["ply"]) => {}
                (1, _) => return Err(invalid("ply", line)),
                (_, ["format", "ascii", "1.0"]) => format = Some(Format::Ascii),
                (_, ["format", "binary_little_endian", "1.0"]) => format = Some(Format::LittleEndian),
                (_, ["comment", "SplatRenderMode:", mode]) => antialiased = *mode == "mip",
                (_, ["comment", "antialiased", flag]) => antialiased = *flag == "1",
                (_, ["comment" | "obj_info", ..] | []) => {}
                (_, ["element", name, count]) => {
                    let count = count.parse().map_err(|_| invalid("a number of elements", line))?;
                    let name = name.to_string();
                    elements.push(Element { name, count, names: Vec::new(), types: Vec::new(), lists: false });
                }
                (_, ["property", "list", _, _, _]) => {
                    elements.last_mut().ok_or_else(|| invalid("an element first", line))?.lists = true;
                }
                (_, ["property", kind, name]) => {
                    let element = elements.last_mut().ok_or_else(|| invalid("an element first", line))?;
                    element.types.push(scalar(kind).ok_or_else(|| invalid("a scalar type", line))?);
                    element.names.push(name.to_string());
                }
                (_, ["end_header"]) => break,
                _ => {
                    return Err(invalid(
                        "format ascii or binary_little_endian 1.0, element, property or comment",
                        line,
                    ));
                }
            }
        }
        let format = format.ok_or_else(|| Error::invalid(path, "header", "a line beginning with format", "none"))?;
        Ok(Some(Self { format, elements, antialiased, end }))
    }

    /// The elements before the vertices, and the vertices; all of them have rows of a size.
    pub fn vertices(&self, path: &Path) -> Result<(&[Element], &Element)> {
        let Some(index) = self.elements.iter().position(|e| e.name == "vertex") else {
            return Err(Error::invalid(path, "header", "an element named vertex", "none"));
        };
        self.elements[..=index].iter().try_for_each(|e| e.check(path))?;
        Ok((&self.elements[..index], &self.elements[index]))
    }

    /// The place of the first vertex of a binary file of so many bytes, which has room for all.
    pub fn first_vertex(&self, path: &Path, length: usize) -> Result<usize> {
        let (before, vertex) = self.vertices(path)?;
        let mut at = self.end;
        for element in before {
            at += element.room(path, length - at, element.stride())?;
        }
        vertex.room(path, length - at, vertex.stride())?;
        Ok(at)
    }
}

/// Refuses a file that is no PLY by its first bytes: binary data may have no line end for gigabytes.
fn check_kind(path: &Path, data: &[u8]) -> Result<()> {
    if data.strip_prefix(b"ply").is_some_and(|rest| rest.first().is_none_or(u8::is_ascii_whitespace)) {
        return Ok(());
    }
    const SHOWN: usize = 20;
    let first = data.split(|byte| *byte == b'\n').next().unwrap_or_default();
    let first = String::from_utf8_lossy(&first[..first.len().min(4 * SHOWN)]);
    let found = match () {
        () if data.is_empty() => "an empty file".into(),
        () if first.trim_end().chars().any(|c| c.is_control() || c == char::REPLACEMENT_CHARACTER) => {
            "other bytes".into()
        }
        () => format!("text that begins with {:?}", first.trim_end().chars().take(SHOWN).collect::<String>()),
    };
    Err(Error::invalid(path, "header line 1", "a PLY file (\"ply\" in its first line)", found))
}

/// The first lines of a binary file, with the comment of Brush that says how Gaussians were trained.
pub(super) fn first_lines(drawing: Drawing) -> String {
    let comment = if drawing.antialiased { "comment SplatRenderMode: mip\n" } else { "" };
    format!("ply\nformat binary_little_endian 1.0\n{comment}")
}
