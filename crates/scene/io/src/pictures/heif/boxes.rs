//! The boxes of a HEIF container, as far as they tell about its photo.

use image::metadata::Orientation::{self, *};
use moxcms::ColorProfile;

/// Color primaries of Display P3 (ISO/IEC 23091-2).
const DISPLAY_P3: u64 = 12;

/// Properties of the photo that a container is about.
#[derive(Debug)]
pub(super) struct Properties {
    /// Width and height of the stored pixels.
    extents: (usize, usize),
    /// Width and height of the part of them that is shown.
    aperture: Option<(usize, usize)>,
    /// The turn that makes stored pixels upright.
    pub orientation: Orientation,
    icc: Option<Vec<u8>>,
    primaries: Option<u64>,
}

impl Properties {
    /// Reads the properties of the primary item of a file; `None` if the file does not tell.
    pub fn of_primary(file: &[u8]) -> Option<Self> {
        // Its version and flags come first.
        let meta = Reader(child(file, b"meta")?).skip(4)?.0;
        let mut primary = Reader(child(meta, b"pitm")?);
        let primary = if primary.full_box()? == 0 { primary.number(2)? } else { primary.number(4)? };
        let all = child(meta, b"iprp")?;
        let known: Vec<Part<'_>> = boxes(child(all, b"ipco")?).collect();
        let mut found = Self { extents: (0, 0), aperture: None, orientation: NoTransforms, icc: None, primaries: None };
        for index in associated(child(all, b"ipma")?, primary)? {
            if let Some((kind, content)) = index.checked_sub(1).and_then(|index| known.get(index)) {
                // A malformed property is as good as none.
                let _ = found.add(kind, content);
            }
        }
        Some(found)
    }

    fn add(&mut self, kind: &[u8; 4], content: &[u8]) -> Option<()> {
        let mut content = Reader(content);
        match kind {
            b"ispe" => {
                content.full_box()?;
                self.extents = (content.number(4)? as usize, content.number(4)? as usize);
            }
            b"clap" => {
                let mut side = || Some((content.number(4)? as f64 / content.number(4)?.max(1) as f64).round() as usize);
                self.aperture = Some((side()?, side()?));
            }
            b"irot" => self.orientation = rotated(self.orientation, content.number(1)? & 3),
            b"imir" => self.orientation = mirrored(self.orientation, content.number(1)? & 1 == 1),
            b"colr" => match content.take(4)? {
                b"prof" | b"rICC" => self.icc = Some(content.0.to_vec()),
                b"nclx" => self.primaries = Some(content.number(2)?),
                _ => {}
            },
            _ => {}
        }
        Some(())
    }

    /// Width and height of the pixels that are shown, before they are turned.
    pub fn size(&self) -> (usize, usize) {
        self.aperture.unwrap_or(self.extents)
    }

    /// The ICC profile of its colors; `None` of sRGB.
    pub fn profile(self) -> Option<Vec<u8>> {
        let named = self.primaries.filter(|primaries| *primaries == DISPLAY_P3);
        self.icc.or_else(|| named.and_then(|_| ColorProfile::new_display_p3().encode().ok()))
    }
}

/// Turns counterclockwise by so many right angles, after another orientation.
fn rotated(first: Orientation, quarters: u64) -> Orientation {
    const ONE: [[Orientation; 2]; 8] = [
        [NoTransforms, Rotate270],
        [Rotate270, Rotate180],
        [Rotate180, Rotate90],
        [Rotate90, NoTransforms],
        [FlipHorizontal, Rotate90FlipH],
        [Rotate90FlipH, FlipVertical],
        [FlipVertical, Rotate270FlipH],
        [Rotate270FlipH, FlipHorizontal],
    ];
    let one = |from: Orientation| ONE.iter().find(|[known, _]| *known == from).map_or(from, |[_, to]| *to);
    (0..quarters).fold(first, |orientation, _| one(orientation))
}

/// Mirrors, left to right or upside down, after another orientation.
fn mirrored(first: Orientation, left_to_right: bool) -> Orientation {
    let flipped = match first {
        NoTransforms => FlipHorizontal,
        FlipHorizontal => NoTransforms,
        Rotate90 => Rotate90FlipH,
        Rotate90FlipH => Rotate90,
        Rotate180 => FlipVertical,
        FlipVertical => Rotate180,
        Rotate270 => Rotate270FlipH,
        Rotate270FlipH => Rotate270,
    };
    // Upside down is left to right, and half a turn.
    if left_to_right { flipped } else { rotated(flipped, 2) }
}

/// Numbers of the properties of an item, from 1 on, in the order in which they apply.
fn associated(content: &[u8], item: u64) -> Option<Vec<usize>> {
    let mut content = Reader(content);
    let start = content.number(4)?;
    let (version, wide) = (start >> 24, start & 1 == 1);
    for _ in 0..content.number(4)? {
        let id = content.number(if version == 0 { 2 } else { 4 })?;
        let mut properties = Vec::new();
        for _ in 0..content.number(1)? {
            // The highest bit says whether a reader has to know it.
            let index = if wide { content.number(2)? & 0x7fff } else { content.number(1)? & 0x7f };
            properties.push(index as usize);
        }
        if id == item {
            return Some(properties);
        }
    }
    None
}

/// Kind and content of a box.
type Part<'a> = (&'a [u8; 4], &'a [u8]);

/// The content of the first box of a kind.
fn child<'a>(content: &'a [u8], kind: &[u8; 4]) -> Option<&'a [u8]> {
    boxes(content).find(|(found, _)| *found == kind).map(|(_, content)| content)
}

/// The boxes in a file or in another box, as far as they are whole.
fn boxes(content: &[u8]) -> impl Iterator<Item = Part<'_>> {
    let mut rest = Reader(content);
    std::iter::from_fn(move || {
        let whole = rest.0.len() as u64;
        let length = rest.number(4)?;
        let kind = rest.take(4)?.first_chunk()?;
        let (length, head) = match length {
            0 => (whole, 8),
            1 => (rest.number(8)?, 16),
            length => (length, 8),
        };
        let content = rest.take(usize::try_from(length.checked_sub(head)?).ok()?)?;
        Some((kind, content))
    })
}

/// Bytes that are left to read.
#[derive(Clone, Copy)]
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, bytes: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(bytes)?;
        self.0 = rest;
        Some(taken)
    }

    fn skip(mut self, bytes: usize) -> Option<Self> {
        self.take(bytes)?;
        Some(self)
    }

    /// A number of so many bytes, the highest first.
    fn number(&mut self, bytes: usize) -> Option<u64> {
        Some(self.take(bytes)?.iter().fold(0, |number, byte| number << 8 | u64::from(*byte)))
    }

    /// The version of a box that has one; flags are skipped.
    fn full_box(&mut self) -> Option<u64> {
        Some(self.number(4)? >> 24)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Turns and mirrors of the container, one after the other, beside turned pixels.
    #[test]
    fn orientations_follow_one_another() {
        let picture =
            image::DynamicImage::from(image::GrayImage::from_fn(3, 2, |x, y| image::Luma([(3 * y + x) as u8])));
        let turned = |orientation: Orientation| {
            let mut picture = picture.clone();
            picture.apply_orientation(orientation);
            picture
        };
        for first in
            [NoTransforms, Rotate90, Rotate180, Rotate270, FlipHorizontal, FlipVertical, Rotate90FlipH, Rotate270FlipH]
        {
            let before = turned(first);
            for (quarters, after) in
                [before.clone(), before.rotate270(), before.rotate180(), before.rotate90()].iter().enumerate()
            {
                assert_eq!(&turned(rotated(first, quarters as u64)), after, "{first:?} {quarters}");
            }
            assert_eq!(turned(mirrored(first, true)), before.fliph(), "{first:?}");
            assert_eq!(turned(mirrored(first, false)), before.flipv(), "{first:?}");
        }
    }
}
