//! Refinement of a network's predictions.

use crate::flags::RefineFlags;
use std::path::PathBuf;
use std::sync::Arc;
use weaver_command::Failure;
use weaver_fit::FitRasterizer;
use weaver_inference::{Effort, Predictor, Refined};
use weaver_io::Image;

/// The predictor, refined by `rasterizer` if the flags request it. The size of refinement follows from the smallest of
/// `photos`, or from the network where there are none.
pub fn refined(
    predictor: Box<dyn Predictor>,
    flags: &RefineFlags,
    photos: &[PathBuf],
    rasterizer: Arc<dyn FitRasterizer>,
) -> Result<Box<dyn Predictor>, Failure> {
    let effort = match (flags.refine, flags.refine_steps) {
        (Some(seconds), _) => Effort::Seconds(seconds),
        (None, Some(steps)) => Effort::Steps(steps as usize),
        (None, None) if flags.refine_size.is_some() || flags.refine_in_place => {
            let flag = if flags.refine_in_place { "--refine-in-place" } else { "--refine-size" };
            return Err(Failure::Usage(format!("{flag}: expected --refine or --refine-steps with it")));
        }
        (None, None) => return Ok(predictor),
    };
    let [height, width] = predictor.image_size();
    let scale = match flags.refine_size {
        Some(side) => f64::from(side) / height.max(width) as f64,
        None => own_scale(photos, [height, width])?,
    };
    let size = [height, width].map(|side| (side as f64 * scale).round().max(1.0) as usize);
    let refined = Refined::new(predictor, size, effort).fitted_by(rasterizer);
    Ok(Box::new(if flags.refine_in_place { refined.in_place() } else { refined }))
}

/// Ratio of the smallest photo to the network's size; at least 1, and 1 of no photos.
fn own_scale(photos: &[PathBuf], [height, width]: [usize; 2]) -> Result<f64, Failure> {
    let mut least = f64::INFINITY;
    for photo in photos {
        let (w, h) = Image::dimensions(photo)?;
        least = least.min((w as f64 / width as f64).min(h as f64 / height as f64));
    }
    Ok(if least.is_finite() { least.max(1.0) } else { 1.0 })
}
