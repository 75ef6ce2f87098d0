//! Files of fits, and their quality.

use crate::{FitSettings, Fitted, ImageError, Picture, decode, encode, metrics};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use weaver_command::Failure;

/// Approximate bits of a Gaussian in a file.
pub const BITS: f64 = 29.0;

/// Figures of a fitted picture and its file.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Row {
    /// The picture.
    pub picture: PathBuf,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Gaussians.
    pub gaussians: usize,
    /// Bytes of the file.
    pub bytes: usize,
    /// Peak signal-to-noise ratio, dB.
    pub psnr: f64,
    /// Multi-scale structural similarity; none of small pictures.
    pub ms_ssim: Option<f64>,
    /// Gaussians that were reset.
    pub reset: usize,
}

impl Row {
    pub fn bits_per_pixel(&self) -> f64 {
        8.0 * self.bytes as f64 / (self.width * self.height) as f64
    }

    /// All figures in one line.
    pub fn line(&self, out: &Path) -> String {
        let (count, bytes, bits, psnr) = (self.gaussians, self.bytes, self.bits_per_pixel(), self.psnr);
        format!("{count} Gaussians, {bytes} bytes, {bits:.3} bits a pixel, {psnr:.2} dB: {}", out.display())
    }
}

/// A fit as a file, with the quality of the decoded file.
pub struct Judged {
    pub row: Row,
    pub bytes: Vec<u8>,
    /// `[H, W, 3]`.
    pub drawn: Vec<f32>,
}

impl Judged {
    pub fn new(path: &Path, picture: &Picture, fitted: &Fitted) -> Result<Self, ImageError> {
        let (width, height) = (picture.width(), picture.height());
        let bytes = encode(fitted, width, height)?;
        let drawn = decode(&bytes)?.fitted.draw(width, height)?;
        let row = Row {
            picture: path.to_path_buf(),
            width,
            height,
            gaussians: fitted.gaussians.len(),
            bytes: bytes.len(),
            psnr: metrics::psnr(&drawn, picture.colors()),
            ms_ssim: metrics::ms_ssim(&drawn, picture.colors(), [height, width]),
            reset: fitted.reset,
        };
        Ok(Self { row, bytes, drawn })
    }
}

/// Method of fits.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Method {
    /// Compression ratio that determines the number of Gaussians.
    pub ratio: Option<f64>,
    /// Number of Gaussians.
    pub gaussians: Option<usize>,
    /// Optimization steps.
    pub steps: usize,
    /// Seed.
    pub seed: u64,
    /// True if the first half of the steps is at half the size.
    #[serde(default)]
    pub coarse: bool,
    /// True for the published method.
    pub published: bool,
}

impl Method {
    /// Default compression ratio.
    const RATIO: f64 = 50.0;

    /// Fails on a ratio that is not positive and finite.
    pub fn check(&self) -> Result<(), Failure> {
        match self.ratio.filter(|ratio| !(*ratio > 0.0 && ratio.is_finite())) {
            Some(ratio) => Err(Failure::Usage(format!("--ratio: expected a number above 0, found {ratio}"))),
            None => Ok(()),
        }
    }

    /// Gaussians for a picture.
    pub fn count(&self, picture: &Picture) -> usize {
        self.gaussians.unwrap_or_else(|| picture.gaussians_for(self.ratio.unwrap_or(Self::RATIO)))
    }

    /// Settings of a fit with `count` Gaussians, whose result goes into a file.
    pub fn settings(&self, count: usize) -> FitSettings {
        let mut settings = match self.published {
            true => FitSettings::published(count, self.steps),
            false => FitSettings::new(count, self.steps),
        };
        (settings.seed, settings.coarse, settings.coded) = (self.seed, self.coarse, true);
        settings
    }

    /// Note on a step: Gaussians, decibels or the published loss, and the approximate length of the file.
    pub fn note(&self, gaussians: usize, loss: f64) -> String {
        let near = match self.published {
            true => format!("loss {loss:.4}"),
            false => format!("{:.2} dB", -10.0 * loss.log10()),
        };
        format!("{gaussians} Gaussians, {near}, about {:.1} kB", gaussians as f64 * BITS / 8e3)
    }
}
