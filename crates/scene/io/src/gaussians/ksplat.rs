//! The `.ksplat` format of GaussianSplats3D, versions 0.1 and later, read only: sections of Gaussians at one of three
//! levels of compression.
//!
//! A header of 4096 bytes, one of 1024 for each section, then for each section the sizes of buckets that are not full,
//! the centers of all buckets, and Gaussians: position, standard deviations, rotation (wxyz), color and opacity, and
//! harmonics, of each degree one color after the other. Level 0 has 32-bit floats; from level 1 on, positions are 16
//! bits within a bucket and the others 16-bit floats; at level 2, harmonics are bytes.
//!
//! Source: github.com/mkkellogg/GaussianSplats3D, src/loaders/SplatBuffer.js.

use crate::files::bytes::Bytes;
use crate::gaussians::fields::check_values;
use crate::gaussians::scene_file::SceneFile;
use crate::{Error, Result};
use half::f16;
use std::path::Path;
use weaver_geometry::sh;
use weaver_scene::{Gaussians, forms};

const HEADER: usize = 4096;
const SECTION: usize = 1024;
/// Bytes of a bucket's center.
const CENTER: usize = 12;
/// The largest degree of the format.
const DEGREE: u16 = 2;
/// Half of the steps of a position in a bucket where a section does not say otherwise.
const STEPS: u32 = 32767;
/// The largest harmonic of level 2 where the header does not say otherwise.
const LARGEST: f32 = 1.5;

/// Reads a `.ksplat` file.
///
/// # Errors
/// When it is of another version, a section leads beyond the file, or a value is not finite.
pub(crate) fn decode(path: &Path, data: &[u8]) -> Result<SceneFile> {
    let (header, count, sections) = Header::read(path, data)?;
    let invalid = |place: String, expected: String, found: usize| Error::invalid(path, place, expected, found);
    let room = data.len().saturating_sub(HEADER) / SECTION;
    if sections > room {
        return Err(invalid("byte 4".into(), format!("at most {room} sections in a file of this length"), sections));
    }
    let mut start = HEADER + SECTION * sections;
    let mut parts = Vec::new();
    for i in 0..sections {
        let at = HEADER + SECTION * i;
        let section = Section::read(path, &data[at..at + SECTION], i)?;
        let end = section.bytes(header.level).and_then(|bytes| start.checked_add(bytes));
        let Some(content) = end.and_then(|end| data.get(start..end)) else {
            let expected = format!("a section within the {} bytes after byte {start}", data.len() - start);
            return Err(invalid(format!("section {i}"), expected, section.most));
        };
        parts.push(section.gaussians(path, i, &header, content)?);
        start += content.len();
    }
    let gaussians = if parts.len() == 1 { parts.remove(0) } else { Gaussians::joined(&parts) };
    if gaussians.len() != count {
        return Err(invalid("byte 16".into(), format!("{} Gaussians, as sections have", gaussians.len()), count));
    }
    check_values(path, &gaussians)?;
    Ok(gaussians.into())
}

/// Header of all sections.
struct Header {
    level: u16,
    /// The least and the largest harmonic of level 2.
    harmonics: [f32; 2],
}

impl Header {
    /// The header, the number of Gaussians and the number of sections.
    fn read(path: &Path, data: &[u8]) -> Result<(Self, usize, usize)> {
        let mut bytes = Bytes::new(path, data.get(..HEADER).unwrap_or(data));
        let [major, minor, ..]: [u8; 4] = bytes.take("a header")?;
        if major != 0 || minor == 0 {
            return Err(Error::invalid(path, "byte 0", "version 0.1 or later", format!("{major}.{minor}")));
        }
        let sections = bytes.u32("a number of sections")? as usize;
        bytes.skip(8, "a header")?;
        let count = bytes.u32("a number of Gaussians")? as usize;
        let level = u16::from_le_bytes(bytes.take("a level")?);
        if level > 2 {
            return Err(Error::invalid(path, "byte 20", "level 0, 1 or 2", level));
        }
        bytes.skip(14, "a header")?;
        let [least, most] = bytes.f32s("the range of harmonics")?;
        bytes.skip(HEADER - 44, "a header")?;
        let or = |x: f32, default: f32| if x == 0.0 { default } else { x };
        Ok((Self { level, harmonics: [or(least, -LARGEST), or(most, LARGEST)] }, count, sections))
    }
}

struct Section {
    count: usize,
    /// Gaussians that there is room for.
    most: usize,
    /// Gaussians of a full bucket, and how many buckets there are: all, full, partly filled.
    capacity: usize,
    buckets: usize,
    full: usize,
    partial: usize,
    /// The side of a bucket, world units.
    side: f32,
    /// Bytes of a bucket's center.
    center: usize,
    /// Half of the steps of a position.
    steps: u32,
    degree: usize,
}

impl Section {
    fn read(path: &Path, data: &[u8], number: usize) -> Result<Self> {
        let mut bytes = Bytes::new(path, data);
        let mut word = || -> Result<usize> { Ok(bytes.u32("a section")? as usize) };
        let (count, most, capacity, buckets) = (word()?, word()?, word()?, word()?);
        let [side] = bytes.f32s("the side of a bucket")?;
        let [center, _]: [u16; 2] = [0, 1].map(|_| bytes.take("a section")).map(|b| b.map_or(0, u16::from_le_bytes));
        let steps = bytes.u32("the steps of a position")?;
        bytes.skip(4, "a section")?;
        let (full, partial) = (bytes.u32("full buckets")? as usize, bytes.u32("other buckets")? as usize);
        let degree = u16::from_le_bytes(bytes.take("a degree")?);
        let invalid =
            |expected: String, found: usize| Error::invalid(path, format!("section {number}"), expected, found);
        if degree > DEGREE {
            return Err(invalid(format!("harmonics of degree 0 to {DEGREE}"), degree.into()));
        }
        if count > most {
            return Err(invalid(format!("at most {most} Gaussians"), count));
        }
        if buckets > 0 && usize::from(center) < CENTER {
            return Err(invalid(format!("{CENTER} bytes of a bucket's center"), center.into()));
        }
        let steps = if steps == 0 { STEPS } else { steps };
        let (center, degree) = (center.into(), degree.into());
        Ok(Self { count, most, capacity, buckets, full, partial, side, center, steps, degree })
    }

    /// Numbers of harmonics beyond degree 0.
    fn rest(&self) -> usize {
        3 * (sh::coefficients(self.degree) - 1)
    }

    /// Bytes of a Gaussian.
    fn stride(&self, level: u16) -> usize {
        match level {
            0 => 44 + 4 * self.rest(),
            1 => 24 + 2 * self.rest(),
            _ => 24 + self.rest(),
        }
    }

    /// Bytes of the whole section.
    fn bytes(&self, level: u16) -> Option<usize> {
        let buckets = self.buckets.checked_mul(self.center)?.checked_add(self.partial.checked_mul(4)?)?;
        self.most.checked_mul(self.stride(level))?.checked_add(buckets)
    }

    /// Centers of the buckets of all Gaussians, in their order.
    fn centers(&self, path: &Path, number: usize, content: &[u8]) -> Result<Vec<[f32; 3]>> {
        let (sizes, centers) = content.split_at(4 * self.partial);
        let full = std::iter::repeat_n(self.capacity, self.full.min(self.count));
        let sizes = full.chain(sizes.as_chunks().0.iter().map(|size| u32::from_le_bytes(*size) as usize));
        let center = |bytes: &[u8]| -> [f32; 3] {
            std::array::from_fn(|i| f32::from_le_bytes(*bytes[4 * i..].first_chunk().expect("as long as a center")))
        };
        let mut of = Vec::new();
        for (bucket, size) in sizes.enumerate() {
            let left = self.count - of.len();
            if left == 0 {
                break;
            }
            if bucket >= self.buckets {
                let expected = format!("at most {} buckets", self.buckets);
                return Err(Error::invalid(path, format!("section {number}"), expected, "more"));
            }
            let center = center(&centers[bucket * self.center..]);
            of.extend(std::iter::repeat_n(center, size.min(left)));
        }
        if of.len() < self.count {
            let expected = format!("buckets for {} Gaussians", self.count);
            return Err(Error::invalid(path, format!("section {number}"), expected, of.len()));
        }
        Ok(of)
    }

    fn gaussians(&self, path: &Path, number: usize, header: &Header, content: &[u8]) -> Result<Gaussians> {
        // Positions of level 0 are not relative to buckets.
        let centers = if header.level == 0 { Vec::new() } else { self.centers(path, number, content)? };
        let rows = &content[self.partial * 4 + self.buckets * self.center..];
        let mut gaussians = Gaussians { degree: self.degree, ..Gaussians::default() };
        for (i, row) in rows.chunks_exact(self.stride(header.level)).take(self.count).enumerate() {
            let mut row = Bytes::new(path, row);
            let (scales, quat): ([f32; 3], [f32; 4]) = if header.level == 0 {
                gaussians.means.push(row.f32s("a position")?);
                (row.f32s("a scale")?, row.f32s("a rotation")?)
            } else {
                let position: [u8; 6] = row.take("a position")?;
                let unit = self.side / 2.0 / self.steps as f32;
                gaussians.means.push(std::array::from_fn(|axis| {
                    let steps = u16::from_le_bytes([position[2 * axis], position[2 * axis + 1]]);
                    (f32::from(steps) - self.steps as f32) * unit + centers[i][axis]
                }));
                (halves(&mut row)?, halves(&mut row)?)
            };
            gaussians.log_scales.push(scales.map(|s| s.max(f32::MIN_POSITIVE).ln()));
            gaussians.quats.push(quat);
            let [r, g, b, opacity] = row.take("a color")?.map(|x: u8| f32::from(x) / 255.0);
            gaussians.opacity_logits.push(forms::opacity_logit(opacity));
            gaussians.sh.extend([r, g, b].map(forms::harmonic));
            for degree in 1..=self.degree {
                let width = 2 * degree + 1;
                let numbers = (0..3 * width).map(|_| header.harmonic(&mut row)).collect::<Result<Vec<f32>>>()?;
                gaussians.sh.extend((0..width).flat_map(|c| [0, 1, 2].map(|channel| numbers[channel * width + c])));
            }
        }
        Ok(gaussians)
    }
}

impl Header {
    fn harmonic(&self, row: &mut Bytes) -> Result<f32> {
        let [least, most] = self.harmonics;
        Ok(match self.level {
            0 => row.f32s::<1>("harmonics")?[0],
            1 => halves::<1>(row)?[0],
            _ => least + (most - least) * f32::from(row.take::<1>("harmonics")?[0]) / 255.0,
        })
    }
}

fn halves<const N: usize>(row: &mut Bytes) -> Result<[f32; N]> {
    let mut numbers = [0.0; N];
    for number in &mut numbers {
        *number = f16::from_le_bytes(row.take("a 16-bit float")?).to_f32();
    }
    Ok(numbers)
}
