//! Files of pictures: independent blocks of symbols, and their extents.

use crate::blocks::{divide, extent, meets};
use crate::error::{ImageError, invalid};
use crate::fit::Fitted;
use crate::gaussians::Gaussians;
use crate::rounding::{Grid, Parts, Symbols, class};
use crate::settings::Descent;
use crate::symbols::{Models, WEIGHTS};
use crate::window::Window;
use rayon::prelude::*;
use std::ops::Range;
use weaver_codec::{
    CodeLength, CodecError, Container, Extent, GAUSSIANS_PER_BYTE, Layout, RangeDecoder, RangeEncoder, Stream,
};

/// Names of the streams.
const HEAD: [u8; 4] = *b"pict";
const SYMBOLS: [u8; 4] = *b"gaus";
/// Bytes of the head before the blocks: width, height, kind of cut, weights of the colors' predictions.
const HEAD_BYTES: usize = 10;
/// Bytes of the extent of a block.
const PLACE_BYTES: usize = 16;
/// Most Gaussians of a block.
const BLOCK: usize = 4096;
/// Length of the first read of a file; usually it holds the header.
const FIRST: u64 = 4096;

/// A decoded picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Coded {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The Gaussians, and their cut.
    pub fitted: Fitted,
}

/// The bytes of a file of a picture, its numbers rounded to symbols. A [`coded`](crate::FitSettings::coded) fit is
/// already rounded, up to floating-point error.
///
/// The layout is in docs/reference/wgi.md of the repository.
///
/// # Errors
/// Gaussians that [`Gaussians::check`] refuses, a picture without pixels or with more than 2^28.
///
/// ```
/// use std::ops::ControlFlow;
/// use weaver_image::{FitSettings, Picture, decode, encode, fit};
/// let picture = Picture::new(32, 24, (0..32 * 24 * 3).map(|i| (i % 96) as f32 / 96.0).collect())?;
/// let mut settings = FitSettings::new(12, 50);
/// settings.coded = true;
/// let fitted = fit(&picture, &settings, &mut |_| ControlFlow::Continue(()))?;
/// let bytes = encode(&fitted, 32, 24)?;
/// let back = decode(&bytes)?;
/// assert!(bytes.len() < 200 && back.fitted.gaussians.len() == 12);
/// # Ok::<(), weaver_image::ImageError>(())
/// ```
pub fn encode(fitted: &Fitted, width: usize, height: usize) -> Result<Vec<u8>, ImageError> {
    encode_in_blocks(fitted, width, height, BLOCK)
}

/// As [`encode`], in blocks of at most `most` Gaussians: smaller blocks mean fewer bytes for a region, and a longer
/// file.
///
/// # Errors
/// As [`encode`].
pub fn encode_in_blocks(fitted: &Fitted, width: usize, height: usize, most: usize) -> Result<Vec<u8>, ImageError> {
    fitted.gaussians.check()?;
    Window::whole(width, height).check()?;
    let grid = Grid { size: [width, height] };
    let symbols = (0..fitted.gaussians.len()).map(|i| grid.symbols(&fitted.gaussians, i)).collect();
    let blocks = divide(&grid, symbols, most.max(1));
    let weights = weights(grid, &blocks)?;
    let mut head = Vec::with_capacity(HEAD_BYTES + PLACE_BYTES * blocks.len());
    head.extend((width as u32).to_le_bytes());
    head.extend((height as u32).to_le_bytes());
    head.push(u8::from(fitted.cut != Descent::Squared.cut()));
    head.push((weights[0] | weights[1] << 2 | weights[2] << 4) as u8);
    if blocks.len() > 1 {
        let places = blocks.iter().flat_map(|block| extent(&grid, block, fitted.cut));
        places.for_each(|number| head.extend(number.to_le_bytes()));
    }
    let coded = blocks.par_iter().map(|block| {
        let mut encoder = RangeEncoder::default();
        Models::new(grid, weights).code(&mut encoder, block, block.len())?;
        Ok(Stream { name: SYMBOLS, symbols: block.len() as u64, bytes: encoder.finish().into() })
    });
    let mut streams = vec![Stream { name: HEAD, symbols: 1, bytes: head.into() }];
    streams.extend(coded.collect::<Result<Vec<_>, ImageError>>()?);
    Ok(Container { gaussians: fitted.gaussians.len() as u64, coefficients: 0, streams }.write())
}

/// The weights of predictions with the shortest blocks, one channel after the other.
fn weights(grid: Grid, blocks: &[Vec<Symbols>]) -> Result<[usize; 3], ImageError> {
    let mut weights = [0; 3];
    for channel in 0..3 {
        let mut least = f64::INFINITY;
        let mut best = 0;
        for weight in 0..WEIGHTS.len() {
            weights[channel] = weight;
            let lengths = blocks.par_iter().map(|block| {
                let mut length = CodeLength::default();
                Models::new(grid, weights).code(&mut length, block, block.len()).map(|_| length.bits)
            });
            let bits: f64 = lengths.collect::<Result<Vec<_>, ImageError>>()?.iter().sum();
            if bits < least {
                (least, best) = (bits, weight);
            }
        }
        weights[channel] = best;
    }
    Ok(weights)
}

/// Decodes the bytes of [`encode`].
///
/// # Errors
/// Bytes of no picture or of a later version; missing, surplus or changed bytes; symbols out of range.
pub fn decode(bytes: &[u8]) -> Result<Coded, ImageError> {
    let container = Container::read(bytes)?;
    let streams = container.streams.iter().map(|stream| (stream.name, stream.symbols));
    check_streams(container.gaussians, streams)?;
    let head = Head::read(&container.streams[0].bytes, container.gaussians, container.streams.len() - 1)?;
    let blocks: Vec<(&[u8], u64)> = container.streams[1..].iter().map(|s| (&*s.bytes, s.symbols)).collect();
    head.decode(&blocks)
}

/// Decodes the Gaussians of a window of the picture: only the blocks that meet it. Drawn there, they have the bits of
/// the whole.
///
/// `read` returns bytes of the file, whose length is `length`. Drawing the window at a smaller size takes a larger
/// window, since Gaussians then widen ([`Window::around`]).
///
/// # Errors
/// As [`decode`], for the blocks that are read; bytes that cannot be read.
///
/// ```
/// use weaver_image::{CUT, Fitted, Gaussians, Window, decode_region, encode_in_blocks};
/// let mut gaussians = Gaussians::default();
/// (0..100).for_each(|i| gaussians.push([10.0 * i as f32, 8.0], [2.0, 2.0], 0.0, [0.5; 3]));
/// let bytes = encode_in_blocks(&Fitted { gaussians, cut: CUT, reset: 0 }, 1000, 16, 10)?;
/// let mut read = |range: std::ops::Range<u64>| Ok(bytes[range.start as usize..range.end as usize].to_vec());
/// let window = Window { x: 500, y: 0, width: 20, height: 16 };
/// let part = decode_region(bytes.len() as u64, &mut read, window)?;
/// assert!(part.width == 1000 && part.fitted.gaussians.len() < 30);
/// # Ok::<(), weaver_image::ImageError>(())
/// ```
pub fn decode_region(
    length: u64,
    read: &mut dyn FnMut(Range<u64>) -> std::io::Result<Vec<u8>>,
    window: Window,
) -> Result<Coded, ImageError> {
    let (mut front, mut known) = (Vec::new(), 0);
    let layout = loop {
        let next = (4 * known).max(FIRST).min(length);
        front.extend(read(known..next)?);
        known = next;
        match Layout::read(&front) {
            Err(CodecError::Ended { .. }) if known < length => {}
            layout => break layout?,
        }
    };
    if layout.end > length || layout.gaussians > GAUSSIANS_PER_BYTE.saturating_mul(length) {
        return Err(invalid("file", format!("{} bytes", layout.end), length));
    }
    check_streams(layout.gaussians, layout.streams.iter().map(|extent| (extent.name, extent.symbols)))?;
    let mut part = |extent: &Extent| -> Result<Vec<u8>, ImageError> {
        let Range { start, end } = extent.bytes;
        // No byte is read twice.
        let mut bytes = front[front.len().min(start as usize)..front.len().min(end as usize)].to_vec();
        let missing = start + bytes.len() as u64..end;
        if !missing.is_empty() {
            bytes.extend(read(missing)?);
        }
        extent.check(&bytes)?;
        Ok(bytes)
    };
    let [first, blocks @ ..] = &layout.streams[..] else { return Err(foreign(&[])) };
    let head = Head::read(&part(first)?, layout.gaussians, blocks.len())?;
    let near = blocks.iter().zip(0..).filter(|(_, i)| head.places.get(*i).is_none_or(|place| meets(place, &window)));
    let found: Vec<(Vec<u8>, u64)> =
        near.map(|(extent, _)| Ok((part(extent)?, extent.symbols))).collect::<Result<_, ImageError>>()?;
    head.decode(&found.iter().map(|(bytes, symbols)| (&bytes[..], *symbols)).collect::<Vec<_>>())
}

/// Checks the names of streams, and that their symbols add up to the number of Gaussians.
fn check_streams(gaussians: u64, streams: impl Iterator<Item = ([u8; 4], u64)>) -> Result<(), ImageError> {
    let streams: Vec<([u8; 4], u64)> = streams.collect();
    let names: Vec<[u8; 4]> = streams.iter().map(|stream| stream.0).collect();
    if names.len() < 2 || names[0] != HEAD || names[1..].iter().any(|name| *name != SYMBOLS) {
        return Err(foreign(&names));
    }
    let sum = streams[1..].iter().try_fold(0_u64, |sum, stream| sum.checked_add(stream.1));
    match sum {
        Some(sum) if sum == gaussians => Ok(()),
        _ => {
            Err(invalid("Gaussians of all blocks", gaussians, sum.map_or("2^64 or more".into(), |sum| sum.to_string())))
        }
    }
}

fn foreign(names: &[[u8; 4]]) -> ImageError {
    let found: Vec<String> = names.iter().take(4).map(|name| name.escape_ascii().to_string()).collect();
    invalid("streams", "those of a picture, pict and then gaus", found.join(" "))
}

/// Head of a file.
struct Head {
    grid: Grid,
    cut: f64,
    weights: [usize; 3],
    /// Extents of several blocks: see [`extent`]; empty for one.
    places: Vec<[u32; 4]>,
}

impl Head {
    fn read(head: &[u8], gaussians: u64, blocks: usize) -> Result<Self, ImageError> {
        let places = if blocks > 1 { blocks } else { 0 };
        let expected = HEAD_BYTES + PLACE_BYTES * places;
        if head.len() != expected {
            return Err(invalid("bytes of the head of a picture", expected, head.len()));
        }
        let number = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
        let (width, height) = (number(0) as usize, number(4) as usize);
        let window = Window::whole(width, height);
        window.check()?;
        // The container has at least a byte for eight Gaussians, so that they fit into memory.
        if gaussians > window.pixels() as u64 {
            let most = format!("at most {}, its pixels", window.pixels());
            return Err(invalid("Gaussians of a picture", most, gaussians));
        }
        let descent = match head[8] {
            0 => Descent::Squared,
            1 => Descent::Published,
            other => return Err(invalid("cut of a picture", "0 or 1", other)),
        };
        let place = |block: usize| [0, 1, 2, 3].map(|k| number(HEAD_BYTES + PLACE_BYTES * block + 4 * k));
        Ok(Self {
            grid: Grid { size: [width, height] },
            cut: descent.cut(),
            weights: [0, 2, 4].map(|shift| usize::from(head[9] >> shift & 3)),
            places: (0..places).map(place).collect(),
        })
    }

    /// The Gaussians of blocks, given as bytes and numbers of symbols.
    fn decode(&self, blocks: &[(&[u8], u64)]) -> Result<Coded, ImageError> {
        let found = blocks.par_iter().map(|(bytes, count)| self.block(bytes, *count as usize));
        let found = found.collect::<Result<Vec<_>, ImageError>>()?;
        let mut gaussians = Gaussians::zeros(found.iter().map(Vec::len).sum());
        for (i, symbols) in found.iter().flatten().enumerate() {
            self.grid.write(symbols, &mut gaussians, i, Parts { shape: true, position: true, color: true });
        }
        let [width, height] = self.grid.size;
        Ok(Coded { width, height, fitted: Fitted { gaussians, cut: self.cut, reset: 0 } })
    }

    fn block(&self, bytes: &[u8], count: usize) -> Result<Vec<Symbols>, ImageError> {
        let mut decoder = RangeDecoder::new(bytes);
        let found = Models::new(self.grid, self.weights).code(&mut decoder, &[], count)?;
        if !decoder.is_whole() {
            return Err(invalid("stream gaus", "symbols that fill it", format!("others in {} bytes", bytes.len())));
        }
        for symbols in &found {
            let last = [0, 1].map(|axis| self.grid.last(class(symbols.scale), axis));
            if (0..2).any(|axis| symbols.position[axis] > last[axis]) {
                let (expected, found) = (format!("up to {last:?}"), format!("{:?}", symbols.position));
                return Err(invalid("position of a Gaussian", expected, found));
            }
        }
        Ok(found)
    }
}
