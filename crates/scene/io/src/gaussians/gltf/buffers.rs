//! Bytes that a document refers to: in the binary chunk, in the document itself, or in files beside it.

use super::document::{Buffer, BufferView};
use crate::files::content::Content;
use crate::{Error, Result};
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use base64::{Engine, alphabet};
use std::borrow::Cow;
use std::ops::Range;
use std::path::{Component, Path, PathBuf};

/// The buffers of a document.
pub(super) struct Buffers<'a> {
    path: PathBuf,
    file: Content<'a>,
    buffers: Vec<Source<'a>>,
    views: Vec<BufferView>,
}

/// The bytes of a buffer.
enum Source<'a> {
    /// A part of the file, which is its binary chunk.
    Chunk(Range<usize>),
    Own(Content<'a>),
}

/// A part of a buffer.
pub(super) struct View<'a> {
    content: &'a Content<'a>,
    start: usize,
    pub length: usize,
    pub stride: Option<usize>,
}

impl View<'_> {
    /// Bytes that lie within its length.
    pub(super) fn part(&self, part: Range<usize>) -> Result<Cow<'_, [u8]>> {
        self.content.part(self.start + part.start..self.start + part.end)
    }
}

impl<'a> Buffers<'a> {
    /// The buffers of a document in a file; those in the binary chunk are read from it later.
    pub(super) fn open(
        path: &Path,
        (file, binary): (Content<'a>, Option<Range<usize>>),
        buffers: &[Buffer],
        views: Vec<BufferView>,
    ) -> Result<Self> {
        let sources = buffers.iter().enumerate().map(|(i, buffer)| source(path, i, buffer, binary.clone()));
        Ok(Self { path: path.to_path_buf(), file, buffers: sources.collect::<Result<_>>()?, views })
    }

    /// Bytes of all buffers.
    pub(super) fn len(&self) -> usize {
        self.buffers.iter().map(|buffer| self.place(buffer).1.len()).sum()
    }

    /// The content and range of a buffer's bytes.
    fn place<'b>(&'b self, source: &'b Source<'a>) -> (&'b Content<'a>, Range<usize>) {
        match source {
            Source::Chunk(place) => (&self.file, place.clone()),
            Source::Own(content) => (content, 0..content.len()),
        }
    }

    pub(super) fn view(&self, index: usize) -> Result<View<'_>> {
        let place = || format!("bufferViews[{index}]");
        let Some(view) = self.views.get(index) else {
            let expected = format!("fewer than {} bufferViews", self.views.len());
            return Err(Error::invalid(&self.path, place(), expected, "an index beyond"));
        };
        let Some(buffer) = self.buffers.get(view.buffer) else {
            let expected = format!("a buffer below {}", self.buffers.len());
            return Err(Error::invalid(&self.path, place(), expected, view.buffer));
        };
        let (content, bytes) = self.place(buffer);
        let end = view.byte_offset.checked_add(view.byte_length);
        if end.is_none_or(|end| end > bytes.len()) {
            let found = format!("{} from {}", view.byte_length, view.byte_offset);
            let expected = format!("bytes within the {} of its buffer", bytes.len());
            return Err(Error::invalid(&self.path, place(), expected, found));
        }
        let (start, length, stride) = (bytes.start + view.byte_offset, view.byte_length, view.byte_stride);
        Ok(View { content, start, length, stride })
    }
}

/// Padded or not, as writers of glTF differ.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

fn source<'a>(path: &Path, index: usize, buffer: &Buffer, binary: Option<Range<usize>>) -> Result<Source<'a>> {
    let place = format!("buffers[{index}]");
    let invalid = |expected: &str, found: String| Error::invalid(path, &place, expected, found);
    let source = match &buffer.uri {
        None => Source::Chunk(binary.ok_or_else(|| invalid("a uri or a binary chunk", "neither".into()))?),
        Some(uri) => Source::Own(match uri.strip_prefix("data:") {
            Some(data) => {
                let coded = data.split_once(";base64,").ok_or_else(|| invalid("base64", "another data URI".into()))?.1;
                Content::Memory(BASE64.decode(coded).map_err(|e| invalid("base64", e.to_string()))?.into())
            }
            None => Content::open(&beside(path, uri).ok_or_else(|| {
                let expected = "data, or the name of a file in the document's folder";
                invalid(expected, format!("{uri:?}"))
            })?)?,
        }),
    };
    let length = match &source {
        Source::Chunk(place) => place.len(),
        Source::Own(content) => content.len(),
    };
    if length < buffer.byte_length {
        return Err(invalid(&format!("{} bytes", buffer.byte_length), length.to_string()));
    }
    Ok(source)
}

/// A file of the document's folder or below it.
fn beside(path: &Path, uri: &str) -> Option<PathBuf> {
    let name = PathBuf::from(unescaped(uri)?);
    let inside = name.components().all(|part| matches!(part, Component::Normal(_)));
    (inside && name.file_name().is_some() && !uri.contains(':')).then(|| path.with_file_name("").join(name))
}

/// A URI without percent signs.
fn unescaped(uri: &str) -> Option<String> {
    let mut parts = uri.split('%');
    let mut bytes = parts.next()?.as_bytes().to_vec();
    for part in parts {
        let (code, rest) = part.split_at_checked(2)?;
        bytes.push(u8::from_str_radix(code, 16).ok()?);
        bytes.extend(rest.as_bytes());
    }
    String::from_utf8(bytes).ok()
}
