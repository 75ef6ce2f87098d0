//! Color profiles of photos (ICC): colors of other spaces become sRGB.

use image::DynamicImage;
use moxcms::{ColorProfile, DataColorSpace, Layout, TransformExecutor, TransformOptions};
use std::sync::Arc;

/// Pixels that are converted at a time.
const PART: usize = 1 << 14;
/// Levels of 255 by which sRGB profiles of different makers differ.
const SAME: u8 = 1;
/// Distance of the levels of each channel in the colors that tell a profile from sRGB.
const STEP: usize = 51;

/// A color profile other than sRGB.
pub(super) struct Profile {
    profile: ColorProfile,
    kind: Kind,
}

/// Channels that a profile is for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Gray,
    Rgb,
    Cmyk,
}

/// A conversion of values of 8 or of 16 bits.
type Conversion<T> = Arc<dyn TransformExecutor<T> + Send + Sync>;

impl Profile {
    /// Reads a profile; `None` of sRGB under any name, where nothing is to be done, and of one that is malformed or of
    /// other channels than photos have.
    pub fn read(icc: &[u8]) -> Option<Self> {
        let profile = ColorProfile::new_from_slice(icc).ok()?;
        let kind = match profile.color_space {
            DataColorSpace::Gray => Kind::Gray,
            DataColorSpace::Rgb => Kind::Rgb,
            DataColorSpace::Cmyk => Kind::Cmyk,
            _ => return None,
        };
        let found = Self { profile, kind };
        (kind == Kind::Cmyk || !found.is_srgb()?).then_some(found)
    }

    /// True if it changes no color by more than rounding does.
    fn is_srgb(&self) -> Option<bool> {
        let levels = || (0..=255).step_by(STEP);
        let colors =
            levels().flat_map(|r| levels().flat_map(move |g| levels().map(move |b| [r as u8, g as u8, b as u8])));
        let colors: Vec<u8> = colors.chain((0..=255).map(|gray| [gray; 3])).flatten().collect();
        // All channels of a gray profile follow the first one.
        let colors = if self.kind == Kind::Gray { (0..=255).flat_map(|gray| [gray; 3]).collect() } else { colors };
        let mut converted = colors.clone();
        self.convert8(&mut converted, 3)?;
        Some(colors.iter().zip(&converted).all(|(from, to)| from.abs_diff(*to) <= SAME))
    }

    /// The pixels of a gray or a color picture in sRGB, `[height, width, channels]` of 8 bits: 3 channels, or 4 with
    /// alpha. Numbers of 16 bits are rounded once they are sRGB, since linear ones need all their bits in the dark.
    ///
    /// The picture comes back where the profile is for other channels.
    pub fn to_srgb(&self, picture: DynamicImage) -> Result<Vec<u8>, DynamicImage> {
        let color = picture.color();
        if !self.fits(color.has_color()) {
            return Err(picture);
        }
        let channels = if color.has_alpha() { 4 } else { 3 };
        if color.bytes_per_pixel() == color.channel_count() {
            let mut values = super::pixels::values8(picture);
            let _ = self.convert8(&mut values, channels);
            return Ok(values);
        }
        let mut values = if channels == 4 { picture.into_rgba16().into_raw() } else { picture.into_rgb16().into_raw() };
        let by = self.profile.create_transform_16bit(self.from(channels), &srgb(), to(channels), options());
        let _ = by.ok().and_then(|by| self.convert(&mut values, channels, &by));
        Ok(values.into_iter().map(|value| ((u32::from(value) + 128) / 257) as u8).collect())
    }

    /// True if it is for pictures with colors, or without.
    pub fn fits(&self, has_color: bool) -> bool {
        match self.kind {
            Kind::Gray => !has_color,
            Kind::Rgb => true,
            Kind::Cmyk => false,
        }
    }

    /// Converts pixels of 8 bits that the profile [fits](Self::fits), `[.., channels]`; `None` where it cannot, and
    /// leaves them as they are.
    pub fn convert8(&self, values: &mut [u8], channels: usize) -> Option<()> {
        let by = self.profile.create_transform_8bit(self.from(channels), &srgb(), to(channels), options()).ok()?;
        self.convert(values, channels, &by)
    }

    /// The colors of inks, `[.., 4]` from 0 for none to 255; `None` where the profile is for other channels.
    pub fn of_inks(&self, inks: &[u8]) -> Option<Vec<u8>> {
        let by = self.profile.create_transform_8bit(Layout::Rgba, &srgb(), Layout::Rgb, options()).ok()?;
        let mut values = vec![0; inks.len() / 4 * 3];
        (self.kind == Kind::Cmyk).then_some(())?;
        by.transform(inks, &mut values).ok()?;
        Some(values)
    }

    fn convert<T: Copy + Default>(&self, values: &mut [T], channels: usize, by: &Conversion<T>) -> Option<()> {
        let colors = if self.kind == Kind::Gray { 1 } else { 3 };
        let mut from = Vec::with_capacity(channels * PART);
        for part in values.chunks_mut(channels * PART) {
            from.clear();
            for pixel in part.chunks_exact(channels) {
                from.extend_from_slice(&pixel[..colors]);
                from.extend(pixel.get(3));
            }
            by.transform(&from, part).ok()?;
        }
        Some(())
    }

    /// Layout of the values that are handed to a conversion.
    fn from(&self, channels: usize) -> Layout {
        match (self.kind, channels) {
            (Kind::Gray, 3) => Layout::Gray,
            (Kind::Gray, _) => Layout::GrayAlpha,
            _ => to(channels),
        }
    }
}

/// Layout of converted values.
fn to(channels: usize) -> Layout {
    if channels == 4 { Layout::Rgba } else { Layout::Rgb }
}

fn srgb() -> ColorProfile {
    ColorProfile::new_srgb()
}

fn options() -> TransformOptions {
    // Fixed point is off by a level here and there.
    TransformOptions { prefer_fixed_point: false, ..TransformOptions::default() }
}
