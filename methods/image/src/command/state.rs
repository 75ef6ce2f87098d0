//! States of fits in checkpoints, and pictures of them.

use crate::command::results::Method;
use crate::{FitState, Fitted, Gaussians, ImageError};
use std::path::Path;
use weaver_io::safetensors::{Element, Tensors};
use weaver_io::{Error, Image, PhotoFile, Result};

/// Longest side of a drawing of a fit under way, pixels.
const LONG_SIDE: usize = 1024;
/// Finished steps, Gaussians of the start and reset ones, of a fit under way.
const COUNTS: &str = "counts";

/// Adds the state of a fit to a checkpoint.
pub fn insert(state: &FitState, tensors: &mut Tensors) {
    let kinds = [("", &state.gaussians), ("moment1.", &state.moments[0]), ("moment2.", &state.moments[1])];
    for (kind, of) in kinds {
        for (name, width, numbers) in [
            ("centers", 2, &of.centers),
            ("scales", 2, &of.scales),
            ("angles", 1, &of.angles),
            ("colors", 3, &of.colors),
        ] {
            tensors.insert(format!("{kind}{name}"), &[of.len(), width], numbers.clone());
        }
    }
    tensors.insert("additions", &[state.additions.len(), 2], state.additions.concat());
    tensors.insert(COUNTS, &[3], vec![state.step, state.first, state.reset]);
}

/// True if a checkpoint is of a fit; false for one between two pictures.
pub fn is_under_way(tensors: &Tensors) -> bool {
    tensors.tensors.contains_key(COUNTS)
}

/// The state of a fit in a checkpoint; `None` between two pictures.
pub fn stored(tensors: &Tensors) -> Result<Option<FitState>> {
    if !is_under_way(tensors) {
        return Ok(None);
    }
    let counts = tensors.values::<u64>(COUNTS, &[3])?;
    Ok(Some(FitState {
        gaussians: gaussians(tensors, "")?,
        moments: [gaussians(tensors, "moment1.")?, gaussians(tensors, "moment2.")?],
        additions: all::<u64>(tensors, "additions")?.as_chunks().0.to_vec(),
        step: counts[0],
        first: counts[1],
        reset: counts[2],
    }))
}

fn gaussians(tensors: &Tensors, kind: &str) -> Result<Gaussians<f32>> {
    let [centers, scales, angles, colors] =
        ["centers", "scales", "angles", "colors"].map(|name| all::<f32>(tensors, &format!("{kind}{name}")));
    Ok(Gaussians { centers: centers?, scales: scales?, angles: angles?, colors: colors? })
}

/// All numbers of a tensor.
pub fn all<T: Element>(tensors: &Tensors, key: &str) -> Result<Vec<T>> {
    let shape = tensors.get(key)?.shape.clone();
    Ok(tensors.values::<T>(key, &shape)?.to_vec())
}

/// The picture in a file as drawn by the fit of a checkpoint.
pub fn under_way(tensors: &Tensors, picture: &Path, method: &Method) -> Result<Image> {
    let (width, height) = PhotoFile::at(picture)?.size();
    let gaussians = gaussians(tensors, "")?;
    gaussians.check().map_err(|error| refused(tensors, &error))?;
    let fitted = Fitted { gaussians, cut: method.settings(1).descent.cut(), reset: 0 };
    drawn(&fitted, [width, height]).map_err(|error| refused(tensors, &error))
}

/// Gaussians of a picture of this width and height, drawn at most 1024 pixels long.
pub fn drawn(fitted: &Fitted, size: [usize; 2]) -> std::result::Result<Image, ImageError> {
    let scale = (LONG_SIDE as f64 / size[0].max(size[1]) as f64).min(1.0);
    let [width, height] = size.map(|side| ((side as f64 * scale).round() as usize).max(1));
    let scaled = Fitted { gaussians: fitted.gaussians.at_scale(scale), ..*fitted };
    Ok(Image { width, height, pixels: scaled.draw(width, height)? })
}

/// A failure that names the checkpoint.
pub fn refused(tensors: &Tensors, found: &dyn std::fmt::Display) -> Error {
    Error::Invalid {
        path: tensors.origin().into(),
        place: "Gaussians".into(),
        expected: "those of a picture of this run".into(),
        found: found.to_string(),
    }
}
