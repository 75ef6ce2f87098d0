//! Properties of JPEG alone: its header describes the coding before its pixels, and it can be decoded at a reduced
//! scale.

use super::pixels::Pixels;
use super::profile::Profile;
use jpeg_decoder::{ColorTransform, Decoder, PixelFormat};
use std::fs::File;
use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::path::Path;

/// Segments of a JPEG before its first scan.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segments {
    /// True if all coefficients have to be held at once.
    pub progressive: bool,
    /// Where the first scan begins, behind its header, in bytes.
    pub end: u64,
    /// Conversion of its channels to colors, if it is gray or the conversion of nearly all photos.
    colors: Option<ColorTransform>,
}

/// Kinds of segments, the byte behind 0xff.
mod kind {
    pub const START: u8 = 0xd8;
    pub const SCAN: u8 = 0xda;
    pub const ADOBE: u8 = 0xee;
    pub const PROGRESSIVE: u8 = 0xc2;
    /// Frames that are decoded by Huffman's codes in one or several scans.
    pub const FRAMES: [u8; 3] = [0xc0, 0xc1, PROGRESSIVE];
}

impl Segments {
    /// Reads a file from its beginning up to its first scan; `None` if it is no JPEG, or one that is out of the
    /// ordinary.
    pub fn read(file: &mut (impl BufRead + Seek)) -> Option<Self> {
        let mut start = [0; 2];
        file.read_exact(&mut start).ok()?;
        if start != [0xff, kind::START] {
            return None;
        }
        let (mut frame, mut adobe) = (None, None);
        loop {
            let mut header = [0; 4];
            file.read_exact(&mut header).ok()?;
            let [0xff, segment, high, low] = header else { return None };
            let length = u16::from_be_bytes([high, low]).checked_sub(2)?;
            let next = file.stream_position().ok()? + u64::from(length);
            if kind::FRAMES.contains(&segment) || segment == kind::ADOBE {
                let mut content = vec![0; usize::from(length)];
                file.read_exact(&mut content).ok()?;
                if segment == kind::ADOBE {
                    adobe = content.get(11).copied();
                } else {
                    frame = Some((segment, content));
                }
            }
            file.seek(SeekFrom::Start(next)).ok()?;
            if segment == kind::SCAN {
                let (segment, frame) = frame?;
                let progressive = segment == kind::PROGRESSIVE;
                return Some(Self { progressive, end: next, colors: colors(&frame, adobe) });
            }
        }
    }

    /// True if [`decode`] can decode it.
    pub fn can_shrink(&self) -> bool {
        self.colors.is_some()
    }
}

/// The colors of a frame, whose header ends with three bytes for each channel: a name, how it is sampled, its table.
fn colors(frame: &[u8], adobe: Option<u8>) -> Option<ColorTransform> {
    let names: Vec<u8> = frame.get(6..)?.chunks_exact(3).map(|channel| channel[0]).collect();
    match names.len() {
        1 => Some(ColorTransform::Grayscale),
        3 if names != *b"RGB" && matches!(adobe, None | Some(1)) => Some(ColorTransform::YCbCr),
        _ => None,
    }
}

/// Decodes a photo so that `shrink` x `shrink` of its pixels, 2 or 4 each way, become one; `None` if that fails for any
/// reason.
///
/// `whole` is its width and height, for which memory is taken.
pub(super) fn decode(path: &Path, segments: Segments, whole: (usize, usize), shrink: usize) -> Option<Pixels> {
    let mut decoder = Decoder::new(BufReader::with_capacity(1 << 16, File::open(path).ok()?));
    decoder.set_color_transform(segments.colors?);
    decoder.read_info().ok()?;
    let info = decoder.info().filter(|info| (usize::from(info.width), usize::from(info.height)) == whole)?;
    let of = |side: u16| usize::from(side).div_ceil(shrink) as u16;
    let (width, height) = decoder.scale(of(info.width), of(info.height)).ok()?;
    let decoded = decoder.decode().ok()?;
    let mut values = match info.pixel_format {
        PixelFormat::RGB24 => decoded,
        PixelFormat::L8 => decoded.into_iter().flat_map(|gray| [gray; 3]).collect(),
        _ => return None,
    };
    let profile = decoder.icc_profile().and_then(|icc| Profile::read(&icc));
    if let Some(profile) = profile.filter(|profile| profile.fits(info.pixel_format == PixelFormat::RGB24)) {
        let _ = profile.convert8(&mut values, 3);
    }
    let size = (usize::from(width), usize::from(height));
    let as_expected = (width, height) == (of(info.width), of(info.height)) && values.len() == 3 * size.0 * size.1;
    as_expected.then_some(Pixels { whole, shrink, size, values, channels: 3 })
}

/// The inks of a CMYK JPEG, `[height, width, 4]` from 0 for none to 255; `None` if it is another picture.
pub(super) fn inks(file: &[u8]) -> Option<Vec<u8>> {
    let mut decoder = Decoder::new(file);
    let decoded = decoder.decode().ok()?;
    (decoder.info()?.pixel_format == PixelFormat::CMYK32).then_some(decoded)
}
