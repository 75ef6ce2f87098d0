//! The `.wsz` format: Gaussians in some hundred bits each, by weaver-codec.

use crate::gaussians::fields::check_values;
use crate::gaussians::scene_file::{Drawing, SceneFile};
use crate::{Error, Result};
use std::io::Write;
use std::path::Path;
use weaver_codec::CodecError;
use weaver_codec::lite::{self, Quality};
use weaver_scene::Gaussians;

fn named(path: &Path) -> impl FnOnce(CodecError) -> Error + use<> {
    let path = path.to_path_buf();
    |source| Error::Codec { path, source }
}

/// Reads a `.wsz` file; Gaussians are in the order of its blocks.
///
/// # Errors
/// When bytes are missing or changed, or a number is too large.
pub(crate) fn decode(path: &Path, data: &[u8]) -> Result<SceneFile> {
    let gaussians = lite::decode(data).map_err(named(path))?;
    check_values(path, &gaussians)?;
    Ok(gaussians.into())
}

/// Writes a `.wsz` file of the usual quality.
///
/// # Errors
/// When a value is not finite.
pub(crate) fn encode(path: &Path, gaussians: &Gaussians, _: Drawing, w: &mut dyn Write) -> Result<()> {
    check_values(path, gaussians)?;
    let bytes = lite::encode(gaussians, &Quality::default()).map_err(named(path))?;
    w.write_all(&bytes).map_err(Error::io(path))
}

/// The numbers of Gaussians in the order of the file's blocks.
pub(crate) fn order(gaussians: &Gaussians) -> Vec<usize> {
    lite::order(gaussians, &Quality::default()).unwrap_or_else(|_| (0..gaussians.len()).collect())
}
