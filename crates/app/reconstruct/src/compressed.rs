//! Training for a compressed file of the scene.

use crate::Error;
use std::path::Path;
use weaver_codec::lite::{self, Quality};
use weaver_fit::{Fit, Rounding};
use weaver_io::atomic_write;
use weaver_scene::Gaussians;

/// The file.
pub(crate) const FILE: &str = "scene.wsz";

/// Part of the run from which on the scene is drawn with the file's rounding: behind the last new Gaussians, and while
/// rates fall. With the rates of the middle of a run, parameters move by more than the file's quantization steps.
const FROM: f64 = 0.8;

/// Least cost of removing a Gaussian that stays, over the mean error that rounding gives one. Chosen on fern, banana
/// and workshop.
const WORTH: f64 = 4.0;

/// Rounding of the codec.
#[derive(Clone, Copy, Debug)]
struct Lite(Quality);

impl Rounding for Lite {
    fn rounded(&mut self, gaussians: &Gaussians) -> Result<Gaussians, Box<dyn std::error::Error + Send + Sync>> {
        Ok(lite::rounded_in_place(gaussians, &self.0)?)
    }

    fn worth(&self) -> f64 {
        WORTH
    }
}

/// Draws the last fifth of a fit with the rounding of a level of [`Quality::level`], without Gaussians that are not
/// worth their bits.
pub(crate) fn train_for(fit: &mut Fit, level: f64) {
    fit.set_rounding(FROM, Box::new(Lite(Quality::level(level))));
}

/// Writes the scene at this level.
pub(crate) fn write(path: &Path, gaussians: &Gaussians, level: f64) -> Result<(), Error> {
    let bytes = lite::encode(gaussians, &Quality::level(level))
        .map_err(|source| weaver_io::Error::Codec { path: path.into(), source })?;
    Ok(atomic_write(path, |file| file.write_all(&bytes))?)
}
