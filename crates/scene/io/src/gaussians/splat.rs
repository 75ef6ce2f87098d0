//! The `.splat` format of web viewers: 32 bytes per Gaussian, no header, no view-dependent color.
//!
//! A record is position and standard deviations as three floats each, then RGBA and the rotation (wxyz, 128 is zero) as
//! four bytes each.

use crate::files::bytes::Bytes;
use crate::files::content::Content;
use crate::gaussians::blocks::Blocks;
use crate::gaussians::fields::{byte, check_rows, unit};
use crate::gaussians::scene_file::{Drawing, OpenScene};
use crate::{Error, Result};
use std::borrow::Cow;
use std::io::{self, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use weaver_scene::{Gaussians, forms};

const RECORD: usize = 32;

/// Opens a `.splat` file: Gaussians of degree 0.
///
/// # Errors
/// When the length is not a multiple of 32 bytes or a value is not finite.
pub(crate) fn open<'a>(path: &Path, content: Content<'a>) -> Result<OpenScene<'a>> {
    if !content.len().is_multiple_of(RECORD) {
        return Err(Error::invalid(path, "length", "a multiple of 32 bytes", content.len()));
    }
    let records = Records { path: path.to_path_buf(), content };
    Ok(OpenScene { gaussians: Box::new(records), drawing: Drawing::default() })
}

struct Records<'a> {
    path: PathBuf,
    content: Content<'a>,
}

impl Blocks for Records<'_> {
    fn len(&self) -> usize {
        self.content.len() / RECORD
    }

    fn degree(&self) -> usize {
        0
    }

    fn block(&self, rows: Range<usize>) -> Result<Cow<'_, Gaussians>> {
        let first = rows.start;
        let mut bytes = Bytes::new(&self.path, self.content.part(rows.start * RECORD..rows.end * RECORD)?);
        let mut gaussians = Gaussians::default();
        for _ in rows {
            gaussians.means.push(bytes.f32s("a position")?);
            gaussians.log_scales.push(bytes.f32s("a scale")?.map(|s: f32| s.max(f32::MIN_POSITIVE).ln()));
            let [r, g, b, a] = bytes.take("a color")?;
            gaussians.sh.extend([r, g, b].map(|c| forms::harmonic(f32::from(c) / 255.0)));
            let opacity = f32::from(a) / 255.0;
            gaussians.opacity_logits.push(forms::opacity_logit(opacity));
            gaussians.quats.push(bytes.take("a rotation")?.map(|q: u8| (f32::from(q) - 128.0) / 128.0));
        }
        check_rows(&self.path, &gaussians, first)?;
        Ok(Cow::Owned(gaussians))
    }
}

/// Writes a `.splat` file.
///
/// Colors, opacities and rotations are rounded to 8 bits. The format has no harmonics beyond degree 0; they are left
/// out.
///
/// # Errors
/// When a value is not finite.
pub(crate) fn encode(path: &Path, gaussians: &dyn Blocks, _drawing: Drawing, w: &mut dyn Write) -> Result<()> {
    for rows in gaussians.blocks() {
        let block = gaussians.block(rows.clone())?;
        check_rows(path, &block, rows.start)?;
        written(&block, w).map_err(Error::io(path))?;
    }
    Ok(())
}

fn written(gaussians: &Gaussians, w: &mut dyn Write) -> io::Result<()> {
    let k = gaussians.coefficients();
    for i in 0..gaussians.len() {
        for x in gaussians.means[i].into_iter().chain(gaussians.log_scales[i].map(f32::exp)) {
            w.write_all(&x.to_le_bytes())?;
        }
        let color = |c: usize| byte(255.0 * forms::color(gaussians.sh[3 * k * i + c]));
        let opacity = byte(255.0 * forms::opacity(gaussians.opacity_logits[i]));
        w.write_all(&[color(0), color(1), color(2), opacity])?;
        w.write_all(&unit(gaussians.quats[i]).map(|q| byte(128.0 * q + 128.0)))?;
    }
    Ok(())
}
