//! The `vertex` element of a PLY file as a table of numbers, and elements of binary files as they are.

use crate::gaussians::scene_file::Drawing;
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// The vertices, whatever their properties.
pub(crate) struct Table {
    path: PathBuf,
    /// Property names.
    pub(crate) names: Vec<String>,
    /// Number of vertices.
    pub(crate) rows: usize,
    /// True if a comment says that Gaussians were trained antialiased.
    pub(crate) antialiased: bool,
    /// `[rows, names.len()]`.
    values: Vec<f32>,
}

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Ascii,
    LittleEndian,
}

/// A scalar type: how many bytes, and how to read them.
#[derive(Clone, Copy)]
struct Scalar {
    name: &'static str,
    size: usize,
    read: fn(&[u8]) -> f32,
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

pub(crate) struct Element {
    name: String,
    count: usize,
    names: Vec<String>,
    types: Vec<Scalar>,
    /// Has a property whose length varies from row to row.
    lists: bool,
}

impl Element {
    /// Bytes of a row of a binary file.
    fn stride(&self) -> usize {
        self.types.iter().map(|t| t.size).sum()
    }

    /// That rows have a size.
    fn check(&self, path: &Path) -> Result<()> {
        if !self.lists && !self.types.is_empty() {
            return Ok(());
        }
        let expected = "scalar properties up to and in the element vertex";
        let found = if self.lists { "a list" } else { "no properties" };
        Err(Error::invalid(path, format!("element {}", self.name), expected, found))
    }

    fn position(&self, path: &Path, name: &str) -> Result<usize> {
        self.names.iter().position(|n| n == name).ok_or_else(|| {
            let found = format!("only {}", self.names.join(" "));
            Error::invalid(path, format!("element {}", self.name), format!("a property {name}"), found)
        })
    }
}

struct Header {
    format: Format,
    elements: Vec<Element>,
    /// Antialiasing as a comment of Brush or Postshot states it.
    antialiased: bool,
    /// Where the body begins.
    end: usize,
}

impl Table {
    /// Reads the vertices of an ASCII or binary little-endian file. Elements before them are skipped (those of
    /// fixed size only), elements after them are ignored.
    pub(crate) fn read(path: &Path, data: &[u8]) -> Result<Self> {
        let header = header(path, data)?;
        let body = &data[header.end..];
        let index = header.elements.iter().position(|e| e.name == "vertex");
        let Some(index) = index else {
            return Err(Error::invalid(path, "header", "an element named vertex", "none"));
        };
        let (before, vertex) = (&header.elements[..index], &header.elements[index]);
        header.elements[..=index].iter().try_for_each(|e| e.check(path))?;
        let values = match header.format {
            Format::Ascii => ascii(path, body, before, vertex)?,
            Format::LittleEndian => binary(path, body, before, vertex)?,
        };
        let (path, names) = (path.to_path_buf(), vertex.names.clone());
        Ok(Self { path, names, rows: vertex.count, antialiased: header.antialiased, values })
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

/// The lists of the element `face` behind the vertices, whose lengths are bytes and whose numbers are 32-bit integers; none where there
/// is no such element.
pub(crate) fn faces(path: &Path, data: &[u8]) -> Result<Vec<Vec<u32>>> {
    let Header { format, elements, end, .. } = header(path, data)?;
    let Some(index) = elements.iter().position(|e| e.name == "face") else { return Ok(Vec::new()) };
    let (before, face) = (&elements[..index], &elements[index]);
    before.iter().try_for_each(|e| e.check(path))?;
    let broken = |expected: &str| Error::invalid(path, "element face", expected, "something else");
    if !face.lists || !face.types.is_empty() {
        return Err(broken("one list of indices"));
    }
    // A length and at least nothing.
    let count = room(path, data.len() - end, face, 1)?;
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
        body = &body[room(path, body.len(), element, element.stride())?..];
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
        let Header { format, elements, end, .. } = header(path, data)?;
        if format != Format::LittleEndian {
            return Err(Error::invalid(path, "header", "format binary_little_endian 1.0", "ascii"));
        }
        let (mut body, mut all) = (&data[end..], Vec::new());
        for element in elements {
            if element.count > 0 {
                element.check(path)?;
            }
            let (rows, rest) = body.split_at(room(path, body.len(), &element, element.stride())?);
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

/// The first lines of a binary file, with the comment of Brush that says how Gaussians were trained.
pub(super) fn first_lines(drawing: Drawing) -> String {
    let comment = if drawing.antialiased { "comment SplatRenderMode: mip\n" } else { "" };
    format!("ply\nformat binary_little_endian 1.0\n{comment}")
}

fn header(path: &Path, data: &[u8]) -> Result<Header> {
    let mut format = None;
    let mut elements: Vec<Element> = Vec::new();
    let (mut antialiased, mut end) = (false, 0);
    for number in 1.. {
        let invalid = |expected: &str, found: &str| {
            Error::invalid(path, format!("header line {number}"), expected, format!("{found:?}"))
        };
        let Some(length) = data[end..].iter().position(|&b| b == b'\n') else {
            return Err(invalid("end_header before the end of the file", ""));
        };
        let line = String::from_utf8_lossy(&data[end..end + length]);
        let line = line.trim();
        end += length + 1;
        let words: Vec<&str> = line.split_whitespace().collect();
        match (number, words.as_slice()) {
            (1, ["ply"]) => {}
            (1, _) => return Err(invalid("ply", line.get(..20).unwrap_or(line))),
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
            _ => return Err(invalid("format ascii or binary_little_endian 1.0, element, property or comment", line)),
        }
    }
    let format = format.ok_or_else(|| Error::invalid(path, "header", "a line beginning with format", "none"))?;
    Ok(Header { format, elements, antialiased, end })
}

/// `count` rows of at least `row` bytes each, when the body has room for them.
fn room(path: &Path, body: usize, element: &Element, row: usize) -> Result<usize> {
    match element.count.checked_mul(row) {
        Some(size) if size <= body => Ok(size),
        _ => {
            let found = format!("{body} bytes");
            let expected = format!("{} rows of {row} bytes or more", element.count);
            Err(Error::invalid(path, format!("element {}", element.name), expected, found))
        }
    }
}

fn binary(path: &Path, mut body: &[u8], before: &[Element], vertex: &Element) -> Result<Vec<f32>> {
    for element in before {
        body = &body[room(path, body.len(), element, element.stride())?..];
    }
    let size = room(path, body.len(), vertex, vertex.stride())?;
    if vertex.types.iter().all(|scalar| scalar.name == "f32") {
        // As good as all files, and large ones: a million Gaussians are 62 million numbers.
        return Ok(body[..size].as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect());
    }
    let mut values = Vec::with_capacity(vertex.count * vertex.types.len());
    for mut row in body[..size].chunks_exact(vertex.stride()) {
        for scalar in &vertex.types {
            values.push((scalar.read)(row));
            row = &row[scalar.size..];
        }
    }
    Ok(values)
}

fn ascii(path: &Path, body: &[u8], before: &[Element], vertex: &Element) -> Result<Vec<f32>> {
    // A digit and a separator for each value; the last one may lack the separator.
    let smallest = |e: &Element| 2 * e.types.len();
    for element in before.iter().chain([vertex]) {
        room(path, body.len() + 1, element, smallest(element))?;
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
