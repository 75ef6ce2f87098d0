//! Bytes that a document refers to: in the binary chunk, in the document itself, or in files beside it.

use super::document::{Buffer, BufferView};
use crate::files::file::read_bytes;
use crate::{Error, Result};
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use base64::{Engine, alphabet};
use std::borrow::Cow;
use std::path::{Component, Path, PathBuf};

/// The buffers of a document.
pub(super) struct Buffers<'a> {
    path: &'a Path,
    buffers: Vec<Cow<'a, [u8]>>,
    views: &'a [BufferView],
}

/// A part of a buffer.
pub(super) struct View<'a> {
    pub bytes: &'a [u8],
    pub stride: Option<usize>,
}

impl<'a> Buffers<'a> {
    pub(super) fn read(
        path: &'a Path,
        buffers: &[Buffer],
        views: &'a [BufferView],
        binary: Option<&'a [u8]>,
    ) -> Result<Self> {
        let buffers = buffers.iter().enumerate().map(|(i, buffer)| read(path, i, buffer, binary));
        Ok(Self { path, buffers: buffers.collect::<Result<_>>()?, views })
    }

    /// Bytes of all buffers.
    pub(super) fn len(&self) -> usize {
        self.buffers.iter().map(|buffer| buffer.len()).sum()
    }

    pub(super) fn view(&self, index: usize) -> Result<View<'_>> {
        let place = || format!("bufferViews[{index}]");
        let Some(view) = self.views.get(index) else {
            let expected = format!("fewer than {} bufferViews", self.views.len());
            return Err(Error::invalid(self.path, place(), expected, "an index beyond"));
        };
        let Some(buffer) = self.buffers.get(view.buffer) else {
            let expected = format!("a buffer below {}", self.buffers.len());
            return Err(Error::invalid(self.path, place(), expected, view.buffer));
        };
        let end = view.byte_offset.checked_add(view.byte_length);
        let bytes = end.and_then(|end| buffer.get(view.byte_offset..end)).ok_or_else(|| {
            let found = format!("{} from {}", view.byte_length, view.byte_offset);
            Error::invalid(self.path, place(), format!("bytes within the {} of its buffer", buffer.len()), found)
        })?;
        Ok(View { bytes, stride: view.byte_stride })
    }
}

/// Padded or not, as writers of glTF differ.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

fn read<'a>(path: &Path, index: usize, buffer: &Buffer, binary: Option<&'a [u8]>) -> Result<Cow<'a, [u8]>> {
    let place = format!("buffers[{index}]");
    let invalid = |expected: &str, found: String| Error::invalid(path, &place, expected, found);
    let bytes: Cow<[u8]> = match &buffer.uri {
        None => binary.ok_or_else(|| invalid("a uri or a binary chunk", "neither".into()))?.into(),
        Some(uri) => match uri.strip_prefix("data:") {
            Some(data) => {
                let coded = data.split_once(";base64,").ok_or_else(|| invalid("base64", "another data URI".into()))?.1;
                BASE64.decode(coded).map_err(|e| invalid("base64", e.to_string()))?.into()
            }
            None => read_bytes(beside(path, uri).ok_or_else(|| {
                let expected = "data, or the name of a file in the document's folder";
                invalid(expected, format!("{uri:?}"))
            })?)?
            .into(),
        },
    };
    if bytes.len() < buffer.byte_length {
        return Err(invalid(&format!("{} bytes", buffer.byte_length), bytes.len().to_string()));
    }
    Ok(bytes)
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
