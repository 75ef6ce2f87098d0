//! `lite`: scenes of Gaussians in some hundred bits each.
//!
//! Positions lie on a grid and are coded as an octree. Everything else is rounded, in larger steps where a Gaussian is
//! less visible, and coded by [mixed models](crate::MixedModel) with contexts of neighbors and of earlier symbols of
//! the same Gaussian. Colors are transformed in space before ([`Raht`](crate::Raht)). Axes are exchanged and turned so
//! that a single one of the 24 rotations of an ellipsoid remains. Large scenes are cut into blocks, which are coded and
//! decoded at the same time; the first ones hold the Gaussians that show most, so that the beginning of a stream is a
//! picture of the scene.

mod blocks;
mod colors;
mod control;
mod fields;
mod head;
mod neighbors;
mod quality;
mod quantized;
mod restore;
mod rotation;
mod symbols;

use crate::container::{Container, Stream};
use crate::error::CodecError;
use blocks::{block_streams, decode_block};
use colors::Block;
use head::Head;
use quantized::{Quantized, quantize};
use rayon::prelude::*;
use restore::restore;
use weaver_geometry::sh;
use weaver_scene::Gaussians;

pub use control::order_zero_bits;
pub use quality::Quality;

/// Name of the stream that a decoder reads first.
const HEAD: [u8; 4] = *b"head";

/// Encodes Gaussians.
///
/// The same bytes at any number of threads.
///
/// # Errors
/// When fields have different lengths, or a number is not finite; logits may be infinite.
///
/// ```
/// use weaver_codec::lite::{Quality, decode, encode};
/// use weaver_scene::Gaussians;
///
/// let gaussians = Gaussians {
///     means: vec![[0.0, 0.0, 2.0]],
///     log_scales: vec![[-1.0, -2.0, -3.0]],
///     quats: vec![[1.0, 0.0, 0.0, 0.0]],
///     opacity_logits: vec![0.5],
///     sh: vec![0.1, 0.2, 0.3],
///     degree: 0,
/// };
/// let bytes = encode(&gaussians, &Quality::default())?;
/// let decoded = decode(&bytes)?;
/// assert!((decoded.sh[1] - 0.2).abs() < 0.04);
/// # Ok::<(), weaver_codec::CodecError>(())
/// ```
pub fn encode(gaussians: &Gaussians, quality: &Quality) -> Result<Vec<u8>, CodecError> {
    let Quantized { head, blocks, .. } = quantize(gaussians, quality)?;
    let code = |block: Block| block_streams(&head, block.symbols);
    let blocks: Vec<Vec<Stream>> = blocks.into_par_iter().map(code).collect::<Result<_, _>>()?;
    let mut streams = vec![Stream { name: HEAD, symbols: 1, bytes: head.write().into() }];
    streams.extend(blocks.into_iter().flatten());
    let coefficients = gaussians.coefficients() as u8;
    Ok(Container { gaussians: gaussians.len() as u64, coefficients, streams }.write())
}

/// The numbers of Gaussians in the order in which they are decoded.
///
/// # Errors
/// As [`encode`].
pub fn order(gaussians: &Gaussians, quality: &Quality) -> Result<Vec<usize>, CodecError> {
    Ok(quantize(gaussians, quality)?.order)
}

/// Gaussians as they come back from [`encode`] and [`decode`], without coding them.
///
/// # Errors
/// As [`encode`].
pub fn rounded(gaussians: &Gaussians, quality: &Quality) -> Result<Gaussians, CodecError> {
    let Quantized { head, blocks, .. } = quantize(gaussians, quality)?;
    Ok(restore(&head, &blocks, gaussians.degree))
}

/// Gaussians of the same pictures as by [`rounded`], in the order and with the axes of the given ones: training with
/// quantization draws these in their place.
///
/// # Errors
/// As [`encode`].
pub fn rounded_in_place(gaussians: &Gaussians, quality: &Quality) -> Result<Gaussians, CodecError> {
    let Quantized { head, blocks, order } = quantize(gaussians, quality)?;
    let sorted = restore(&head, &blocks, gaussians.degree);
    let mut placed = gaussians.clone();
    let row = 3 * gaussians.coefficients();
    for (at, &i) in order.iter().enumerate() {
        placed.means[i] = sorted.means[at];
        placed.opacity_logits[i] = sorted.opacity_logits[at];
        placed.sh[row * i..][..row].copy_from_slice(&sorted.sh[row * at..][..row]);
        (placed.log_scales[i], placed.quats[i]) = rotation::unsorted(
            (gaussians.log_scales[i], gaussians.quats[i]),
            (sorted.log_scales[at], sorted.quats[at]),
        );
    }
    Ok(placed)
}

/// Decodes Gaussians. Their order follows the blocks, within one Morton order.
///
/// # Errors
/// When bytes are of something else, are missing or changed, or decode to other than the Gaussians that are announced.
pub fn decode(bytes: &[u8]) -> Result<Gaussians, CodecError> {
    let container = Container::read(bytes)?;
    let gaussians = decode_streams(&container)?;
    if gaussians.len() as u64 != container.gaussians {
        return Err(CodecError::invalid("blocks", format!("{} Gaussians", container.gaussians), gaussians.len()));
    }
    Ok(gaussians)
}

/// Decodes the blocks that are complete in the beginning of a stream: those that show most come first.
///
/// # Errors
/// As [`decode`], without the missing streams at the end.
pub fn decode_start(bytes: &[u8]) -> Result<Gaussians, CodecError> {
    let mut container = Container::read_start(bytes)?;
    let complete = 1 + container.streams.len().saturating_sub(1) / blocks::STREAMS.len() * blocks::STREAMS.len();
    container.streams.truncate(complete);
    if container.streams.is_empty() {
        return Ok(Gaussians { degree: degree(&container)?, ..Gaussians::default() });
    }
    decode_streams(&container)
}

fn degree(container: &Container) -> Result<usize, CodecError> {
    let coefficients = container.coefficients;
    (0..=sh::MAX_DEGREE)
        .find(|&degree| sh::coefficients(degree) == usize::from(coefficients))
        .ok_or_else(|| CodecError::invalid("coefficients", "1, 4, 9, 16 or 25", coefficients))
}

fn decode_streams(container: &Container) -> Result<Gaussians, CodecError> {
    let degree = degree(container)?;
    let Some((first, streams)) = container.streams.split_first().filter(|(first, _)| first.name == HEAD) else {
        return Err(CodecError::invalid("streams", "head as the first one", "another or none"));
    };
    let head = Head::read(&first.bytes)?;
    let blocks: Vec<&[Stream]> = streams.chunks(blocks::STREAMS.len()).collect();
    // The total that all blocks announce, before any of it is allocated.
    let announced = blocks.iter().fold(0_u64, |sum, block| sum.saturating_add(block[0].symbols));
    if announced > container.gaussians {
        return Err(CodecError::invalid("blocks", format!("{} Gaussians", container.gaussians), announced));
    }
    let rest = usize::from(container.coefficients) - 1;
    let decoded: Vec<Block> =
        blocks.par_iter().map(|block| decode_block(&head, rest, block)).collect::<Result<_, _>>()?;
    Ok(restore(&head, &decoded, degree))
}
