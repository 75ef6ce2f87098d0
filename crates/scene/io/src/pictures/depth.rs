//! Pictures of depth.

use crate::{Error, Result};
use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read};
use image::{DynamicImage, ImageReader};
use std::ffi::OsStr;
use std::path::Path;

/// Units of 16-bit pictures in a world unit: they hold millimeters.
const MILLIMETERS: f32 = 1000.0;
/// The most pixels of an OpenEXR file, for which memory is taken at once.
const MOST_PIXELS: usize = 1 << 28;
/// Channels that programs give depth, in the order of their precedence; else a single one is taken.
const CHANNELS: [&str; 6] = ["Z", "depth", "V", "Y", "R", "depth.Z"];

/// Depth along the optical axis, for each pixel of a photo.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthPicture {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// World units, row by row, `[height, width]`; not known where it is not a positive number.
    pub depth: Vec<f32>,
}

impl DepthPicture {
    /// Reads a picture of depth: millimeters in 16 bits of gray (PNG, TIFF), or world units in OpenEXR, whose channel
    /// is `Z`, `depth`, `V`, `Y` or `R`, or the only one.
    ///
    /// # Errors
    /// When the file cannot be read, or is neither.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let is_exr = path.extension().and_then(OsStr::to_str).is_some_and(|name| name.eq_ignore_ascii_case("exr"));
        if is_exr { open_exr(path) } else { millimeters(path) }
    }
}

/// The error of a picture that is not of depth.
fn invalid(path: &Path, found: impl std::fmt::Display) -> Error {
    Error::invalid(path, "depth", "millimeters in 16 bits of gray, as PNG or TIFF, or world units in OpenEXR", found)
}

fn millimeters(path: &Path) -> Result<DepthPicture> {
    let reader = ImageReader::open(path).map_err(Error::io(path))?;
    let reader = reader.with_guessed_format().map_err(Error::io(path))?;
    match reader.decode().map_err(|error| invalid(path, error))? {
        DynamicImage::ImageLuma16(gray) => Ok(DepthPicture {
            width: gray.width() as usize,
            height: gray.height() as usize,
            depth: gray.as_raw().iter().map(|units| f32::from(*units) / MILLIMETERS).collect(),
        }),
        other => Err(invalid(path, format!("{:?}", other.color()))),
    }
}

fn open_exr(path: &Path) -> Result<DepthPicture> {
    let claims = exr::meta::MetaData::read_from_file(path, false);
    let sizes = claims.iter().flat_map(|claims| &claims.headers).map(|header| header.layer_size.area());
    if let Some(pixels) = sizes.max().filter(|pixels| *pixels > MOST_PIXELS) {
        return Err(invalid(path, format!("{pixels} pixels")));
    }
    let reader = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer().all_attributes();
    let layer = match reader.from_file(path) {
        Ok(image) => image.layer_data,
        Err(exr::error::Error::Io(source)) => return Err(Error::io(path)(source)),
        Err(error) => return Err(invalid(path, error)),
    };
    let channels = &layer.channel_data.list;
    let named = |name: &&str| channels.iter().find(|channel| channel.name.to_string().eq_ignore_ascii_case(name));
    let only = || if let [only] = &channels[..] { Some(only) } else { None };
    let Some(channel) = CHANNELS.iter().find_map(named).or_else(only) else {
        let names: Vec<String> = channels.iter().map(|channel| channel.name.to_string()).collect();
        return Err(invalid(path, format!("channels {}", names.join(", "))));
    };
    let depth = match &channel.sample_data {
        FlatSamples::F16(values) => values.iter().map(|value| value.to_f32()).collect(),
        FlatSamples::F32(values) => values.clone(),
        FlatSamples::U32(values) => values.iter().map(|value| *value as f32).collect(),
    };
    Ok(DepthPicture { width: layer.size.0, height: layer.size.1, depth })
}
