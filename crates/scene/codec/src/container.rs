//! The container: a header with a table of streams, then their bytes, each with a checksum.

use crate::error::CodecError;
use crc32c::crc32c;

/// First bytes of a container.
pub const MAGIC: [u8; 4] = *b"WVSZ";

/// The version that is written.
pub const VERSION: u8 = 1;

/// Gaussians that a byte may stand for: a bound on the memory that a small file can request.
pub const GAUSSIANS_PER_BYTE: u64 = 8;

/// A part of a container: symbols of one kind, coded together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stream<'a> {
    /// Kind of the symbols, ASCII.
    pub name: [u8; 4],
    /// Number of symbols.
    pub symbols: u64,
    /// The coded symbols.
    pub bytes: std::borrow::Cow<'a, [u8]>,
}

/// Streams of a scene, and the sizes that they are for.
///
/// ```
/// use weaver_codec::{Container, Stream};
///
/// let stream = Stream { name: *b"opac", symbols: 3, bytes: vec![1, 2].into() };
/// let container = Container { gaussians: 3, coefficients: 1, streams: vec![stream] };
/// let bytes = container.write();
/// assert_eq!(Container::read(&bytes)?, container);
/// assert!(Container::read(&bytes[..bytes.len() - 1]).is_err());
/// // The header and the streams that are there already.
/// assert_eq!(Container::read_start(&bytes[..bytes.len() - 1])?.streams.len(), 0);
/// # Ok::<(), weaver_codec::CodecError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Container<'a> {
    /// Number of Gaussians, `N`.
    pub gaussians: u64,
    /// Coefficients of spherical harmonics of each color, `K`.
    pub coefficients: u8,
    /// Streams, in the order of a decoder.
    pub streams: Vec<Stream<'a>>,
}

impl<'a> Container<'a> {
    /// The bytes: at least one for eight Gaussians, which zeros behind the streams see to.
    pub fn write(&self) -> Vec<u8> {
        let mut out = MAGIC.to_vec();
        out.extend([VERSION, self.coefficients]);
        put(&mut out, self.gaussians);
        put(&mut out, self.streams.len() as u64);
        for stream in &self.streams {
            out.extend(stream.name);
            put(&mut out, stream.symbols);
            put(&mut out, stream.bytes.len() as u64);
            out.extend(crc32c(&stream.bytes).to_le_bytes());
        }
        let sum = crc32c(&out);
        out.extend(sum.to_le_bytes());
        self.streams.iter().for_each(|stream| out.extend(&*stream.bytes));
        let least = usize::try_from(self.gaussians.div_ceil(GAUSSIANS_PER_BYTE)).unwrap_or(usize::MAX);
        out.resize(out.len().max(least), 0);
        out
    }

    /// Reads a whole container.
    ///
    /// # Errors
    /// When bytes are of something else or of a later version, are missing, left over or changed, or are fewer than one
    /// for eight Gaussians.
    pub fn read(bytes: &'a [u8]) -> Result<Self, CodecError> {
        let (container, missing) = Self::parse(bytes)?;
        let least = container.gaussians.div_ceil(GAUSSIANS_PER_BYTE);
        if (bytes.len() as u64) < least {
            let place = format!("container of {} Gaussians", container.gaussians);
            return Err(CodecError::Ended { place, expected: least, found: bytes.len() as u64 });
        }
        missing.map_or(Ok(container), Err)
    }

    /// Reads the complete streams, from the first one on: `bytes` are the beginning of a container.
    ///
    /// # Errors
    /// As [`Container::read`], but for bytes that are missing behind the header.
    pub fn read_start(bytes: &'a [u8]) -> Result<Self, CodecError> {
        Ok(Self::parse(bytes)?.0)
    }

    /// The complete streams, and the error of the first incomplete one.
    fn parse(bytes: &'a [u8]) -> Result<(Self, Option<CodecError>), CodecError> {
        let Layout { gaussians, coefficients, streams, end } = Layout::read(bytes)?;
        let mut container = Self { gaussians, coefficients, streams: Vec::new() };
        for extent in streams {
            let (first, length) = (extent.bytes.start, extent.bytes.end - extent.bytes.start);
            let found = bytes.len() as u64 - first;
            if found < length {
                return Ok((container, Some(CodecError::Ended { place: extent.place(), expected: length, found })));
            }
            let part = &bytes[first as usize..(first + length) as usize];
            extent.check(part)?;
            container.streams.push(Stream { name: extent.name, symbols: extent.symbols, bytes: part.into() });
        }
        // Remaining bytes may only fill up to the least size.
        let rest = &bytes[end as usize..];
        let least = gaussians.div_ceil(GAUSSIANS_PER_BYTE);
        if !rest.is_empty() && (bytes.len() as u64 > least || rest.iter().any(|&byte| byte != 0)) {
            return Err(CodecError::invalid(
                "container",
                "nothing behind the streams",
                format!("{} bytes", rest.len()),
            ));
        }
        Ok((container, None))
    }
}

/// The header of a container: where its streams lie, for those who read some of them.
///
/// ```
/// use weaver_codec::{Container, Layout, Stream};
/// let stream = |name, bytes: &[u8]| Stream { name, symbols: 1, bytes: bytes.to_vec().into() };
/// let streams = vec![stream(*b"aaaa", &[1, 2]), stream(*b"bbbb", &[3])];
/// let bytes = Container { gaussians: 1, coefficients: 0, streams }.write();
/// let layout = Layout::read(&bytes[..bytes.len() - 3])?;
/// let second = layout.streams[1].bytes.clone();
/// assert_eq!(bytes[second.start as usize..second.end as usize], [3]);
/// layout.streams[1].check(&[3])?;
/// # Ok::<(), weaver_codec::CodecError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Number of Gaussians, `N`.
    pub gaussians: u64,
    /// Coefficients of spherical harmonics of each color, `K`.
    pub coefficients: u8,
    /// Streams, in the order of a decoder.
    pub streams: Vec<Extent>,
    /// The byte behind the last stream.
    pub end: u64,
}

/// The place of a stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Kind of the symbols, ASCII.
    pub name: [u8; 4],
    /// Number of symbols.
    pub symbols: u64,
    /// Its bytes, counted from the container's first.
    pub bytes: std::ops::Range<u64>,
    sum: u32,
}

impl Layout {
    /// Reads a header from the beginning of a container.
    ///
    /// # Errors
    /// Bytes of something else, of a later version or changed; [`CodecError::Ended`] where there are fewer than the
    /// header has.
    pub fn read(start: &[u8]) -> Result<Self, CodecError> {
        let mut header = Header { bytes: start, at: 0 };
        if !start.starts_with(&MAGIC) {
            let found = start.iter().copied().take(MAGIC.len()).collect();
            return Err(CodecError::Foreign { expected: MAGIC, found });
        }
        header.take::<4>()?;
        let [version, coefficients] = header.take()?;
        if version != VERSION {
            return Err(CodecError::Version { expected: VERSION, found: version });
        }
        let (gaussians, count) = (header.number()?, header.number()?);
        let mut table = Vec::new();
        for _ in 0..count {
            table.push((header.take::<4>()?, header.number()?, header.number()?, header.word()?));
        }
        let sum = crc32c(&start[..header.at]);
        check("header", header.word()?, sum)?;
        let mut end = header.at as u64;
        let mut streams = Vec::with_capacity(table.len());
        for (name, symbols, length, sum) in table {
            let first = end;
            let behind = first.checked_add(length);
            end = behind.ok_or_else(|| CodecError::invalid("header", "streams of fewer than 2^64 bytes", length))?;
            streams.push(Extent { name, symbols, bytes: first..end, sum });
        }
        Ok(Self { gaussians, coefficients, streams, end })
    }
}

impl Extent {
    fn place(&self) -> String {
        format!("stream {}", self.name.escape_ascii())
    }

    /// Compares bytes with the checksum.
    ///
    /// # Errors
    /// When they are others.
    pub fn check(&self, bytes: &[u8]) -> Result<(), CodecError> {
        check(&self.place(), self.sum, crc32c(bytes))
    }
}

/// A header that is being read.
struct Header<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Header<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], CodecError> {
        let rest = &self.bytes[self.at..];
        let ended = || CodecError::Ended { place: "header".into(), expected: N as u64, found: rest.len() as u64 };
        let taken = *rest.first_chunk().ok_or_else(ended)?;
        self.at += N;
        Ok(taken)
    }

    fn word(&mut self) -> Result<u32, CodecError> {
        Ok(u32::from_le_bytes(self.take()?))
    }

    /// A number in groups of seven bits, the lowest first; the highest bit of a byte says that there are more.
    fn number(&mut self) -> Result<u64, CodecError> {
        let mut number = 0;
        for shift in (0..63).step_by(7) {
            let [byte] = self.take()?;
            number |= u64::from(byte & 127) << shift;
            if byte < 128 {
                return Ok(number);
            }
        }
        Err(CodecError::invalid(format!("byte {}", self.at), "a number below 2^63", "more than nine bytes"))
    }
}

fn put(out: &mut Vec<u8>, mut number: u64) {
    while number > 127 {
        out.push(number as u8 | 128);
        number >>= 7;
    }
    out.push(number as u8);
}

fn check(place: &str, expected: u32, found: u32) -> Result<(), CodecError> {
    if expected == found { Ok(()) } else { Err(CodecError::Checksum { place: place.into(), expected, found }) }
}
