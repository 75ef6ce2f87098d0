//! Settings of a fit.

use crate::adam::Rates;
use crate::error::{ImageError, range};
use crate::picture::Picture;
use crate::start::Start;

/// Loss of a fit, and its rates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Descent {
    /// Mean squared error, not clamped; rates of 0.6 pixels for centers, 0.3 for scales, 0.1 for angles and 0.02 for
    /// colors, which fall exponentially to a twentieth. Gaussians end at 3 standard deviations.
    Squared,
    /// The published one: `0.8 L1 + 0.2 (1 - SSIM)` after the clamp, without a gradient outside of it; constant rates.
    /// Gaussians end at a value of 1/255.
    Published,
}

impl Descent {
    /// Standard deviations at which Gaussians end.
    pub fn cut(self) -> f64 {
        match self {
            Self::Squared => crate::CUT,
            Self::Published => (2.0 * 255.0_f64.ln()).sqrt(),
        }
    }

    pub(crate) fn rates(self, picture: &Picture) -> Rates {
        match self {
            Self::Squared => Rates { center: [0.6; 2], scale: 0.3, angle: 0.1, color: 0.02 },
            // The published rates are for centers in a square from -1 to 1.
            Self::Published => {
                let center = [picture.width(), picture.height()].map(|side| 0.5e-4 * side as f32);
                Rates { center, scale: 0.05, angle: 1e-3, color: 5e-3 }
            }
        }
    }
}

/// Settings of a picture's fit. Begin with [`new`](Self::new) or [`published`](Self::published), and change fields.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct FitSettings {
    /// Gaussians at the end, at most one per pixel.
    pub gaussians: usize,
    /// Steps of Adam.
    pub steps: usize,
    /// Seed of random draws.
    pub seed: u64,
    /// Start of the fit.
    pub start: Start,
    /// Steps of conjugate gradients for the colors of the start; 0 keeps them.
    pub color_steps: usize,
    /// True if half of the Gaussians are placed at the start and the others by the error, in the first half of the
    /// steps.
    pub growth: bool,
    /// True if the first half of the steps is at half the size.
    pub coarse: bool,
    /// True if the result is rounded to the precision of a file ([`encode`](crate::encode)): shapes after 60 % of the
    /// steps, positions after 80 %, colors at the end, each while the rest still moves.
    pub coded: bool,
    /// A control for [`coded`](Self::coded): in the last third of the steps, the gradients at the rounded Gaussians
    /// move the unrounded ones, without staged rounding (a straight-through estimate).
    pub straight_through: bool,
    /// Loss and rates.
    pub descent: Descent,
}

impl FitSettings {
    /// The quadtree, closed-form colors, growth, the squared error and falling rates.
    pub fn new(gaussians: usize, steps: usize) -> Self {
        Self {
            gaussians,
            steps,
            seed: 0,
            start: Start::Quadtree,
            color_steps: 10,
            growth: true,
            coarse: false,
            coded: false,
            straight_through: false,
            descent: Descent::Squared,
        }
    }

    /// The published method, with its constants.
    ///
    /// Source: Li et al., SmartSplat, AAAI 2026, arXiv 2512.20377, and its release.
    pub fn published(gaussians: usize, steps: usize) -> Self {
        Self {
            start: Start::Published,
            color_steps: 0,
            growth: false,
            descent: Descent::Published,
            ..Self::new(gaussians, steps)
        }
    }

    pub(crate) fn check(&self, picture: &Picture) -> Result<(), ImageError> {
        let pixels = picture.pixels();
        if !(1..=pixels).contains(&self.gaussians) {
            return Err(range("number of Gaussians", format!("1 to {pixels}, one per pixel"), self.gaussians));
        }
        Ok(())
    }
}
