//! Photos on disk: orientation and pixels, decoded for as long as shrinking takes.

pub(crate) mod decoding;
mod jpeg;
pub(crate) mod orientation;
mod pixels;
mod profile;
mod tiff;

use crate::files::folder::list_named;
use crate::pictures::resize::{self, Filter};
use crate::{Background, Bitmap, Error, Image, Result, natural_order};
use decoding::Decoded;
use image::metadata::Orientation;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Extensions of the photos that can be read.
pub(crate) const EXTENSIONS: [&str; 6] = ["png", "jpg", "jpeg", "tif", "tiff", "webp"];

/// Extensions of photos that other programs decode.
const TO_CONVERT: [&str; 3] = ["heic", "heif", "avif"];

/// A photo on disk: JPEG (also progressive, gray or CMYK), PNG, TIFF or WebP, of 8 or 16 bits, with or without alpha.
///
/// Making one reads the header; pixels are decoded on demand, to 8 bits, and are only kept in the requested size. Large
/// photos are decoded one after the other, at any number of threads, so that several take little more memory than one.
/// A JPEG of [16 megapixels](Self::shrink_from) or more that is to become much smaller is decoded at a half or a
/// quarter of its sides, the least that is still three times the requested size: four of 48 megapixels take 70 MB. If
/// they are progressive, the decoder holds all coefficients of one at once: 175 MB where its colors have half the
/// resolution, else 335 MB.
///
/// A photo is turned upright as its EXIF orientation says, unless [`for_camera`](Self::for_camera) says otherwise.
/// Straight alpha is composited over a background, white if nothing else is said, in sRGB values. Colors with an ICC
/// profile of another space, such as Display P3, Adobe RGB, a gray or a CMYK space, become sRGB; a malformed profile
/// counts as sRGB.
#[derive(Clone, Debug)]
pub struct PhotoFile {
    path: PathBuf,
    /// Width and height as stored.
    stored: (usize, usize),
    orientation: Orientation,
    layer: Layer,
    has_alpha: bool,
    is_gray: bool,
    bits: usize,
    /// True if its values are read as their complements.
    inverted: bool,
    /// A gray photo of the same size that is its alpha.
    mask: Option<Box<PhotoFile>>,
    /// Segments before its pixels if it is a JPEG.
    jpeg: Option<jpeg::Segments>,
    shrink_from: usize,
    /// True if a pixel was met that is not opaque, by this or by a clone.
    transparent: Arc<AtomicBool>,
}

/// Pixels of a photo from which it is decoded at a reduced scale. Below, it takes less memory than a network, and its
/// pixels are those that it always had.
const SHRINK_FROM: usize = 16_000_000;
/// Least size of a reduced scale over the one that is wanted: less would cost colors of half the resolution some of
/// theirs.
const ENOUGH: f64 = 3.0;

/// Layer of a photo that is read.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Layer {
    /// Its colors over a background.
    Over([f32; 3]),
    /// Its alpha, in all three channels.
    Alpha,
}

impl PhotoFile {
    /// Reads the header of a photo.
    ///
    /// # Errors
    /// When the file is missing or no photo.
    pub fn at(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let decoding::Header { stored, orientation, has_alpha, is_gray, bits, jpeg } = decoding::header(path)?;
        let layer = Layer::Over([1.0; 3]);
        let path = path.to_path_buf();
        let (shrink_from, transparent) = (SHRINK_FROM, Arc::default());
        Ok(Self {
            path,
            stored,
            orientation,
            layer,
            has_alpha,
            is_gray,
            bits,
            inverted: false,
            mask: None,
            jpeg,
            shrink_from,
            transparent,
        })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Width and height as read.
    pub fn size(&self) -> (usize, usize) {
        orientation::turned(self.orientation, self.stored)
    }

    /// Width and height of the pixels in the file, before its orientation is applied.
    pub fn stored_size(&self) -> (usize, usize) {
        self.stored
    }

    /// The photo as a camera of this size belongs to it, whose file may have ignored its orientation: upright if it has
    /// that size upright and not as it is stored, else as it is stored.
    pub fn for_camera(mut self, width: usize, height: usize) -> Self {
        if self.stored == (width, height) || self.size() != (width, height) {
            self.orientation = Orientation::NoTransforms;
        }
        self
    }

    /// True if EXIF turns or mirrors the photo without changing its size, which leaves open to
    /// [`for_camera`](Self::for_camera) whether a camera is for the upright photo: one that is mirrored or turned by
    /// 180 degrees, or a square one.
    pub fn has_ambiguous_orientation(&self) -> bool {
        self.orientation != Orientation::NoTransforms && self.size() == self.stored
    }

    /// True if reading the photo, through this value or its copies, has met pixels that are not opaque. Always false
    /// before it is read.
    pub fn was_transparent(&self) -> bool {
        self.transparent.load(Ordering::Relaxed)
    }

    /// True if it has no colors; all channels are alike as read then.
    pub fn is_gray(&self) -> bool {
        self.is_gray
    }

    /// Bits of each number in the file; as read it has 8.
    pub fn bits(&self) -> usize {
        self.bits
    }

    /// The photo over a background, where it is transparent.
    pub fn over(self, background: [f32; 3]) -> Self {
        Self { layer: Layer::Over(background), ..self }
    }

    /// Its alpha as a gray photo, if it has one.
    pub fn alpha(self) -> Option<Self> {
        self.has_alpha.then_some(Self { layer: Layer::Alpha, ..self })
    }

    /// Its negative, as of a mask whose black counts.
    pub fn inverted(self) -> Self {
        Self { inverted: !self.inverted, ..self }
    }

    /// The photo over its background where `mask` is dark, in proportion: white takes the photo, black nothing of it.
    /// The mask has the photo's size.
    pub fn masked(self, mask: Self) -> Self {
        Self { mask: Some(Box::new(mask)), ..self }
    }

    /// From how many pixels on a JPEG may be decoded at a reduced scale, where it is resized to half its sides or less:
    /// 16 million, unless this says otherwise. Resized pixels then differ a little from a resized whole photo's. A
    /// photo with a [mask](Self::masked) or of CMYK is decoded whole.
    pub fn shrink_from(self, pixels: usize) -> Self {
        Self { shrink_from: pixels, ..self }
    }

    /// All of the photo.
    ///
    /// # Errors
    /// When the file cannot be read or decoded.
    pub fn read(&self) -> Result<Bitmap> {
        let (width, height) = self.size();
        self.decoded(1, |decoded| Bitmap { width, height, pixels: decoded.into_pixels() })
    }

    /// The part `[x0, y0, x1, y1]` (pixels, may be fractional) resized as [`Image::resize`](crate::Image::resize) does.
    ///
    /// # Errors
    /// When the file cannot be read or decoded.
    ///
    /// # Panics
    /// When the part is empty or extends beyond the photo.
    pub fn resize(&self, width: usize, height: usize, part: [f64; 4]) -> Result<Bitmap> {
        self.resample(width, height, part, resize::LANCZOS)
    }

    /// All of the photo, resized as [`Image::resize`](crate::Image::resize) does; not touched if it has that size.
    ///
    /// # Errors
    /// When the file cannot be read or decoded.
    pub fn resize_whole(&self, width: usize, height: usize) -> Result<Bitmap> {
        let (w, h) = self.size();
        if (w, h) == (width, height) {
            return self.read();
        }
        self.resize(width, height, [0.0, 0.0, w as f64, h as f64])
    }

    /// All of the photo, resized as [`Image::resize_bicubic`](crate::Image::resize_bicubic) does.
    ///
    /// # Errors
    /// When the file cannot be read or decoded.
    pub fn resize_bicubic(&self, width: usize, height: usize) -> Result<Bitmap> {
        let (w, h) = self.size();
        self.resample(width, height, [0.0, 0.0, w as f64, h as f64], resize::BICUBIC)
    }

    fn resample(&self, width: usize, height: usize, part: [f64; 4], filter: Filter) -> Result<Bitmap> {
        let [x0, y0, x1, y1] = part;
        let shrink = self.shrink(((x1 - x0) / width as f64).min((y1 - y0) / height as f64));
        let resampled = |decoded: Decoded| {
            let part = decoded.part(part);
            resize::resample(decoded.size(), |y, row| decoded.row(y, row), [width, height], part, filter)
        };
        Ok(Bitmap { width, height, pixels: self.decoded(shrink, resampled)? })
    }

    /// Number of pixels each way that become one while the photo is decoded, where `in_the_end` of them become one in
    /// total.
    fn shrink(&self, in_the_end: f64) -> usize {
        let large = self.stored.0 * self.stored.1 >= self.shrink_from;
        if !large || self.mask.is_some() || !self.jpeg.is_some_and(|jpeg| jpeg.can_shrink()) {
            return 1;
        }
        // At an eighth the decoder rounds down, which darkens by 0.7 of 255.
        [4, 2].into_iter().find(|shrink| in_the_end >= ENOUGH * *shrink as f64).unwrap_or(1)
    }

    /// Decodes the photo, at a reduced scale if `shrink` is more than 1, for as long as `consume` takes.
    fn decoded<R>(&self, shrink: usize, consume: impl FnOnce(Decoded) -> R) -> Result<R> {
        // One permit for both: whoever waits for a second one may wait forever.
        let _permit = decoding::Permit::wait(self.takes(shrink));
        let mut decoded = self.decoded_alone(shrink)?;
        if let Some(mask) = &self.mask {
            if mask.size() != self.size() {
                let [(w, h), (found_w, found_h)] = [self.size(), mask.size()];
                let expected = format!("{w}x{h}, its photo's");
                return Err(Error::invalid(&mask.path, "mask size", expected, format!("{found_w}x{found_h}")));
            }
            decoded.mask = Some(Box::new(mask.decoded_alone(1)?));
        }
        Ok(consume(decoded))
    }

    /// About how many bytes decoding takes: for pixels, channels while they are apart, and coefficients that are held
    /// at once.
    fn takes(&self, shrink: usize) -> u64 {
        let (width, height) = self.stored;
        let pixels = (width * height) as u64;
        let coefficients = if self.jpeg.is_some_and(|jpeg| jpeg.progressive) { 6 * pixels } else { 0 };
        let channels = if shrink > 1 { 6 } else { 3 };
        let mask = if self.mask.is_some() { 3 * pixels } else { 0 };
        coefficients + mask + channels * pixels / (shrink * shrink) as u64
    }

    fn decoded_alone(&self, shrink: usize) -> Result<Decoded> {
        let shrunk = self.jpeg.filter(|_| shrink > 1 && decoding::may_hold(&self.path, self.stored));
        let shrunk = shrunk.and_then(|jpeg| jpeg::decode(&self.path, jpeg, self.stored, shrink));
        // The whole also where the other decoder has refused it: this one supports more kinds, and names the fault.
        let pixels = shrunk.map_or_else(|| decoding::decode(&self.path), Ok)?;
        if pixels.whole != self.stored {
            let [(width, height), found] = [self.stored, pixels.whole];
            let found = format!("{}x{}; did it change?", found.0, found.1);
            return Err(Error::invalid(&self.path, "image size", format!("{width}x{height} as before"), found));
        }
        if pixels.is_transparent() {
            self.transparent.store(true, Ordering::Relaxed);
        }
        let Self { orientation, layer, inverted, .. } = *self;
        Ok(Decoded { pixels, orientation, layer, inverted, mask: None })
    }
}

impl Image {
    /// Reads a photo of any kind that [`PhotoFile`] reads, upright, over a background, with values of 8 bits.
    ///
    /// # Errors
    /// When the file is missing or no photo.
    pub fn read(path: impl AsRef<Path>, background: Background) -> Result<Self> {
        Ok(PhotoFile::at(path)?.over(background.rgb()).read()?.to_image())
    }

    /// The same photo as [`read`](Self::read) from the bytes of its file; messages call it `origin`.
    ///
    /// # Errors
    /// When they are no photo.
    pub fn decode(bytes: &[u8], origin: impl AsRef<Path>, background: Background) -> Result<Self> {
        let (pixels, orientation) = decoding::decode_bytes(origin.as_ref(), bytes, None)?;
        let decoded = Decoded::over(background.rgb(), pixels, orientation);
        let (width, height) = decoded.size();
        Ok(Bitmap { width, height, pixels: decoded.into_pixels() }.to_image())
    }

    /// Width and height of a photo, upright, from its header alone.
    ///
    /// # Errors
    /// When the file is missing or no photo.
    pub fn dimensions(path: impl AsRef<Path>) -> Result<(usize, usize)> {
        Ok(PhotoFile::at(path)?.size())
    }
}

/// Photos, and in place of folders [those in them](list_photos).
///
/// # Errors
/// When a folder cannot be read.
pub fn photos_at(paths: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let photos = |path: &PathBuf| if path.is_dir() { list_photos(path) } else { Ok(vec![path.clone()]) };
    Ok(paths.iter().map(photos).collect::<Result<Vec<_>>>()?.concat())
}

/// The photos in a folder, in [natural order](natural_order): every kind that [`PhotoFile`] reads, and HEIC and AVIF,
/// whose error says how to convert them. Links that lead nowhere are among them, so that whoever reads them says so;
/// files whose names begin with a dot, as macOS keeps them beside photos, are not.
///
/// # Errors
/// When the folder cannot be read.
pub fn list_photos(folder: impl AsRef<Path>) -> Result<Vec<PathBuf>> {
    let mut photos = list_named(folder.as_ref(), &[&EXTENSIONS[..], &TO_CONVERT[..]].concat())?;
    let hidden = |path: &Path| path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
    photos.retain(|path| !path.is_dir() && !hidden(path));
    photos.sort_by(|a, b| natural_order(a.as_os_str(), b.as_os_str()));
    Ok(photos)
}
