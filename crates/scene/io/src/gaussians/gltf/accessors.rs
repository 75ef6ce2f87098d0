//! Numbers of accessors: of several types, normalized, interleaved, sparse.

use super::buffers::{Buffers, View};
use super::document::{Accessor, Sparse};
use crate::{Error, Result};
use std::ops::Range;
use std::path::PathBuf;

/// A type of numbers.
#[derive(Clone, Copy)]
struct Component {
    size: usize,
    /// The integer that stands for 1 where numbers are normalized; none of floats.
    one: Option<f32>,
    read: fn(&[u8]) -> f32,
}

macro_rules! component {
    ($t:ty, $one:expr) => {
        Component {
            size: size_of::<$t>(),
            one: $one,
            read: |bytes| <$t>::from_le_bytes(*bytes.first_chunk().expect("as long as its type")) as f32,
        }
    };
}

fn component(code: u64) -> Option<Component> {
    Some(match code {
        5120 => component!(i8, Some(127.0)),
        5121 => component!(u8, Some(255.0)),
        5122 => component!(i16, Some(32767.0)),
        5123 => component!(u16, Some(65535.0)),
        5126 => component!(f32, None),
        _ => return None,
    })
}

/// Types that numbers may have: codes of components, each with true if integers are normalized.
pub(super) type Allowed<'a> = &'a [(u64, bool)];
pub(super) const FLOAT: (u64, bool) = (5126, false);

/// The accessors of a document.
pub(super) struct Accessors<'a> {
    pub path: PathBuf,
    pub accessors: Vec<Accessor>,
    pub buffers: Buffers<'a>,
}

impl Accessors<'_> {
    /// Number of an accessor's elements.
    pub(super) fn count(&self, index: usize) -> Result<usize> {
        Ok(self.accessor(index)?.count)
    }

    /// True if some elements stand elsewhere than the others.
    pub(super) fn are_sparse(&self) -> bool {
        self.accessors.iter().any(|accessor| accessor.sparse.is_some())
    }

    /// Some elements of an accessor of `count` elements of `N` numbers.
    pub(super) fn read<const N: usize>(
        &self,
        (index, allowed): (usize, Allowed<'_>),
        count: usize,
        wanted: Range<usize>,
    ) -> Result<Vec<[f32; N]>> {
        let accessor = self.accessor(index)?;
        let invalid = |expected: &str, found: String| Error::invalid(&self.path, place(index), expected, found);
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][N - 1];
        if (accessor.kind.as_str(), accessor.count) != (kind, count) {
            let found = format!("{} of {}", accessor.count, accessor.kind);
            return Err(invalid(&format!("{count} elements of {kind}"), found));
        }
        let found = (accessor.component_type, accessor.normalized);
        let component = component(found.0).filter(|_| allowed.contains(&found)).ok_or_else(|| {
            let named = |(code, normalized): &_| format!("{code}{}", if *normalized { " normalized" } else { "" });
            let allowed: Vec<String> = allowed.iter().map(named).collect();
            invalid(&format!("a componentType of {}", allowed.join(", ")), named(&found))
        })?;
        let number = |bytes: &[u8]| match (accessor.normalized, component.one) {
            (true, Some(one)) => ((component.read)(bytes) / one).max(-1.0),
            _ => (component.read)(bytes),
        };
        let element = |bytes: &[u8]| -> [f32; N] { std::array::from_fn(|i| number(&bytes[i * component.size..])) };
        let size = N * component.size;
        let mut elements = match accessor.buffer_view {
            None => vec![[0.0; N]; wanted.len()],
            Some(view) => {
                let rows = self.rows(index, view, accessor.byte_offset, [count, size])?;
                rows.read(wanted.clone(), element)?
            }
        };
        if let Some(sparse) = &accessor.sparse {
            let replaced = self.replaced(index, sparse, count)?;
            let values =
                self.rows(index, sparse.values.buffer_view, sparse.values.byte_offset, [sparse.count, size])?;
            for (at, value) in replaced.into_iter().zip(values.read(0..sparse.count, element)?) {
                if wanted.contains(&at) {
                    elements[at - wanted.start] = value;
                }
            }
        }
        match elements.iter().position(|element| element.iter().any(|x| !x.is_finite())) {
            Some(i) => Err(invalid("finite numbers", format!("{:?} at {}", elements[i], wanted.start + i))),
            None => Ok(elements),
        }
    }

    fn accessor(&self, index: usize) -> Result<&Accessor> {
        self.accessors.get(index).ok_or_else(|| {
            let expected = format!("fewer than {} accessors", self.accessors.len());
            Error::invalid(&self.path, place(index), expected, "an index beyond")
        })
    }

    /// Indices of the elements that a sparse accessor replaces.
    fn replaced(&self, index: usize, sparse: &Sparse, count: usize) -> Result<Vec<usize>> {
        let kind = sparse.indices.component_type;
        let read: fn(&[u8]) -> usize = match kind {
            Some(5121) => |bytes| bytes[0].into(),
            Some(5123) => |bytes| u16::from_le_bytes([bytes[0], bytes[1]]).into(),
            Some(5125) => |bytes| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as usize,
            other => {
                let expected = "indices of componentType 5121, 5123 or 5125";
                return Err(Error::invalid(&self.path, place(index), expected, format!("{other:?}")));
            }
        };
        let size = match kind {
            Some(5121) => 1,
            Some(5123) => 2,
            _ => 4,
        };
        let rows = self.rows(index, sparse.indices.buffer_view, sparse.indices.byte_offset, [sparse.count, size])?;
        let indices: Vec<usize> = rows.read(0..sparse.count, read)?;
        match indices.iter().find(|at| **at >= count) {
            Some(at) => Err(Error::invalid(&self.path, place(index), format!("sparse indices below {count}"), at)),
            None => Ok(indices),
        }
    }

    /// `count` elements of `size` bytes, all within the view.
    fn rows(&self, index: usize, view: usize, offset: usize, [count, size]: [usize; 2]) -> Result<Rows<'_>> {
        let view = self.buffers.view(view)?;
        let stride = view.stride.unwrap_or(size);
        let end = (count.saturating_sub(1).checked_mul(stride))
            .and_then(|last| last.checked_add(offset)?.checked_add(if count == 0 { 0 } else { size }));
        if stride < size || end.is_none_or(|end| end > view.length) {
            let expected = format!("{count} elements of {size} bytes within the {} of its view", view.length);
            let found = format!("steps of {stride} from {offset}");
            return Err(Error::invalid(&self.path, place(index), expected, found));
        }
        Ok(Rows { view, offset, stride, size })
    }
}

/// Elements within a view.
struct Rows<'a> {
    view: View<'a>,
    offset: usize,
    stride: usize,
    size: usize,
}

impl Rows<'_> {
    /// Reads some elements, each from its bytes.
    fn read<T>(&self, wanted: Range<usize>, element: impl Fn(&[u8]) -> T) -> Result<Vec<T>> {
        let Some(last) = wanted.end.checked_sub(1).filter(|last| *last >= wanted.start) else { return Ok(Vec::new()) };
        let place = |row: usize| self.offset + row * self.stride;
        let bytes = self.view.part(place(wanted.start)..place(last) + self.size)?;
        Ok(bytes.chunks(self.stride).map(|row| element(&row[..self.size])).collect())
    }
}

fn place(index: usize) -> String {
    format!("accessors[{index}]")
}
