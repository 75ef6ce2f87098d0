//! Blocks: Gaussians that are coded together, and their streams.

use super::colors::Block;
use super::fields::{BLENDS, Fields, positions};
use super::head::Head;
use super::symbols::{Symbols, ln_opacities};
use crate::container::Stream;
use crate::error::CodecError;
use crate::range::{CodeLength, Coder, RangeDecoder, RangeEncoder};
use weaver_kernels::simd;

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
    let stream = |name, bytes: Vec<u8>| Stream { name, symbols: count as u64, bytes: bytes.into() };
    let mut encoder = RangeEncoder::default();
    positions(&mut encoder, head, count, &symbols.voxels)?;
    let mut streams = vec![stream(STREAMS[0], encoder.finish())];
    let mut fields = Fields::new(*head, symbols);
    for name in [b"scal", b"opac"] {
        let blend = best_blend(name, |length, blend| code(&mut fields, name, length, blend))?;
        let mut encoder = RangeEncoder::default();
        code(&mut fields, name, &mut encoder, blend)?;
        streams.push(stream(*name, encoder.finish()));
    }
    fields.see()?;
    let last = last_streams(&mut fields, |fields, name, values| {
        let mut encoder = RangeEncoder::default();
        code_last(fields, name, &mut encoder, values)?;
        Ok(encoder.finish())
    })?;
    streams.extend(STREAMS[3..].iter().zip(last).map(|(name, bytes)| stream(*name, bytes)));
    Ok(streams)
}

/// The share of neighbors in predictions that gives the shortest code.
fn best_blend(
    name: &[u8; 4],
    mut code: impl FnMut(&mut CodeLength, u32) -> Result<(), CodecError>,
) -> Result<u32, CodecError> {
    let mut best = (f64::INFINITY, 0);
    for blend in 0..=if blends(name) { BLENDS } else { 0 } {
        let mut length = CodeLength::default();
        if blends(name) {
            code(&mut length, blend)?;
        }
        best = if length.bits < best.0 { (length.bits, blend) } else { best };
    }
    Ok(best.1)
}

/// Codes the streams that need the first three and not each other, at the same time.
fn last_streams<T: Send>(
    fields: &mut Fields,
    code: impl Fn(&Fields, &[u8; 4], &mut [[i32; 3]]) -> Result<T, CodecError> + Sync,
) -> Result<[T; 3], CodecError> {
    let symbols = &mut fields.symbols;
    let mut rotations = std::mem::take(&mut symbols.rotations);
    let mut colors = std::mem::take(&mut symbols.colors);
    let mut harmonics = std::mem::take(&mut symbols.harmonics);
    let shared = &*fields;
    // Harmonics are most of the work.
    let (last, (first, second)) = rayon::join(
        || code(shared, &STREAMS[5], &mut harmonics),
        || rayon::join(|| code(shared, &STREAMS[3], &mut rotations), || code(shared, &STREAMS[4], &mut colors)),
    );
    (fields.symbols.rotations, fields.symbols.colors, fields.symbols.harmonics) = (rotations, colors, harmonics);
    Ok([first?, second?, last?])
}

/// True if a stream has a prediction from neighbors, and says by how much.
fn blends(name: &[u8; 4]) -> bool {
    name == b"scal"
}

fn blend_of(name: &[u8; 4], coder: &mut impl Coder, blend: u32) -> u32 {
    if blends(name) { coder.raw(3, blend).min(BLENDS) } else { 0 }
}

fn code(fields: &mut Fields, name: &[u8; 4], coder: &mut impl Coder, blend: u32) -> Result<(), CodecError> {
    let blend = blend_of(name, coder, blend);
    simd::dispatch(
        #[inline(always)]
        || if name == b"scal" { fields.scales(coder, blend) } else { fields.opacities(coder) },
    )
}

fn code_last(
    fields: &Fields,
    name: &[u8; 4],
    coder: &mut impl Coder,
    values: &mut [[i32; 3]],
) -> Result<(), CodecError> {
    simd::dispatch(
        #[inline(always)]
        || match name {
            b"rota" => fields.rotations(coder, values),
            b"colo" => fields.colors(coder, values),
            _ => fields.harmonics(coder, values),
        },
    )
}

/// Decodes a block; `rest` is the number of harmonics beyond the first.
pub(super) fn decode_block(head: &Head, rest: usize, streams: &[Stream]) -> Result<Block, CodecError> {
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
    for stream in &streams[1..3] {
        let mut decoder = RangeDecoder::new(&stream.bytes);
        code(&mut fields, &stream.name, &mut decoder, 0)?;
        whole(&decoder, stream.name)?;
    }
    let raht = fields.see()?;
    let bytes = |name: &[u8; 4]| STREAMS.iter().position(|other| other == name).map_or(&[][..], |i| &*streams[i].bytes);
    last_streams(&mut fields, |fields, name, values| {
        let mut decoder = RangeDecoder::new(bytes(name));
        code_last(fields, name, &mut decoder, values)?;
        whole(&decoder, *name)
    })?;
    Ok(Block { symbols: fields.symbols, raht })
}

fn whole(decoder: &RangeDecoder, name: [u8; 4]) -> Result<(), CodecError> {
    if decoder.is_whole() {
        return Ok(());
    }
    Err(CodecError::invalid(format!("stream {}", name.escape_ascii()), "no byte behind the last symbol", "more"))
}
