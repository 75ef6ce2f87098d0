//! Gaussians from pictures.

use super::META;
use super::meta::{ANTIALIASED, Meta, Palette};
use super::plane::{Plane, Size};
use crate::gaussians::fields::check_values;
use crate::gaussians::scene_file::{Drawing, SceneFile};
use crate::{Error, Result};
use std::f32::consts::SQRT_2;
use std::path::Path;
use weaver_geometry::sh;
use weaver_scene::{Gaussians, forms};

/// Centroids of a row of their picture.
pub(super) const CENTROIDS: usize = 64;
/// The fourth channel of a rotation whose largest component is w.
pub(super) const LARGEST: u8 = 252;
/// Gaussians for each byte of a scene's files: far more than the noise of positions lets there be.
const PER_BYTE: usize = 64;

/// Something that reads a file of the scene by its name.
type Files<'a> = &'a mut dyn FnMut(&str) -> Result<Vec<u8>>;

pub(super) fn decoded(path: &Path, meta: &[u8], files: Files) -> Result<SceneFile> {
    let meta = Meta::read(path, meta)?;
    let Meta { count, means, scales, quats, sh0, rest, model, .. } = &meta;
    let names = [&means.files[0], &means.files[1], &scales.files[0], &quats.files[0], &sh0.files[0]];
    let contents = names.map(|name| files(name));
    let [low, high, scale, quat, color] = contents;
    let contents = [low?, high?, scale?, quat?, color?];
    let most = contents.iter().map(|content| content.len() * PER_BYTE).sum::<usize>();
    if *count > most {
        let expected = format!("at most {most} Gaussians in files of this length");
        return Err(Error::invalid(path, format!("{META}, count"), expected, count));
    }
    let mut planes = Vec::new();
    for (name, content) in names.iter().zip(&contents) {
        planes.push(Plane::read(path, name, content, Size::Holds(*count))?.pixels);
    }
    let [low, high, scale, quat, color] = <[_; 5]>::try_from(planes).expect("a plane for each name");
    let rows = rest.as_ref().map(|rest| Rows::read(path, *count, rest, files)).transpose()?;
    let mut gaussians = Gaussians { degree: rest.as_ref().map_or(0, |rest| rest.bands), ..Gaussians::default() };
    let scales = Table { path, name: "scales", numbers: &scales.codebook };
    let colors = Table { path, name: "sh0", numbers: &sh0.codebook };
    for i in 0..*count {
        gaussians.means.push(std::array::from_fn(|axis| {
            let steps = u16::from_le_bytes([low[i][axis], high[i][axis]]);
            position(steps, means.mins[axis], means.maxs[axis])
        }));
        gaussians.log_scales.push(scales.three(scale[i])?);
        gaussians.quats.push(rotation(quat[i]).ok_or_else(|| {
            let place = format!("{}, pixel {i}", quats.files[0]);
            Error::invalid(path, place, "a fourth channel from 252 to 255", quat[i][3])
        })?);
        gaussians.opacity_logits.push(forms::opacity_logit(f32::from(color[i][3]) / 255.0));
        gaussians.sh.extend(colors.three(color[i])?);
        rows.as_ref().map_or(Ok(()), |rows| rows.extend(i, &mut gaussians.sh))?;
    }
    check_values(path, &gaussians)?;
    let antialiased = model.as_deref() == Some(ANTIALIASED);
    Ok(SceneFile { gaussians, drawing: Drawing::antialiased(antialiased) })
}

/// A coordinate from 16 bits between bounds on a logarithmic scale.
fn position(steps: u16, min: f32, max: f32) -> f32 {
    let (min, max) = (f64::from(min), f64::from(max));
    let at = min + (max - min) * f64::from(steps) / 65535.0;
    (at.signum() * at.abs().exp_m1()) as f32
}

/// A unit quaternion wxyz from its components without the largest one, which counts as positive.
fn rotation([a, b, c, last]: [u8; 4]) -> Option<[f32; 4]> {
    let largest = usize::from(last.checked_sub(LARGEST)?);
    let mut others = [a, b, c].map(|x| (f32::from(x) / 127.5 - 1.0) / SQRT_2).into_iter();
    let mut q = [0.0; 4];
    (0..4).filter(|i| *i != largest).zip(&mut others).for_each(|(i, x)| q[i] = x);
    q[largest] = (1.0 - q.iter().map(|x| x * x).sum::<f32>()).max(0.0).sqrt();
    Some(q)
}

/// A table of numbers.
struct Table<'a> {
    path: &'a Path,
    name: &'a str,
    numbers: &'a [f32],
}

impl Table<'_> {
    fn three(&self, pixel: [u8; 4]) -> Result<[f32; 3]> {
        let mut numbers = [0.0; 3];
        for (number, &index) in numbers.iter_mut().zip(&pixel[..3]) {
            *number = *self.numbers.get(usize::from(index)).ok_or_else(|| {
                let expected = format!("more than {index} numbers");
                Error::invalid(self.path, format!("{META}, {}, codebook", self.name), expected, self.numbers.len())
            })?;
        }
        Ok(numbers)
    }
}

/// The harmonics beyond degree 0.
struct Rows<'a> {
    table: Table<'a>,
    palette: &'a Palette,
    /// Coefficients of each color.
    coefficients: usize,
    centroids: Vec<[u8; 4]>,
    labels: Vec<[u8; 4]>,
}

impl<'a> Rows<'a> {
    fn read(path: &'a Path, count: usize, palette: &'a Palette, files: Files) -> Result<Self> {
        let [centroids, labels] = &palette.files;
        let place = |key: &str| format!("{META}, shN, {key}");
        if !(1..=3).contains(&palette.bands) {
            return Err(Error::invalid(path, place("bands"), "1, 2 or 3", palette.bands));
        }
        if palette.count > 1 << 16 {
            return Err(Error::invalid(path, place("count"), "at most 65536", palette.count));
        }
        let coefficients = sh::coefficients(palette.bands) - 1;
        let content = files(centroids)?;
        if palette.count * coefficients > content.len() * PER_BYTE {
            let expected = format!("at most {} rows in a file of this length", content.len() * PER_BYTE / coefficients);
            return Err(Error::invalid(path, place("count"), expected, palette.count));
        }
        let size = Size::Columns(CENTROIDS * coefficients, palette.count * coefficients);
        Ok(Self {
            table: Table { path, name: "shN", numbers: &palette.codebook },
            palette,
            coefficients,
            centroids: Plane::read(path, centroids, &content, size)?.pixels,
            labels: Plane::read(path, labels, &files(labels)?, Size::Holds(count))?.pixels,
        })
    }

    /// Appends the harmonics of Gaussian i.
    fn extend(&self, i: usize, sh: &mut Vec<f32>) -> Result<()> {
        let [low, high, ..] = self.labels[i];
        let label = usize::from(u16::from_le_bytes([low, high]));
        if label >= self.palette.count {
            let place = format!("{}, pixel {i}", self.palette.files[1]);
            let expected = format!("a row below {}", self.palette.count);
            return Err(Error::invalid(self.table.path, place, expected, label));
        }
        // Rows of the picture hold whole rows of the palette, so that they follow each other.
        for pixel in &self.centroids[label * self.coefficients..][..self.coefficients] {
            sh.extend(self.table.three(*pixel)?);
        }
        Ok(())
    }
}
