//! `lite`: scenes of Gaussians in a hundred bits each.

mod fields;
mod head;
mod neighbors;
mod quality;
mod rotation;
mod symbols;

use crate::container::{Container, Stream};
use crate::error::CodecError;
use crate::range::{CodeLength, RangeDecoder, RangeEncoder};
use fields::{BLENDS, Fields, positions};
use head::Head;
use symbols::{Symbols, quantize, restore};
use weaver_geometry::sh;
use weaver_scene::Gaussians;

pub use quality::Quality;

/// Streams behind the head and the positions: name, and whether predictions are blended.
const STREAMS: [([u8; 4], bool); 5] =
    [(*b"scal", true), (*b"opac", false), (*b"rota", false), (*b"colo", true), (*b"harm", false)];

/// Encodes Gaussians.
///
/// # Errors
/// When fields have different lengths, or a number is not finite; logits may be infinite.
pub fn encode(gaussians: &Gaussians, quality: &Quality) -> Result<Vec<u8>, CodecError> {
    let (head, symbols) = quantize(gaussians, quality)?;
    let count = gaussians.len();
    let mut encoder = RangeEncoder::default();
    positions(&mut encoder, &head, count, &symbols.voxels)?;
    let stream = |name, bytes: Vec<u8>| Stream { name, symbols: count as u64, bytes: bytes.into() };
    let mut streams = vec![stream(*b"head", head.write()), stream(*b"posi", encoder.finish())];
    let mut fields = Fields::new(head, symbols);
    for (name, blends) in STREAMS {
        let mut best = (0, f64::INFINITY);
        for blend in 0..=if blends { BLENDS } else { 0 } {
            let mut length = CodeLength::default();
            code(&mut fields, name, &mut length, blend)?;
            if length.bits < best.1 {
                best = (blend, length.bits);
            }
        }
        let mut encoder = RangeEncoder::default();
        crate::range::Coder::raw(&mut encoder, 3, best.0);
        code(&mut fields, name, &mut encoder, best.0)?;
        streams.push(stream(name, encoder.finish()));
    }
    Container { gaussians: count as u64, coefficients: gaussians.coefficients() as u8, streams }.write()
}

fn code(
    fields: &mut Fields,
    name: [u8; 4],
    coder: &mut impl crate::range::Coder,
    blend: u32,
) -> Result<(), CodecError> {
    match &name {
        b"scal" => fields.scales(coder, blend),
        b"opac" => fields.opacities(coder, blend),
        b"rota" => fields.rotations(coder, blend),
        b"colo" => fields.colors(coder, blend),
        _ => fields.harmonics(coder, blend),
    }
}

/// Decodes Gaussians; they are in Morton order.
///
/// # Errors
/// When bytes are of something else, are missing or changed, or decode to other than the Gaussians that are announced.
pub fn decode(bytes: &[u8]) -> Result<Gaussians, CodecError> {
    let container = Container::read(bytes)?;
    let degree = (0..=sh::MAX_DEGREE).find(|&degree| sh::coefficients(degree) == usize::from(container.coefficients));
    let degree =
        degree.ok_or_else(|| CodecError::invalid("coefficients", "1, 4, 9, 16 or 25", container.coefficients))?;
    let count = usize::try_from(container.gaussians).unwrap_or(usize::MAX);
    let mut streams = container.streams.iter();
    let mut next = |name: [u8; 4]| {
        let found = streams.next();
        found.filter(|stream| stream.name == name && stream.symbols == container.gaussians).ok_or_else(|| {
            let found = found.map_or("none".into(), |s| format!("{} of {}", s.name.escape_ascii(), s.symbols));
            CodecError::invalid("streams", format!("{} of {count}", name.escape_ascii()), found)
        })
    };
    let head = Head::read(&next(*b"head")?.bytes)?;
    let mut decoder = RangeDecoder::new(&next(*b"posi")?.bytes);
    let voxels = positions(&mut decoder, &head, count, &[])?;
    whole(&decoder, *b"posi")?;
    let symbols = Symbols {
        voxels,
        scales: vec![[0; 3]; count],
        opacities: vec![0; count],
        rotations: vec![[0; 3]; count],
        colors: vec![[0; 3]; count],
        harmonics: vec![[0; 3]; count * (usize::from(container.coefficients) - 1)],
    };
    let mut fields = Fields::new(head, symbols);
    for (name, _) in STREAMS {
        let stream = next(name)?;
        let mut decoder = RangeDecoder::new(&stream.bytes);
        let blend = crate::range::Coder::raw(&mut decoder, 3, 0).min(BLENDS);
        code(&mut fields, name, &mut decoder, blend)?;
        whole(&decoder, name)?;
    }
    Ok(restore(&fields.head, &fields.symbols, degree))
}

fn whole(decoder: &RangeDecoder, name: [u8; 4]) -> Result<(), CodecError> {
    if decoder.is_whole() {
        return Ok(());
    }
    Err(CodecError::invalid(format!("stream {}", name.escape_ascii()), "no byte behind the last symbol", "more"))
}
