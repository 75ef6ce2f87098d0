//! From the bytes of a file to pixels.

use super::jpeg::{self, Segments};
use super::pixels::{Pixels, values8};
use super::profile::Profile;
use super::{Layer, orientation};
use crate::files::file::read_bytes;
use crate::{Error, Result};
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};
use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Read, Seek};
use std::path::Path;
use std::sync::{Condvar, Mutex, PoisonError};

/// Bytes of decoded photos at a time, unless a single one has more.
const MOST: u64 = 160 << 20;
/// Bytes of a single decoded photo: a header may claim anything.
const LARGEST: u64 = 512 << 20;
/// Bytes of pixels that one byte of a PNG or a JPEG stands for at most: 1032 by deflate, some hundreds by JPEG.
const DENSE: u64 = 1100;
/// Likewise of a TIFF or a lossy WebP: 2559 by LZW; 2400 by VP8, where 16 x 16 pixels take 3.4 bits at least.
const DENSER: u64 = 2600;
/// Bytes that a decoder may take for tables and windows of its own.
const MARGIN: u64 = 1 << 20;
const EXPECTED: &str = "a JPEG, PNG, TIFF or WebP image";

/// Header of a photo, before its pixels.
pub(super) struct Header {
    /// Width and height.
    pub stored: (usize, usize),
    pub orientation: Orientation,
    pub has_alpha: bool,
    pub is_gray: bool,
    /// Of a number of a pixel.
    pub bits: usize,
    pub jpeg: Option<Segments>,
}

pub(super) fn header(path: &Path) -> Result<Header> {
    let mut file = BufReader::new(File::open(path).map_err(Error::io(path))?);
    check_kind(path, file.fill_buf().map_err(Error::io(path))?)?;
    let jpeg = Segments::read(&mut file);
    check_values(path, &mut file)?;
    file.rewind().map_err(Error::io(path))?;
    // The decoder reads all it is given, and of a JPEG it needs no pixels.
    let file = file.take(jpeg.map_or(u64::MAX, |jpeg| jpeg.end));
    let mut decoder = decoder(path, "header", file)?;
    let (width, height) = decoder.dimensions();
    let color = decoder.color_type();
    Ok(Header {
        stored: (width as usize, height as usize),
        // A malformed orientation is ignored.
        orientation: decoder.orientation().unwrap_or(Orientation::NoTransforms),
        has_alpha: color.has_alpha(),
        is_gray: !color.has_color(),
        bits: 8 * usize::from(color.bytes_per_pixel()) / usize::from(color.channel_count()),
        jpeg,
    })
}

/// The pixels of a photo.
pub(super) fn decode(path: &Path) -> Result<Pixels> {
    Ok(decode_bytes(path, &read_bytes(path)?, None)?.0)
}

/// The pixels of a photo in memory in sRGB, and their orientation; messages call it `path`. `icc` is its profile if the
/// file has none.
pub(crate) fn decode_bytes(path: &Path, bytes: &[u8], icc: Option<&[u8]>) -> Result<(Pixels, Orientation)> {
    check_kind(path, bytes)?;
    if is_cut_jpeg(bytes) {
        return Err(Error::invalid(path, "image", "a whole JPEG image", "one that was cut short"));
    }
    check_values(path, &mut Cursor::new(bytes))?;
    let mut decoder = decoder(path, "image", Cursor::new(bytes))?;
    // A malformed orientation is ignored.
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    // A malformed profile likewise.
    let own = decoder.icc_profile().ok().flatten();
    let profile = own.as_deref().or(icc).and_then(Profile::read);
    let (total, length) = (decoder.total_bytes(), bytes.len() as u64);
    check_claim(path, density(bytes), decoder.dimensions(), total, length)?;
    // Compressed data are no longer than the file.
    let mut limits = Limits::default();
    limits.max_alloc = Some(2 * total + length + MARGIN);
    decoder.set_limits(limits).map_err(|e| Error::invalid(path, "image", EXPECTED, e))?;
    let decoded = DynamicImage::from_decoder(decoder).map_err(|e| Error::invalid(path, "image", EXPECTED, e))?;
    let size = (decoded.width() as usize, decoded.height() as usize);
    let has_alpha = decoded.color().has_alpha();
    let values = match profile {
        None => values8(decoded),
        Some(profile) => in_srgb(decoded, &profile, bytes),
    };
    Ok((Pixels { whole: size, shrink: 1, size, values, channels: if has_alpha { 4 } else { 3 } }, orientation))
}

/// The values of a picture of 8 bits in sRGB. Inks of a CMYK JPEG are read from its file, since its decoder makes
/// colors of them.
fn in_srgb(picture: DynamicImage, profile: &Profile, file: &[u8]) -> Vec<u8> {
    profile.to_srgb(picture).unwrap_or_else(|picture| {
        let values = values8(picture);
        let inks = jpeg::inks(file).and_then(|inks| profile.of_inks(&inks));
        inks.filter(|colors| colors.len() == values.len()).unwrap_or(values)
    })
}

fn decoder<'a>(path: &Path, place: &str, from: impl BufRead + Seek + 'a) -> Result<impl ImageDecoder + 'a> {
    let reader = ImageReader::new(from).with_guessed_format().map_err(Error::io(path))?;
    reader.into_decoder().map_err(|e| Error::invalid(path, place, EXPECTED, e))
}

/// True if a JPEG may hold the pixels that its header claims.
pub(super) fn may_hold(path: &Path, (width, height): (usize, usize)) -> bool {
    let size = (width as u32, height as u32);
    let total = 3 * width as u64 * height as u64;
    std::fs::metadata(path).is_ok_and(|file| check_claim(path, Some(DENSE), size, total, file.len()).is_ok())
}

/// Bytes of pixels that one byte of a file stands for at most; `None` for lossless WebP, where one color takes no bits
/// at all.
fn density(bytes: &[u8]) -> Option<u64> {
    const LOSSLESS: &[u8] = b"VP8L";
    match image::guess_format(bytes).ok()? {
        ImageFormat::Png | ImageFormat::Jpeg => Some(DENSE),
        ImageFormat::WebP if bytes.windows(LOSSLESS.len()).any(|chunk| chunk == LOSSLESS) => None,
        _ => Some(DENSER),
    }
}

/// Refuses a size in a header that a file of this density cannot hold, or that is too much: memory is taken for it
/// before a pixel is decoded.
fn check_claim(path: &Path, density: Option<u64>, size: (u32, u32), total: u64, bytes: u64) -> Result<()> {
    if density.is_some_and(|density| total / density > bytes) {
        let expected = format!("{} x {} pixels, as its header says", size.0, size.1);
        return Err(Error::invalid(path, "image", expected, format!("{bytes} bytes")));
    }
    if total > LARGEST {
        return Err(Error::invalid(path, "image", format!("at most {LARGEST} bytes once it is decoded"), total));
    }
    Ok(())
}

/// Refuses a header whose values are longer than the file.
fn check_values(path: &Path, file: &mut (impl Read + Seek)) -> Result<()> {
    let found = super::tiff::too_long(file);
    found.map_or(Ok(()), |found| Err(Error::invalid(path, "directory", "values that the file can hold", found)))
}

/// Says how to convert formats whose pixels other programs decode.
fn check_kind(path: &Path, bytes: &[u8]) -> Result<()> {
    match heif_kind(bytes) {
        Some(kind) => Err(Error::ToConvert { path: path.to_path_buf(), kind }),
        None => Ok(()),
    }
}

/// Name of the format whose file begins with these bytes, if it is one of HEIF.
pub(crate) fn heif_kind(start: &[u8]) -> Option<&'static str> {
    match start.get(4..12)? {
        b"ftypavif" | b"ftypavis" => Some("AVIF"),
        b"ftypheic" | b"ftypheix" | b"ftyphevc" | b"ftyphevx" | b"ftypheim" | b"ftypheis" | b"ftypmif1" => Some("HEIC"),
        _ => None,
    }
}

/// True if these are the bytes of a JPEG whose picture has a beginning and no end. Decoders fill the rest with gray.
fn is_cut_jpeg(bytes: &[u8]) -> bool {
    const START: [u8; 2] = [0xff, 0xd8];
    const SCAN: u8 = 0xda;
    const END: [u8; 2] = [0xff, 0xd9];
    if !bytes.starts_with(&START) {
        return false;
    }
    // Segments up to the first scan have a length; one of them may hold a smaller picture with an end of its own.
    let mut at = 2;
    while let Some([0xff, kind, high, low]) = bytes.get(at..at + 4) {
        if *kind == SCAN {
            return !bytes[at..].windows(2).any(|pair| pair == END);
        }
        at += 2 + usize::from(u16::from_be_bytes([*high, *low]));
    }
    // No scan: for the decoder to say.
    false
}

/// The pixels of a photo as they are stored.
pub(crate) struct Decoded {
    pub pixels: Pixels,
    pub orientation: Orientation,
    pub layer: Layer,
    /// True if values are read as their complements.
    pub inverted: bool,
    /// Of the same size once both are turned.
    pub mask: Option<Box<Decoded>>,
}

impl Decoded {
    /// Pixels over a background.
    pub fn over(background: [f32; 3], pixels: Pixels, orientation: Orientation) -> Self {
        Self { pixels, orientation, layer: Layer::Over(background), inverted: false, mask: None }
    }

    /// Width and height as read.
    pub fn size(&self) -> (usize, usize) {
        orientation::turned(self.orientation, self.pixels.size)
    }

    /// Where a part `[x0, y0, x1, y1]` of the whole photo is.
    pub fn part(&self, part: [f64; 4]) -> [f64; 4] {
        let Pixels { whole, size, shrink, .. } = self.pixels;
        let shrink = shrink as f64;
        // The last of the smaller pixels may reach beyond the file.
        let beyond = [size.0 as f64 - whole.0 as f64 / shrink, size.1 as f64 - whole.1 as f64 / shrink];
        let [left, top] = orientation::margin(self.orientation, beyond);
        let (width, height) = self.size();
        let [x0, y0, x1, y1] = part.map(|x| x / shrink);
        [x0 + left, y0 + top, (x1 + left).min(width as f64), (y1 + top).min(height as f64)]
    }

    /// A row as read, `[width, 3]`.
    pub fn row(&self, y: usize, row: &mut [u8]) {
        if self.is_plain() {
            return row.copy_from_slice(&self.pixels.values[y * row.len()..(y + 1) * row.len()]);
        }
        for (x, color) in row.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let seen = self.color(self.pixel((x, y)));
            *color = match &self.mask {
                Some(mask) => self.color(&[seen[0], seen[1], seen[2], mask.color(mask.pixel((x, y)))[0]]),
                None => seen,
            };
        }
    }

    /// The stored pixel at a place of the upright photo.
    fn pixel(&self, at: (usize, usize)) -> &[u8] {
        let Pixels { size, values, channels, .. } = &self.pixels;
        let (x, y) = orientation::stored(self.orientation, *size, at);
        &values[(y * size.0 + x) * channels..][..*channels]
    }

    /// True if pixels are read as they are stored.
    fn is_plain(&self) -> bool {
        self.mask.is_none()
            && !self.inverted
            && self.orientation == Orientation::NoTransforms
            && self.pixels.channels == 3
            && matches!(self.layer, Layer::Over(_))
    }

    fn color(&self, pixel: &[u8]) -> [u8; 3] {
        let opaque = [pixel[0], pixel[1], pixel[2]];
        let alpha = pixel.get(3).copied().unwrap_or(255);
        let color = match self.layer {
            Layer::Alpha => [alpha; 3],
            Layer::Over(_) if alpha == 255 => opaque,
            Layer::Over(background) => {
                let alpha = f32::from(alpha) / 255.0;
                std::array::from_fn(|c| {
                    let over = f32::from(opaque[c]) / 255.0 * alpha + background[c] * (1.0 - alpha);
                    (over * 255.0).round() as u8
                })
            }
        };
        if self.inverted { color.map(|value| 255 - value) } else { color }
    }

    /// All pixels as read, `[height, width, 3]`.
    pub fn into_pixels(self) -> Vec<u8> {
        if self.is_plain() {
            return self.pixels.values;
        }
        let (width, height) = self.size();
        let mut pixels = vec![0; 3 * width * height];
        pixels.chunks_exact_mut(3 * width.max(1)).enumerate().for_each(|(y, row)| self.row(y, row));
        pixels
    }
}

/// Bytes that are being decoded.
static USED: Mutex<u64> = Mutex::new(0);
static FREED: Condvar = Condvar::new();

/// The right to decode a photo, until it is dropped. Whoever holds one must not wait for another, nor for other
/// threads.
pub(super) struct Permit {
    bytes: u64,
}

impl Permit {
    /// Waits until so many bytes fit beside the other decoders' memory, or there are no others.
    pub fn wait(bytes: u64) -> Self {
        let used = USED.lock().unwrap_or_else(PoisonError::into_inner);
        let too_much = |used: &mut u64| *used > 0 && *used + bytes > MOST;
        let mut used = FREED.wait_while(used, too_much).unwrap_or_else(PoisonError::into_inner);
        *used += bytes;
        Self { bytes }
    }
}

impl Drop for Permit {
    fn drop(&mut self) {
        *USED.lock().unwrap_or_else(PoisonError::into_inner) -= self.bytes;
        FREED.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn what_a_header_claims_is_bounded() {
        let says = |start: &[u8], total, bytes| {
            check_claim(Path::new("a"), density(start), (9, 9), total, bytes).err().map(|error| error.to_string())
        };
        let [png, jpeg, tiff] = [&b"\x89PNG\r\n\x1a\n"[..], b"\xff\xd8\xff", b"II*\0"];
        let [lossy, lossless] = [b"RIFF\x40\0\0\0WEBPVP8 ", b"RIFF\x40\0\0\0WEBPVP8L"];
        assert_eq!(says(png, LARGEST, LARGEST / 1000), None);
        assert_eq!(says(lossless, LARGEST, 9), None);
        let too_much = "9 x 9 pixels, as its header says, found 900 bytes";
        for (start, most) in [(jpeg, 900 * DENSE), (tiff, 900 * DENSER), (lossy, 900 * DENSER)] {
            assert_eq!(says(start, most, 900), None);
            assert!(says(start, most + DENSER, 900).unwrap().contains(too_much));
        }
        assert!(says(tiff, LARGEST + 1, LARGEST).unwrap().contains("at most 536870912 bytes"));
    }

    #[test]
    fn large_photos_are_decoded_one_after_the_other() {
        let (now, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let decode = || {
            let _permit = Permit::wait(144_000_000);
            most.fetch_max(now.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
            std::thread::sleep(std::time::Duration::from_millis(5));
            now.fetch_sub(1, Ordering::SeqCst);
        };
        std::thread::scope(|scope| (0..4).for_each(|_| drop(scope.spawn(decode))));
        assert_eq!(most.into_inner(), 1);
        // One alone is decoded at any size.
        drop(Permit::wait(10 * MOST));
    }
}
