//! Weights of the learned matcher: those that come with the program, and files of others.

use crate::Error;
use std::path::Path;
use weaver_io::safetensors::Tensors;
use weaver_sfm::LearnedMatcher;

/// The learned matcher with the weights that come with the program; `weights/README.md` of this crate describes them.
///
/// # Errors
/// Never, unless the program is damaged.
pub fn built_in_matcher() -> Result<LearnedMatcher, Error> {
    let bytes = include_bytes!("../../weights/xfeat-lighterglue.safetensors");
    matcher(&Tensors::from_bytes(bytes, "built-in weights of the learned matcher")?)
}

/// The learned matcher with the weights of a safetensors file: the tensors of `xfeat.pt`, and the ones of
/// `xfeat-lighterglue.pt` that begin with `matcher.`, in 32 or 16 bits.
///
/// # Errors
/// When the file cannot be read; names the file and the first tensor that is missing, has another shape or type, or
/// holds numbers that are not finite.
pub fn read_matcher(path: impl AsRef<Path>) -> Result<LearnedMatcher, Error> {
    matcher(&Tensors::read(path)?)
}

fn matcher(tensors: &Tensors) -> Result<LearnedMatcher, Error> {
    let read = |name: &str| {
        let tensor = tensors.tensors.get(name).ok_or("no such tensor")?;
        let values = tensor.data.widened().ok_or_else(|| format!("numbers of type {}", tensor.data.dtype()))?;
        Ok((tensor.shape.clone(), values.into_owned()))
    };
    LearnedMatcher::new(&read).map_err(|fault| {
        let key = format!("tensor {}", fault.tensor);
        Error::unexpected(tensors.origin(), key, format!("{:?}", fault.expected), fault.found)
    })
}
