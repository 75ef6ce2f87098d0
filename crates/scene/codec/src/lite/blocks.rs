//! Blocks: Gaussians that are coded together, and their streams.

use super::fields::{BLENDS, Fields, positions};
use super::head::Head;
use super::symbols::{Symbols, ln_opacities};
use crate::container::Stream;
use crate::error::CodecError;
use crate::range::{CodeLength, Coder, RangeDecoder, RangeEncoder};

/// Gaussians of a block at most.
const BLOCK: usize = 1 << 16;

/// Gaussians of a scene from which on those that show most come first, and their share of all.
const LAYERED: usize = 1 << 15;
const FIRST_SHARE: usize = 12;

/// Streams of a block, in their order.
pub(super) const STREAMS: [[u8; 4]; 6] = [*b"posi", *b"scal", *b"opac", *b"rota", *b"colo", *b"harm"];

/// Index sets of all blocks, each ascending.
pub(super) fn split(head: &Head, symbols: &Symbols) -> Vec<Vec<usize>> {
    let count = symbols.voxels.len();
    let mut layers = vec![(0..count).collect::<Vec<_>>()];
    if count >= LAYERED {
        let logs = ln_opacities(head.opacity_levels);
        let shows = |i: usize| head.shows(symbols.scales[i], symbols.opacities[i], &logs);
        layers[0].sort_by_key(|&i| std::cmp::Reverse(shows(i)));
        let rest = layers[0].split_off(count / FIRST_SHARE);
        layers.push(rest);
        layers.iter_mut().for_each(|layer| layer.sort_unstable());
    }
    layers.iter().flat_map(|layer| layer.chunks(BLOCK)).map(<[usize]>::to_vec).collect()
}

/// Encodes a block.
pub(super) fn block_streams(head: &Head, symbols: Symbols) -> Result<Vec<Stream<'static>>, CodecError> {
    let count = symbols.voxels.len();
    let stream = |name, coder: RangeEncoder| Stream { name, symbols: count as u64, bytes: coder.finish().into() };
    let mut encoder = RangeEncoder::default();
    positions(&mut encoder, head, count, &symbols.voxels)?;
    let mut streams = vec![stream(STREAMS[0], encoder)];
    let mut fields = Fields::new(*head, symbols);
    for &name in &STREAMS[1..] {
        let blend = best_blend(&mut fields, name)?;
        let mut encoder = RangeEncoder::default();
        code(&mut fields, name, &mut encoder, blend)?;
        streams.push(stream(name, encoder));
    }
    Ok(streams)
}

/// The share of neighbors in predictions that gives the shortest code.
fn best_blend(fields: &mut Fields, name: [u8; 4]) -> Result<u32, CodecError> {
    let mut best = (f64::INFINITY, 0);
    for blend in 0..=if blends(name) { BLENDS } else { 0 } {
        let mut length = CodeLength::default();
        if blends(name) {
            code(fields, name, &mut length, blend)?;
        }
        best = if length.bits < best.0 { (length.bits, blend) } else { best };
    }
    Ok(best.1)
}

/// True if a stream has a prediction from neighbors, and says by how much.
fn blends(name: [u8; 4]) -> bool {
    matches!(&name, b"scal" | b"colo")
}

fn code(fields: &mut Fields, name: [u8; 4], coder: &mut impl Coder, blend: u32) -> Result<(), CodecError> {
    let blend = if blends(name) { coder.raw(3, blend).min(BLENDS) } else { 0 };
    match &name {
        b"scal" => fields.scales(coder, blend),
        b"opac" => fields.opacities(coder),
        b"rota" => fields.rotations(coder),
        b"colo" => fields.colors(coder, blend),
        _ => fields.harmonics(coder),
    }
}

/// Decodes a block; `rest` is the number of harmonics beyond the first.
pub(super) fn decode_block(head: &Head, rest: usize, streams: &[Stream]) -> Result<Symbols, CodecError> {
    let names: Vec<[u8; 4]> = streams.iter().map(|stream| stream.name).collect();
    let count = streams[0].symbols;
    if names != STREAMS || streams.iter().any(|stream| stream.symbols != count) {
        let found: Vec<String> =
            streams.iter().map(|stream| format!("{} of {}", stream.name.escape_ascii(), stream.symbols)).collect();
        return Err(CodecError::invalid("block", "posi, scal, opac, rota, colo, harm of one number", found.join(", ")));
    }
    let count = usize::try_from(count).unwrap_or(usize::MAX);
    let mut decoder = RangeDecoder::new(&streams[0].bytes);
    let voxels = positions(&mut decoder, head, count, &[])?;
    whole(&decoder, STREAMS[0])?;
    let mut fields = Fields::new(*head, Symbols::at(voxels, rest));
    for stream in &streams[1..] {
        let mut decoder = RangeDecoder::new(&stream.bytes);
        code(&mut fields, stream.name, &mut decoder, 0)?;
        whole(&decoder, stream.name)?;
    }
    Ok(fields.symbols)
}

fn whole(decoder: &RangeDecoder, name: [u8; 4]) -> Result<(), CodecError> {
    if decoder.is_whole() {
        return Ok(());
    }
    Err(CodecError::invalid(format!("stream {}", name.escape_ascii()), "no byte behind the last symbol", "more"))
}
