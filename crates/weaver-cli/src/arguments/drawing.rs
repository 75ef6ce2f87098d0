//! How a file of Gaussians is drawn.

use super::fit::{Rgb, background};
use crate::drawing::Asked;
use clap::Args;

/// How a scene is drawn. A fit says that in summary.json beside its scene.
#[derive(Args, Clone, Copy, Debug)]
#[command(next_help_heading = "Drawing")]
pub struct DrawingFlags {
    /// Color where nothing is: white, black or R,G,B from 0 to 1 [default: what summary.json beside the scene says, or white]
    #[arg(long, value_name = "COLOR", value_parser = background)]
    pub background: Option<Rgb>,
    /// Opacities are lowered where a Gaussian is widened to a pixel; =false if not [default: what summary.json says, or false]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    pub antialiased: Option<bool>,
    /// Gaussians nearer to a camera than this are not drawn, world units [default: what summary.json says, or 0.01]
    #[arg(long, value_name = "DISTANCE", value_parser = distance)]
    pub near: Option<f64>,
    /// Largest opacity of a single Gaussian at a pixel, above 0 and below 1 [default: what summary.json says, or 0.99]
    #[arg(long, value_name = "ALPHA", value_parser = fraction)]
    pub alpha_max: Option<f64>,
}

impl From<DrawingFlags> for Asked {
    fn from(flags: DrawingFlags) -> Self {
        let DrawingFlags { background, antialiased, near, alpha_max } = flags;
        Self { background: background.map(|color| color.0), antialiased, near, alpha_max }
    }
}

/// A distance before a camera.
pub(super) fn distance(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(distance) if distance > 0.0 && f64::is_finite(distance) => Ok(distance),
        _ => Err("expected a positive number".into()),
    }
}

/// A number between 0 and 1.
pub(super) fn fraction(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(number) if number > 0.0 && number < 1.0 => Ok(number),
        _ => Err("expected a number above 0 and below 1".into()),
    }
}
