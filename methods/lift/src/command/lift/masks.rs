//! Masks of photos and their features, one file per camera.

use super::features::{by_stem, refused, unmatched};
use super::sampling::Lens;
use crate::Mask;
use std::path::Path;
use weaver_command::Failure;
use weaver_io::safetensors::{TensorData, Tensors};

/// Reads the masks of a folder: per camera `masks` `[M, height, width]` (U8, not 0 inside), at any size, and `features`
/// `[M, channels]`. A camera may have none.
pub fn read(folder: &Path, stems: &[String], lenses: &[Lens], channels: usize) -> Result<Vec<Mask<f32>>, Failure> {
    let files = by_stem(folder, &["safetensors"])?;
    unmatched(folder, &files, stems)?;
    if files.is_empty() {
        return Err(refused(folder, "NAME.safetensors with masks for some cameras", "none"));
    }
    let mut all = Vec::new();
    for (view, (stem, lens)) in stems.iter().zip(lenses).enumerate() {
        let Some(path) = files.get(stem) else { continue };
        let tensors = Tensors::read(path)?;
        let masks = tensors.get("masks")?;
        let (TensorData::U8(inside), &[count, height, width]) = (&masks.data, &masks.shape[..]) else {
            let found = format!("{} {:?}", masks.data.dtype(), masks.shape);
            return Err(refused(path, "masks of type U8 [masks, height, width]", &found));
        };
        if height * width == 0 {
            return Err(refused(path, "masks with pixels", &format!("{:?}", masks.shape)));
        }
        let features = tensors.widened("features", &[count, channels])?;
        if let Some(at) = features.iter().position(|x| !x.is_finite()) {
            return Err(refused(
                path,
                "features that are numbers",
                &format!("{} for mask {}", features[at], at / channels),
            ));
        }
        let places: Vec<usize> = (0..lens.pixels()).map(|pixel| lens.nearest(pixel, [height, width])).collect();
        for (inside, feature) in inside.chunks_exact(height * width).zip(features.chunks_exact(channels)) {
            let pixels = (0..).zip(&places).filter(|(_, at)| inside[**at] != 0).map(|(pixel, _)| pixel).collect();
            all.push(Mask { view, pixels, feature: feature.to_vec() });
        }
    }
    Ok(all)
}
