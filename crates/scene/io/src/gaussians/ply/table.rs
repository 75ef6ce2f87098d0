//! The `vertex` element of a PLY file as a table of numbers, and elements of binary files as they are.

use super::header::{Element, Format, Header};
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// The vertices, with any properties.
pub(crate) struct Table {
    path: PathBuf,
    /// Property names.
    pub(crate) names: Vec<String>,
    /// Number of vertices.
    pub(crate) rows: usize,
    /// `[rows, names.len()]`.
    values: Vec<f32>,
}

impl Table {
    /// Reads the vertices of an ASCII or binary little-endian file. Elements before them are skipped (only if their
    /// size is fixed), elements after them are ignored.
    pub(crate) fn read(path: &Path, data: &[u8]) -> Result<Self> {
        let header = Header::read(path, data)?;
        let (before, vertex) = header.vertices(path)?;
        let values = match header.format {
            Format::Ascii => ascii(path, &data[header.end..], before, vertex)?,
            Format::LittleEndian => {
                let first = header.first_vertex(path, data.len())?;
                vertex.numbers(&data[first..][..vertex.count * vertex.stride()])
            }
        };
        Ok(Self { path: path.to_path_buf(), names: vertex.names.clone(), rows: vertex.count, values })
    }

    /// The position of a property.
    pub(crate) fn column(&self, name: &str) -> Result<usize> {
        self.names.iter().position(|n| n == name).ok_or_else(|| {
            let found = format!("only {}", self.names.join(" "));
            Error::invalid(&self.path, "element vertex", format!("a property {name}"), found)
        })
    }

    /// One vertex.
    pub(crate) fn row(&self, row: usize) -> &[f32] {
        &self.values[row * self.names.len()..][..self.names.len()]
    }
}

/// The lists of the element `face` behind the vertices, whose lengths are bytes and whose numbers are 32-bit integers;
/// none where there is no such element.
pub(crate) fn faces(path: &Path, data: &[u8]) -> Result<Vec<Vec<u32>>> {
    let Header { format, elements, end, .. } = Header::read(path, data)?;
    let Some(index) = elements.iter().position(|e| e.name == "face") else { return Ok(Vec::new()) };
    let (before, face) = (&elements[..index], &elements[index]);
    before.iter().try_for_each(|e| e.check(path))?;
    let broken = |expected: &str| Error::invalid(path, "element face", expected, "something else");
    if !face.lists || !face.types.is_empty() {
        return Err(broken("one list of indices"));
    }
    // A length and at least nothing.
    let count = face.room(path, data.len() - end, 1)?;
    let mut lists = Vec::with_capacity(count);
    if format == Format::Ascii {
        let text =
            std::str::from_utf8(&data[end..]).map_err(|_| Error::invalid(path, "body", "ASCII text", "other bytes"))?;
        let skip: usize = before.iter().map(|e| e.count.saturating_mul(e.types.len())).sum();
        let mut words = text.split_ascii_whitespace().skip(skip);
        let mut number = || words.next().and_then(|word| word.parse::<u32>().ok()).ok_or_else(|| broken("indices"));
        for _ in 0..count {
            let length = number()?;
            lists.push((0..length.min(u32::from(u8::MAX))).map(|_| number()).collect::<Result<Vec<u32>>>()?);
        }
        return Ok(lists);
    }
    let mut body = &data[end..];
    for element in before {
        body = &body[element.room(path, body.len(), element.stride())?..];
    }
    for _ in 0..count {
        let rest = body.split_first().and_then(|(n, rest)| rest.split_at_checked(4 * usize::from(*n)));
        let (list, rest) = rest.ok_or_else(|| broken("as many lists as it says"))?;
        lists.push(list.as_chunks().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect());
        body = rest;
    }
    Ok(lists)
}

/// The elements of a binary file, their rows as they are in it.
pub(crate) struct Elements<'a> {
    path: &'a Path,
    all: Vec<(Element, &'a [u8])>,
}

impl<'a> Elements<'a> {
    /// Cuts a binary little-endian file of fixed-size rows into its elements.
    pub(crate) fn read(path: &'a Path, data: &'a [u8]) -> Result<Self> {
        let Header { format, elements, end, .. } = Header::read(path, data)?;
        if format != Format::LittleEndian {
            return Err(Error::invalid(path, "header", "format binary_little_endian 1.0", "ascii"));
        }
        let (mut body, mut all) = (&data[end..], Vec::new());
        for element in elements {
            if element.count > 0 {
                element.check(path)?;
            }
            let (rows, rest) = body.split_at(element.room(path, body.len(), element.stride())?);
            all.push((element, rows));
            body = rest;
        }
        Ok(Self { path, all })
    }

    /// The names of an element's properties; none where there is no such element.
    pub(crate) fn names(&self, element: &str) -> &[String] {
        self.all.iter().find(|(e, _)| e.name == element).map_or(&[], |(e, _)| &e.names)
    }

    /// One property of all rows of an element, which has this type; none where there is no such element.
    pub(crate) fn column<const N: usize>(&self, element: &str, name: &str, kind: &str) -> Result<Vec<[u8; N]>> {
        let Some((element, rows)) = self.all.iter().find(|(e, _)| e.name == element) else { return Ok(Vec::new()) };
        let position = element.position(self.path, name)?;
        let found = element.types[position];
        if found.name != kind || found.size != N {
            let place = format!("element {}, property {name}", element.name);
            return Err(Error::invalid(self.path, place, kind, found.name));
        }
        let offset: usize = element.types[..position].iter().map(|t| t.size).sum();
        let value = |row: &[u8]| *row[offset..].first_chunk().expect("rows are as long as their types");
        Ok(rows.chunks_exact(element.stride()).map(value).collect())
    }
}

/// The numbers of the vertices of a text.
pub(super) fn ascii(path: &Path, body: &[u8], before: &[Element], vertex: &Element) -> Result<Vec<f32>> {
    // A digit and a separator for each value; the last one may lack the separator.
    let smallest = |e: &Element| 2 * e.types.len();
    for element in before.iter().chain([vertex]) {
        element.room(path, body.len() + 1, smallest(element))?;
    }
    let text = std::str::from_utf8(body).map_err(|_| Error::invalid(path, "body", "ASCII text", "other bytes"))?;
    let mut words = text.split_ascii_whitespace();
    let skip: usize = before.iter().map(|e| e.count * e.types.len()).sum();
    let mut values = Vec::with_capacity(vertex.count * vertex.types.len());
    for _ in 0..skip {
        words.next();
    }
    for row in 0..vertex.count {
        for name in &vertex.names {
            let word = words.next().unwrap_or("the end of the file");
            let place = || format!("vertex {row}, property {name}");
            values.push(word.parse().map_err(|_| Error::invalid(path, place(), "a number", word))?);
        }
    }
    Ok(values)
}
