//! USD: `.usda`, which is text, and `.usdz`, a package with such a text.
//!
//! A prim `ParticleField3DGaussianSplat` has positions, orientations (real part first), linear scales, opacities and
//! coefficients of harmonics as attributes, in the order and with the basis of PLY files. Written files have +y up, so
//! that reading and writing turn everything by half a turn about x, after which a camera of USD looks along -z as one
//! of captures does along z.
//!
//! Source: github.com/PixarAnimationStudios/OpenUSD, pxr/usd/usdVol/schema.usda, of OpenUSD 26.03; for the package, the
//! USDZ file format specification.

mod document;
mod encode;
mod package;
mod splats;
mod text;
mod transform;

use super::blocks::Blocks;
use super::scene_file::{Drawing, OpenScene};
use crate::Result;
use crate::files::content::Content;
use std::io::Write;
use std::path::Path;
use text::Text;
use weaver_geometry::sh;
use weaver_scene::Gaussians;

/// The type of prims that are Gaussians.
const PRIM: &str = "ParticleField3DGaussianSplat";

/// Opens a `.usda` file: the Gaussians of all its prims of that type, with the transforms above them applied. Its text
/// is read a part at a time; the Gaussians are held.
///
/// # Errors
/// When it is malformed, has no such prim, attributes of other types or lengths than the schema's, values that change
/// with time, or a transform that shears or mirrors.
pub(crate) fn open_usda<'a>(path: &Path, content: Content<'a>) -> Result<OpenScene<'a>> {
    let length = content.len();
    read(Text::new(path, &content, 0..length))
}

/// Opens a `.usdz` package, whose first file is such a text.
///
/// # Errors
/// As [`open_usda`], and when the first file is none, is compressed or is damaged.
pub(crate) fn open_usdz<'a>(path: &Path, content: Content<'a>) -> Result<OpenScene<'a>> {
    let (place, checksum) = package::first(path, &content)?;
    read(Text::new(path, &content, place).with_checksum(checksum))
}

fn read(text: Text<'_>) -> Result<OpenScene<'static>> {
    let path = text.path().to_path_buf();
    let document = document::Document::read(text)?;
    Ok(OpenScene { gaussians: Box::new(splats::gaussians(&path, document)?), drawing: Drawing::default() })
}

/// Writes a `.usda` file with the shortest decimals that stand for the same 32-bit floats.
///
/// # Errors
/// When a value is not finite.
pub(crate) fn encode_usda(path: &Path, gaussians: &dyn Blocks, _drawing: Drawing, w: &mut dyn Write) -> Result<()> {
    encode::text(path, gaussians, &encode::extent(path, gaussians)?, w)
}

/// Writes a `.usdz` package of the text that [`encode_usda`] writes, which is made twice: its length and checksum come
/// before it.
///
/// # Errors
/// As [`encode_usda`]; and when the text would have more than 4 GB.
pub(crate) fn encode_usdz(path: &Path, gaussians: &dyn Blocks, _drawing: Drawing, w: &mut dyn Write) -> Result<()> {
    let extent = encode::extent(path, gaussians)?;
    package::write(path, &|w| encode::text(path, gaussians, &extent, w), w)
}

/// Half a turn about x, there and back.
fn turn(gaussians: &mut Gaussians) {
    gaussians.means.iter_mut().for_each(|[_, y, z]| (*y, *z) = (-*y, -*z));
    gaussians.quats.iter_mut().for_each(|[w, x, y, z]| (*w, *x, *y, *z) = (*x, -*w, *z, -*y));
    let (signs, width) = (sh::half_turn_signs(0), 3 * gaussians.coefficients());
    for row in gaussians.sh.chunks_exact_mut(width) {
        row.as_chunks_mut::<3>().0.iter_mut().zip(signs).for_each(|(rgb, sign)| *rgb = rgb.map(|x| sign * x));
    }
}
