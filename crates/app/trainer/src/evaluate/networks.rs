//! Networks that judge pictures, from files.

use crate::Error;
use crate::losses::ImageNetworks;
use std::path::Path;
use weaver_losses::lpips::{Network, Tensors};
use weaver_losses::{Lpips, Perceptual};

/// Reads LPIPS weights from a safetensors file.
///
/// # Errors
/// When the file is not one, or lacks a tensor.
pub fn load_lpips(path: &Path) -> Result<Lpips<f32>, Error> {
    let weights = tensors_of(path)?;
    let first = weights.get("net.slice1.0.weight");
    let network = if first.is_some_and(|(shape, _)| shape.last() == Some(&11)) { Network::Alex } else { Network::Vgg };
    Lpips::from_tensors(network, &weights, &path.display().to_string()).map_err(|e| Error::Input(e.to_string()))
}

fn wrong(path: &Path, message: String) -> Error {
    Error::Checkpoint { path: path.to_path_buf(), message }
}

fn tensors_of(path: &Path) -> Result<Tensors, Error> {
    let tensors = weaver_io::safetensors::Tensors::read(path)?.tensors;
    let widened = tensors.iter().map(|(name, tensor)| {
        let values = tensor.data.widened().ok_or_else(|| {
            wrong(path, format!("tensor {name}: expected F16, BF16 or F32, found {}", tensor.data.dtype()))
        })?;
        Ok((name.clone(), (tensor.shape.clone(), values.into_owned())))
    });
    widened.collect()
}

/// Reads LPIPS weights, if a file is given, and checks that images of the model's size (H, W) are large enough for
/// them.
pub(crate) fn lpips_for(path: Option<&Path>, [height, width]: [usize; 2]) -> Result<Option<Lpips<f32>>, Error> {
    let Some(path) = path else { return Ok(None) };
    let lpips = load_lpips(path)?;
    large_enough(path, lpips.least_side(), [height, width])?;
    Ok(Some(lpips))
}

fn large_enough(path: &Path, least: usize, [height, width]: [usize; 2]) -> Result<(), Error> {
    let message = || format!("expected images of at least {least} x {least} pixels, found {width} x {height}");
    if height.min(width) >= least { Ok(()) } else { Err(wrong(path, message())) }
}

/// Reads the networks of training, where there are files for them, LPIPS first, and checks that images of the model's
/// size (H, W) are large enough.
pub(crate) fn image_networks(
    [(_, lpips), (_, perceptual)]: [(&str, Option<&Path>); 2],
    size: [usize; 2],
) -> Result<ImageNetworks, Error> {
    let read = |path: &Path| {
        let network = Perceptual::from_tensors(&tensors_of(path)?, &path.display().to_string());
        large_enough(path, Perceptual::<f32>::LEAST_SIDE, size)?;
        network.map_err(|e| Error::Input(e.to_string()))
    };
    Ok(ImageNetworks { lpips: lpips_for(lpips, size)?, perceptual: perceptual.map(read).transpose()? })
}
